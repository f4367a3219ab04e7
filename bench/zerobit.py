"""Zerobit on real volumes: size, error, null nodes, and how fast voxels come out.

    python bench/zerobit.py [--data ../shared/data] [--json zerobit.json] [--rounds 5]

Sizes and errors are of this machine's own run, at the paper's target ratios of 2, 3, 4 and 5 %.
Compression ratios are given with the table of block pointers (CR), and without (CR'), as the paper
seems to count; "old" is how much larger a code is with the 64 flags per cell of the authors'
earlier work, by its formula. g0 and g1 are the shares of null nodes, "void" that of null cells.
Times come from bench/zerobit_access.cpp, which is built here with cmake: an array and the code, on
the same positions, alternating, one thread. Volumes that are not there are left out.
"""

from __future__ import annotations

import argparse
import json
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import Zerobit, metrics
from octobrick.store.box import Box
from octobrick.store.sources import open_source

ROOT = Path(__file__).parents[1]
RATIOS = (0.02, 0.03, 0.04, 0.05)


def volumes(data: Path) -> Iterator[tuple[str, NDArray[Any]]]:
    """Name and voxels, (z, y, x) or (z, y, x, 3)."""
    for name, file in (
        ("histology RGB", "rgb_histology.tif"),
        ("EM", "em_fib25_train1.tif"),
        ("fluorescence", "fluor_mousebrain_u16.tif"),
    ):
        if (data / file).exists():
            try:
                import tifffile
            except ImportError:
                print(f"no {name}: tifffile is not installed", file=sys.stderr)
                continue
            yield name, np.ascontiguousarray(tifffile.imread(data / file))
    scalars = (
        ("bonsai CT", data / "ct_bonsai.nii.gz"),
        ("heptane", data / "sim_heptane.nii.gz"),
        ("head CT", ROOT / "data/ct_vhf_head.mhd"),
    )
    for name, path in scalars:
        if path.exists():
            with open_source(path) as source:
                yield name, source.read(Box((0, 0, 0), source.shape_zyx))


def error_db(array: NDArray[Any], decoded: NDArray[Any]) -> float:
    """PSNR; for colours against 255, as the paper, else against the range of the data."""
    shape = (*array.shape[:2], -1)
    peak = 255.0 if array.ndim == 4 else float(array.max()) - float(array.min())
    return metrics.compare(array.reshape(shape), decoded.reshape(shape)).psnr(peak)


def measure(array: NDArray[Any], ratio: float) -> tuple[dict[str, Any], bytes]:
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
    old_nbytes = stats.nbytes - 5 * stats.cells - nodes + 10 * stats.cells
    cells = np.prod([-(-n // 4) for n in array.shape[:3]])
    coefficients = 64 * float(cells)
    row = {
        "ratio": ratio,
        "kept": (stats.details + stats.cells) / coefficients,
        "null_cells": 1 - stats.cells / float(cells),
        "compression": array.nbytes / stats.nbytes,
        "compression_without_pointers": array.nbytes / (stats.nbytes - stats.pointers_nbytes),
        "size_of_old_coding": old_nbytes / stats.nbytes,
        "psnr_db": error_db(array, decoded),
        "null_nodes_level0": stats.null_nodes[0],
        "null_nodes_level1": stats.null_nodes[1],
        "encode_mb_per_second": array.nbytes / 1e6 / (encoded - start),
        "decode_mb_per_second": array.nbytes / 1e6 / (ended - encoded),
    }
    return row, code


def build_access(folder: Path) -> Path:
    """Compiles bench/zerobit_access.cpp."""
    flags = ["-DOCTOBRICK_PYTHON=OFF", "-DOCTOBRICK_BENCH=ON"]
    for command in (
        ["cmake", "-S", str(ROOT), "-B", str(folder), *flags],
        ["cmake", "--build", str(folder), "--target", "zerobit_access"],
    ):
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return folder / "codec/zerobit_access"


def access_times(program: Path, array: NDArray[Any], code: bytes, rounds: int) -> Any:
    with tempfile.TemporaryDirectory() as folder:
        voxels, coded = Path(folder) / "voxels", Path(folder) / "code"
        array.tofile(voxels)
        coded.write_bytes(code)
        command = [str(program), str(voxels), str(coded), str(rounds)]
        text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return json.loads(text)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared/data")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    report: dict[str, Any] = {"machine": platform.processor() or platform.machine(), "volumes": {}}
    with tempfile.TemporaryDirectory() as folder:
        program = build_access(Path(folder))
        for name, array in volumes(arguments.data):
            entry: dict[str, Any] = {"shape": array.shape, "dtype": array.dtype.name, "rows": []}
            report["volumes"][name] = entry
            print(f"\n{name} {array.shape} {array.dtype}")
            print("ratio  kept  void   CR    CR'   PSNR   g0    g1   old  enc MB/s dec MB/s")
            for ratio in RATIOS:
                row, code = measure(array, ratio)
                entry["rows"].append(row)
                print(
                    f"{ratio:5.0%} {row['kept']:6.2%} {row['null_cells']:5.0%} "
                    f"{row['compression']:6.2f} {row['compression_without_pointers']:6.2f} "
                    f"{row['psnr_db']:6.2f} {row['null_nodes_level0']:5.2f} "
                    f"{row['null_nodes_level1']:5.2f} {row['size_of_old_coding']:5.2f} "
                    f"{row['encode_mb_per_second']:7.0f} "
                    f"{row['decode_mb_per_second']:8.0f}"
                )
                if ratio in (RATIOS[0], RATIOS[-1]):
                    row["access"] = access_times(program, array, code, arguments.rounds)
                    for access, took in row["access"].items():
                        relative = took["code_ns"] / took["array_ns"]
                        print(
                            f"      {access:22} array {took['array_ns']:6.2f} ns, code "
                            f"{took['code_ns']:6.2f} ns a voxel: {relative:.2f} times"
                        )
    if arguments.json:
        arguments.json.write_text(json.dumps(report, indent=2) + "\n")


if __name__ == "__main__":
    main()
