"""How fast S3Dc encodes and decodes one brick with one thread, beside zfp and memcpy.

    script/bench s3dc_speed [--data ../shared/data] [--quick] [--json FILE]

The brick is the middle 64³ of each scalar volume, in cache; blocks of 8³ voxels. "fixed" has 4
bits, "fitted" the same with fitted end points; "variable" has 4 bits per voxel in all, with blocks
of 4³ and 8³; "bounded" keeps 1 % of the range; "predicted" is "variable 8³" with the upsampled
parent level, which is given. zfp has a fixed rate of 4 bits, and float32 samples, whose conversion
is not counted. All take turns; medians. "two threads" is a 256³ volume, made of the brick, over one
thread.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import _measure
import _zfp
import numpy as np
from numpy.typing import NDArray
from volumes import volumes

from octobrick.codec import S3dc, _native, reduce
from octobrick.codec.s3dc_rule import native_rule

EDGE = 64
SMALL, LARGE = (4, 4, 4), (8, 8, 8)
CALLS_PER_TURN = 4  # long against the clock's grain


def codecs(voxels: NDArray[Any]) -> dict[str, S3dc]:
    reach = float(voxels.max()) - float(voxels.min())
    return {
        "fixed": S3dc(LARGE, 4),
        "fitted": S3dc(LARGE, 4, fitted=True),
        "variable_4": S3dc(SMALL, bits_per_voxel=4),
        "variable_8": S3dc(LARGE, bits_per_voxel=4),
        "bounded": S3dc(LARGE, max_error=reach / 100),
        "predicted": S3dc(LARGE, bits_per_voxel=4),
    }


def calls_of(voxels: NDArray[Any]) -> dict[str, Callable[[], object]]:
    """Encoding and decoding in every way, and copying; the library's own time, without Python's."""
    prediction = reduce.upsample2(reduce.mean2(voxels), voxels.shape)
    out = np.empty_like(voxels)
    calls: dict[str, Callable[[], object]] = {}
    for name, codec in codecs(voxels).items():
        known = prediction if name == "predicted" else None
        code = codec.encode(voxels, prediction=known)
        if codec.bits is not None:
            calls[f"{name} encode"] = partial(
                _native.encode, voxels, codec.block, codec.bits, 1, fitted=bool(codec.fitted)
            )
            calls[f"{name} decode"] = partial(
                _native.decode_into, code, out, codec.block, codec.bits, 1
            )
        else:
            rule, value = native_rule(codec)
            calls[f"{name} encode"] = partial(
                _native.variable_encode,
                voxels, codec.block, rule, value, bool(codec.fitted), known, 1,
            )  # fmt: skip
            calls[f"{name} decode"] = partial(
                _native.variable_decode_into, code, out, codec.block, known, 1
            )
    zfp_input = _zfp.inputs(voxels)["float32"]
    calls["zfp encode"] = partial(_zfp.encode_rate, zfp_input, 4)
    calls["zfp decode"] = partial(_zfp.decode, _zfp.encode_rate(zfp_input, 4))
    calls["memcpy"] = partial(np.copyto, out, voxels)
    return calls


def repeated(call: Callable[[], object]) -> None:
    for _ in range(CALLS_PER_TURN):
        call()


def two_threads(voxels: NDArray[Any], rounds: int) -> dict[str, float]:
    """One thread's time over two threads', into memory that is there already where decoding."""
    large = np.tile(voxels, (4, 4, 4))
    code, out = S3dc(LARGE, 4).encode(large), np.empty_like(large)
    calls: dict[str, Callable[[], object]] = {}
    for threads in (1, 2):
        calls[f"encode {threads}"] = partial(_native.encode, large, LARGE, 4, threads)
        calls[f"decode {threads}"] = partial(_native.decode_into, code, out, LARGE, 4, threads)
    seconds = _measure.alternating(calls, rounds)
    return {way: seconds[f"{way} 1"] / seconds[f"{way} 2"] for way in ("encode", "decode")}


def run(data: Path, quick: bool) -> dict[str, Any]:
    """Millions of voxels a second, per volume and call."""
    rows: dict[str, Any] = {}
    for name, voxels in volumes(data, EDGE):
        if min(voxels.shape) < EDGE:
            continue
        voxels = np.ascontiguousarray(voxels)
        calls = {k: partial(repeated, call) for k, call in calls_of(voxels).items()}
        seconds = _measure.alternating(calls, 5 if quick else 21)
        rates = {k: CALLS_PER_TURN * voxels.size / s / 1e6 for k, s in seconds.items()}
        rows[name] = {"dtype": voxels.dtype.name, "mvoxels_per_second": rates}
        rows[name]["two_threads"] = two_threads(voxels, 3 if quick else 9)
        if quick and len(rows) == 2:
            break
    return {"edge": EDGE, "rows": rows}


def table(figures: dict[str, Any]) -> str:
    """Rates, and what the issue asks as ratios: over zfp, and over memcpy."""
    rows = figures["rows"]
    names = list(next(iter(rows.values()))["mvoxels_per_second"])
    rates = [
        [name[:24], row["dtype"], *(f"{row['mvoxels_per_second'][k]:.0f}" for k in names)]
        for name, row in rows.items()
    ]
    head = [
        "Mvoxel/s",
        "type",
        *(k.replace(" encode", " enc").replace(" decode", " dec") for k in names),
    ]
    return "\n\n".join([_measure.layout(head, rates), _measure.layout(*ratios(rows))])


def ratios(rows: dict[str, Any]) -> tuple[list[str], list[list[str]]]:
    """Of each volume, and their medians."""
    columns: list[tuple[str, Callable[[dict[str, float]], float]]] = []
    for way in ("encode", "decode"):
        columns += [
            (f"{name} {way}/zfp", partial(over, f"{name} {way}", f"zfp {way}"))
            for name in ("fixed", "variable_4", "variable_8", "predicted")
        ]
        columns.append((f"fixed {way}/memcpy", partial(over, f"fixed {way}", "memcpy")))
    lines = [
        [name[:24], *(f"{ratio(row['mvoxels_per_second']):.2f}" for _, ratio in columns)]
        + [f"{row['two_threads'][way]:.2f}" for way in ("encode", "decode")]
        for name, row in rows.items()
    ]
    medians = [
        f"{np.median([float(line[k]) for line in lines]):.2f}" for k in range(1, len(lines[0]))
    ]
    head = ["ratio", *(name for name, _ in columns), "2 threads enc", "2 threads dec"]
    return head, [*lines, ["median", *medians]]


def over(a: str, b: str, rates: dict[str, float]) -> float:
    return rates[a] / rates[b]


if __name__ == "__main__":
    _measure.main(__doc__, run, table)
