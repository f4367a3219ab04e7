"""Zerobit on real volumes: size, error, null nodes, and how fast voxels come out.

    script/bench zerobit [--data ../shared/data] [--quick] [--json FILE]

Sizes and errors are of this machine's own run, at the paper's target ratios of 2, 3, 4 and 5 %.
Compression ratios are given with the table of block pointers (CR), and without (CR'), as the paper
seems to count; "old" is how much larger the code is with 64 flags per cell, the authors' earlier
coding, which bench/zerobit_flags.cpp makes of it. g0 and g1 are the shares of null nodes, "void"
that of null cells, and "paper" the paper's CR for the Visible Man.

Times come from bench/zerobit_access.cpp, which is built here with cmake: an array, the code and
the earlier coding, the latter counting its flags by the paper's table and by an instruction, on the
same positions, alternating, one thread. Volumes that are not there are left out.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import _measure
import numpy as np
from numpy.typing import NDArray
from volumes import central

from octobrick.codec import Zerobit, metrics
from octobrick.store.box import Box
from octobrick.store.sources import open_source

RATIOS = (0.02, 0.03, 0.04, 0.05)
TIMED = (RATIOS[0], RATIOS[-1])
PAPER = {0.02: 81.07, 0.05: 39.72}
"""Its compression ratios, of data that are mostly background; those between are not in its text."""


def volumes(data: Path, quick: bool) -> Iterator[tuple[str, NDArray[Any]]]:
    """Name and voxels, (z, y, x) or (z, y, x, 3)."""
    readers: dict[str, tuple[Path, Callable[[Path], NDArray[Any]]]] = {
        "histology RGB": (data / "rgb_histology.tif", tiff),
        "light field RGB": (data / "lightfield_grid16", light_field),
        "EM": (data / "em_fib25_train1.tif", tiff),
        "fluorescence": (data / "fluor_mousebrain_u16.tif", tiff),
        "bonsai CT": (data / "ct_bonsai.nii.gz", source),
        "heptane": (data / "sim_heptane.nii.gz", source),
        "head CT": (_measure.ROOT / "data/ct_vhf_head.mhd", source),
    }
    for name, (path, read) in readers.items():
        if not path.exists():
            print(f"# no {name}: {path.name} is not there", file=sys.stderr)
            continue
        voxels = read(path)
        yield name, np.ascontiguousarray(voxels[central(voxels.shape[:3], 96)]) if quick else voxels


def tiff(path: Path) -> NDArray[Any]:
    import tifffile

    return np.ascontiguousarray(tifffile.imread(path))


def source(path: Path) -> NDArray[Any]:
    with open_source(path) as opened:
        return opened.read(Box((0, 0, 0), opened.shape_zyx))


def light_field(folder: Path) -> NDArray[Any]:
    """Views of a grid of cameras as the paper stacks them: 2×2 neighbours one after the other."""
    from PIL import Image

    views = sorted(folder.glob("view_*.jpg"))
    side = round(len(views) ** 0.5)
    order = [
        (v + dv) * side + u + du
        for v in range(0, side, 2)
        for u in range(0, side, 2)
        for dv in (0, 1)
        for du in (0, 1)
    ]
    return np.stack([np.asarray(Image.open(views[k]).convert("RGB")) for k in order])


def error_db(array: NDArray[Any], decoded: NDArray[Any]) -> float:
    """PSNR; for colours against 255, as the paper, else against the range of the data."""
    shape = (*array.shape[:2], -1)
    peak = 255.0 if array.ndim == 4 else float(array.max()) - float(array.min())
    return metrics.compare(array.reshape(shape), decoded.reshape(shape)).psnr(peak)


def measure(array: NDArray[Any], ratio: float) -> tuple[dict[str, Any], bytes]:
    """The row of a ratio, and the code."""
    codec = Zerobit(ratio)
    start = time.perf_counter()
    code = codec.encode(array, threads=1)
    encoded = time.perf_counter()
    decoded = codec.decode(code, array.shape, array.dtype, threads=1)
    ended = time.perf_counter()
    stats = codec.stats(code)
    nodes = stats.cells * (1 - stats.null_nodes[0]) + 8 * stats.cells * (1 - stats.null_nodes[1])
    # Per cell ours has 4 bytes of offsets, 1 of zerobits and one per node that is not null, where
    # the authors' older coding has 8 of flags and 2 of offset. All else is alike.
    old_nbytes = round(stats.nbytes - 5 * stats.cells - nodes + 10 * stats.cells)
    cells = float(np.prod([-(-n // 4) for n in array.shape[:3]]))
    row = {
        "ratio": ratio,
        "kept": (stats.details + stats.cells) / (64 * cells),
        "null_cells": 1 - stats.cells / cells,
        "compression": array.nbytes / stats.nbytes,
        "compression_without_pointers": array.nbytes / (stats.nbytes - stats.pointers_nbytes),
        "papers_compression": PAPER.get(ratio) if array.ndim == 4 else None,
        "size_of_old_coding": old_nbytes / stats.nbytes,
        "old_nbytes": old_nbytes,
        "psnr_db": error_db(array, decoded),
        "null_nodes_level0": stats.null_nodes[0],
        "null_nodes_level1": stats.null_nodes[1],
        "encode_mb_per_second": array.nbytes / 1e6 / (encoded - start),
        "decode_mb_per_second": array.nbytes / 1e6 / (ended - encoded),
    }
    return row, code


def access_times(program: Path, array: NDArray[Any], code: bytes, rounds: int) -> dict[str, Any]:
    """Nanoseconds per voxel of each access in each way, and the size of the older coding."""
    with tempfile.TemporaryDirectory() as folder:
        voxels, coded = Path(folder) / "voxels", Path(folder) / "code"
        array.tofile(voxels)
        coded.write_bytes(code)
        command = [str(program), str(voxels), str(coded), str(rounds)]
        text = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    found: dict[str, Any] = json.loads(text)
    return found


def run(data: Path, quick: bool) -> dict[str, Any]:
    """Rows of all volumes at all ratios, with the times of the least and the greatest."""
    found: dict[str, Any] = {}
    with _measure.program("zerobit_access") as program:
        for name, array in volumes(data, quick):
            rows = []
            for ratio in RATIOS:
                row, code = measure(array, ratio)
                if ratio in TIMED:
                    times = access_times(program, array, code, 3 if quick else 9)
                    if times["flags_nbytes"] != row["old_nbytes"]:
                        raise AssertionError(f"{name}: {times['flags_nbytes']} {row['old_nbytes']}")
                    row["access"] = {k: with_ratios(v) for k, v in times["accesses"].items()}
                rows.append(row)
            found[name] = {"shape": array.shape, "dtype": array.dtype.name, "rows": rows}
    return {"volumes": found}


def with_ratios(ns: dict[str, float]) -> dict[str, float]:
    """An access's times, and how often longer than ours the older coding, or ours than an array."""
    found = {**ns, "over_array": ns["code_ns"] / ns["array_ns"]}
    if "array_rows_ns" in ns:
        found["over_array_rows"] = ns["code_ns"] / ns["array_rows_ns"]
    for count in ("table", "popcount"):
        if f"flags_{count}_ns" in ns:
            found[f"gain_over_old_{count}"] = ns[f"flags_{count}_ns"] / ns["code_ns"]
    return found


def table(result: dict[str, Any]) -> str:
    """Sizes and errors; then times."""
    rows = [(name, row) for name, of in result["volumes"].items() for row in of["rows"]]
    times = [
        [name, f"{row['ratio']:.0%}", access, *time_cells(took)]
        for name, row in rows
        for access, took in row.get("access", {}).items()
    ]
    sizes = _measure.layout(SIZE_HEAD, [[name, *size_cells(row)] for name, row in rows])
    return f"{sizes}\n\n{_measure.layout(TIME_HEAD, times)}"


SIZE_HEAD = (
    *("volume", "ratio", "kept", "void", "CR", "CR'", "paper", "PSNR dB", "g0", "g1", "old"),
    *("enc MB/s", "dec MB/s"),
)
TIME_HEAD = (
    *("volume", "ratio", "access", "array ns", "code", "old table", "old popcnt"),
    *("code/array", "code/rows", "old/code table", "popcnt"),
)


def size_cells(row: dict[str, Any]) -> list[str]:
    paper = row["papers_compression"]
    return [
        *(f"{row['ratio']:.0%}", f"{row['kept']:.2%}", f"{row['null_cells']:.0%}"),
        *(f"{row['compression']:.1f}", f"{row['compression_without_pointers']:.1f}"),
        *("" if paper is None else f"{paper:.1f}", f"{row['psnr_db']:.1f}"),
        *(f"{row['null_nodes_level0']:.2f}", f"{row['null_nodes_level1']:.2f}"),
        f"{row['size_of_old_coding']:.2f}",
        *(f"{row[f'{way}_mb_per_second']:.0f}" for way in ("encode", "decode")),
    ]


def time_cells(took: dict[str, float]) -> list[str]:
    ns = ("array_ns", "code_ns", "flags_table_ns", "flags_popcount_ns")
    ratios = ("over_array", "over_array_rows", "gain_over_old_table", "gain_over_old_popcount")
    return [
        *(f"{took[k]:.1f}" if k in took else "" for k in ns),
        *(f"{took[k]:.2f}" if k in took else "" for k in ratios),
    ]


if __name__ == "__main__":
    _measure.main(__doc__, run, table)
