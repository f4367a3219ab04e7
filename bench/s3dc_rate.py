"""What S3Dc loses at 1 to 4 bits per voxel in each of its forms, beside zfp.

    script/bench s3dc_rate [--data ../shared/data] [--quick] [--json FILE]

Of the central 128³ of every scalar volume: PSNR (peak: maximum less minimum), greatest error,
resident bits per voxel, all parts of a code counted, and bits behind zstd at level 3. "fixed",
"fitted" and "scaled" have blocks of 8³ and so a little more than the bits of their row. "parent" is
the best of a few rates for the parent level, which is coded at that rate by itself, upsampled and
taken as prediction; its bits are counted, an eighth of them a voxel. "zfp" has the same rate, and
of float32 and shifted int32 what is better.

Then the grid of the paper's Table 1 on three whole volumes, the bits that a bound of 1 % of the
range takes, and the viscous flow predicted from the time step before.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import _measure
import _zfp
import numpy as np
import zstandard
from _s3dc_published import TABLE_1
from numpy.typing import NDArray
from volumes import volumes

from octobrick.codec import S3dc, metrics, reduce
from octobrick.codec.errors import InvalidInputError

SMALL, LARGE = (4, 4, 4), (8, 8, 8)
BITS = (1, 2, 3, 4)
PARENT_BITS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0)
WHOLE = ("ct_cranium", "mri_vs", "fluor")  # 16 bits, as the paper's


def measured(voxels: NDArray[Any], decoded: NDArray[Any], *codes: bytes) -> dict[str, float]:
    stats = metrics.compare(voxels, decoded)
    squeeze = zstandard.ZstdCompressor(level=3).compress
    return {
        "psnr_db": stats.psnr(float(voxels.max()) - float(voxels.min())),
        "max_error": float(stats.max_abs),
        "resident_bits": 8 * sum(map(len, codes)) / voxels.size,
        "disk_bits": 8 * sum(len(squeeze(code)) for code in codes) / voxels.size,
    }


def coded(codec: S3dc, voxels: NDArray[Any]) -> dict[str, float] | None:
    """None where tables exceed the budget."""
    try:
        code = codec.encode(voxels)
    except InvalidInputError:
        return None
    return measured(voxels, codec.decode(code, voxels.shape, voxels.dtype), code)


def with_parent(voxels: NDArray[Any], bits: float) -> dict[str, float] | None:
    """The best division of the bits between the parent level and the differences to it."""
    parent = reduce.mean2(voxels)
    best: dict[str, float] | None = None
    for parent_bits in PARENT_BITS:
        for block in (SMALL, LARGE):
            try:
                above = S3dc(bits_per_voxel=parent_bits)
                parent_code = above.encode(parent)
                rest = bits - 8 * len(parent_code) / voxels.size
                codec = S3dc(block, bits_per_voxel=max(rest, 1e-9))
                shown = above.decode(parent_code, parent.shape, parent.dtype)
                prediction = reduce.upsample2(shown, voxels.shape)
                code = codec.encode(voxels, prediction=prediction)
            except InvalidInputError:
                continue
            decoded = codec.decode(code, voxels.shape, voxels.dtype, prediction=prediction)
            found = measured(voxels, decoded, parent_code, code)
            if best is None or found["psnr_db"] > best["psnr_db"]:
                best = {**found, "parent_bits": parent_bits, "block": block[0]}
    return best


def with_zfp(voxels: NDArray[Any], bits: float) -> dict[str, float]:
    found = []
    for given in _zfp.inputs(voxels).values():
        code = _zfp.encode_rate(given, bits)
        decoded = _zfp.as_samples(_zfp.decode(code), voxels.dtype)
        found.append(measured(voxels, decoded, code))
    return max(found, key=lambda f: f["psnr_db"])


def at_bits(voxels: NDArray[Any], bits: int) -> dict[str, dict[str, float] | None]:
    return {
        "fixed": coded(S3dc(LARGE, bits), voxels),
        "fitted": coded(S3dc(LARGE, bits, fitted=True), voxels),
        "scaled": coded(S3dc(LARGE, bits, scale="trained"), voxels),
        "variable 4": coded(S3dc(SMALL, bits_per_voxel=bits, fitted=False), voxels),
        "variable 8": coded(S3dc(LARGE, bits_per_voxel=bits, fitted=False), voxels),
        "fitted 4": coded(S3dc(SMALL, bits_per_voxel=bits), voxels),
        "fitted 8": coded(S3dc(LARGE, bits_per_voxel=bits), voxels),
        "parent": with_parent(voxels, bits),
        "zfp": with_zfp(voxels, bits),
    }


def bounded(voxels: NDArray[Any]) -> dict[str, Any]:
    """Bits for an error of 1 % of the range; zfp with the tolerance whose error comes nearest."""
    reach = float(voxels.max()) - float(voxels.min())
    found: dict[str, Any] = {}
    for name, block in (("4", SMALL), ("8", LARGE)):
        result = coded(S3dc(block, max_error=reach / 100), voxels)
        assert result is not None
        assert result["max_error"] <= reach / 100
        found[name] = result
    given, trials = _zfp.inputs(voxels)["float32"], []
    for halvings in range(-4, 3):
        code = _zfp.encode_accuracy(given, reach / 100 / 2.0**halvings)
        trials.append(measured(voxels, _zfp.as_samples(_zfp.decode(code), voxels.dtype), code))
    found["zfp"] = min(trials, key=lambda t: abs(np.log((t["max_error"] or 1e-9) * 100 / reach)))
    return {"range": reach, **found}


def table_1(data: Path) -> Iterator[dict[str, Any]]:
    """Ratio and PSNR of the paper's grid."""
    for name, voxels in volumes(data, 10**9):
        if not name.startswith(WHOLE):
            continue
        for published in TABLE_1:
            bits, edge = published.bits, published.edge
            codec = S3dc((edge,) * 3, bits)
            code = codec.encode(voxels)
            decoded = codec.decode(code, voxels.shape, voxels.dtype)
            yield {
                "volume": name,
                "bits": bits,
                "edge": edge,
                "ratio": voxels.nbytes / len(code),
                "paper_picture_psnr_db": published.linear_psnr_db,
                "equation_5": 1 / (bits / (8 * voxels.itemsize) + 2 / edge**3),
                **measured(voxels, decoded, code),
            }


def in_time(data: Path) -> dict[str, Any]:
    """Fixed 4 bits of viscous flow, by itself and from the decoded step before."""
    from octobrick.store.box import Box
    from octobrick.store.sources import open_source

    folder = next(data.glob("tv_viscous*"), None)
    if folder is None:
        return {}
    steps = []
    for path in sorted(folder.glob("*.raw.gz")):
        with open_source(path) as source:
            steps.append(source.read(Box((0, 0, 0), source.shape_zyx)))
    codec, before, rows = S3dc(LARGE, 4), steps[0], []
    for step in steps[1:]:
        alone = coded(codec, step)
        code = codec.encode(step, prediction=before)
        before = codec.decode(code, step.shape, step.dtype, prediction=before)
        rows.append({"alone": alone, "predicted": measured(step, before, code)})
    return {"steps": rows}


def run(data: Path, quick: bool) -> dict[str, Any]:
    """Everything, per volume."""
    rows: dict[str, Any] = {}
    for name, voxels in volumes(data, 64 if quick else 128):
        voxels = np.ascontiguousarray(voxels)
        rows[name] = {
            "shape": voxels.shape,
            "dtype": voxels.dtype.name,
            "bits": {bits: at_bits(voxels, bits) for bits in BITS},
            "bounded": bounded(voxels),
        }
        if quick and len(rows) == 2:
            break
    return {"rows": rows, "table_1": [] if quick else list(table_1(data)), "in_time": in_time(data)}


def table(figures: dict[str, Any]) -> str:
    """PSNR by form, who wins, bounded bits, Table 1, prediction in time."""
    return "\n\n".join(
        text(figures)
        for text in (psnr_table, wins_table, disk_table, bound_table, grid_table, time_table)
    )


def forms(figures: dict[str, Any]) -> list[str]:
    first = next(iter(figures["rows"].values()))
    return list(next(iter(first["bits"].values())))


def value(result: dict[str, float] | None, key: str) -> str:
    return "-" if result is None else f"{result[key]:.2f}"


def psnr_table(figures: dict[str, Any]) -> str:
    names = forms(figures)
    lines = [
        [f"{name[:22]} {row['dtype']}", str(bits), *(value(found[k], "psnr_db") for k in names)]
        for name, row in figures["rows"].items()
        for bits, found in row["bits"].items()
    ]
    return _measure.layout(["PSNR, dB", "bits", *names], lines)


def disk_table(figures: dict[str, Any]) -> str:
    names = ["fixed", "fitted 4", "fitted 8", "parent", "zfp"]
    lines = [
        [name[:22], str(bits)]
        + [f"{value(found[k], 'resident_bits')} {value(found[k], 'disk_bits')}" for k in names]
        for name, row in figures["rows"].items()
        for bits, found in row["bits"].items()
    ]
    return _measure.layout(["bits resident, on disk", "bits", *names], lines)


def wins_table(figures: dict[str, Any]) -> str:
    """On how many volumes each form has a higher PSNR than zfp, and the best of ours."""
    names = [k for k in forms(figures) if k != "zfp"]
    lines = []
    for bits in next(iter(figures["rows"].values()))["bits"]:
        found = [row["bits"][bits] for row in figures["rows"].values()]
        better = {
            k: sum(f[k] is not None and f[k]["psnr_db"] > f["zfp"]["psnr_db"] for f in found)
            for k in names
        }
        best = sum(
            any(f[k] is not None and f[k]["psnr_db"] > f["zfp"]["psnr_db"] for k in names)
            for f in found
        )
        lines.append([str(bits), *(f"{better[k]}" for k in names), f"{best} of {len(found)}"])
    return _measure.layout(["bits: better than zfp on", *names, "any of ours"], lines)


def bound_table(figures: dict[str, Any]) -> str:
    lines = []
    for name, row in figures["rows"].items():
        found = row["bounded"]
        cells = [
            f"{f['resident_bits']:.2f} ({100 * f['max_error'] / found['range']:.2f} %)"
            for f in (found["4"], found["8"], found["zfp"])
        ]
        lines.append([name[:22], *cells])
    return _measure.layout(["bits at 1 % of the range", "4³", "8³", "zfp"], lines)


def grid_table(figures: dict[str, Any]) -> str:
    lines = [
        [row["volume"][:22], *(f"{row[k]}" for k in ("bits", "edge"))]
        + [f"{row[k]:.3f}" for k in ("ratio", "equation_5")]
        + [f"{row[k]:.2f}" for k in ("psnr_db", "paper_picture_psnr_db")]
        for row in figures["table_1"]
    ]
    head = [
        "the paper's grid",
        "bits",
        "edge",
        "ratio",
        "equation 5",
        "PSNR",
        "the paper's, of pictures",
    ]
    return _measure.layout(head, lines)


def time_table(figures: dict[str, Any]) -> str:
    lines = [
        [str(k + 2), *(value(step[way], "psnr_db") for way in ("alone", "predicted"))]
        for k, step in enumerate(figures["in_time"].get("steps", []))
    ]
    return _measure.layout(["viscous flow, 4 bits: step", "alone", "from the step before"], lines)


if __name__ == "__main__":
    _measure.main(__doc__, run, table)
