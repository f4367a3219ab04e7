"""How fast the codec encodes, decodes, reduces and compares one brick, with one thread.

    python bench/codec_speed.py [--json] [--shape 64,64,64] [--baseline]

Prints GB/s of voxels (10^9 bytes): the best and the median of many rounds. On a shared machine the
best is the code, and the spread is the neighbours. The brick stays in the cache, as one that was
just read, or is about to be sent, does; memcpy of the same brick is the yardstick.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import S3dc, _native, reduce

DTYPES = ("uint8", "uint16", "float32")
BITS = (2, 4, 8)  # what a GPU takes, but for 1
BLOCK = (8, 8, 8)
ROUND_SECONDS = 0.002  # long against the clock's grain, short against a scheduler's slice
ROUNDS = 60


def noisy_ramp(shape: tuple[int, ...], dtype: str) -> NDArray[Any]:
    """A gradient with noise: like CT, no block is constant and no two are alike."""
    rng = np.random.default_rng(8)
    z, y, x = np.meshgrid(*(np.linspace(0, 1, n) for n in shape), indexing="ij")
    values = (x + y * z) / 2 + rng.normal(0, 0.02, shape)
    top = 255 if dtype == "uint8" else 4095
    return np.clip(values * top, 0, top).astype(dtype)


def operations(
    voxels: NDArray[Any], simd: bool
) -> Iterator[tuple[str, int | None, Callable[[], object]]]:
    """Name, bits and call of each operation on a brick."""
    out, coarse = np.empty_like(voxels), np.empty_like(reduce.mean2(voxels))
    for bits in BITS:
        code = S3dc(BLOCK, bits).encode(voxels)
        yield "encode", bits, partial(_native.encode, voxels, BLOCK, bits, 1, simd)
        yield "decode", bits, partial(_native.decode_into, code, out, BLOCK, bits, 1, simd)
    yield "mean2", None, partial(_native.mean2_into, voxels, coarse, 1, simd)
    yield "compare", None, partial(_native.compare, voxels, out, simd)
    yield "memcpy", None, partial(np.copyto, out, voxels)


def seconds_per_call(call: Callable[[], object]) -> tuple[float, float]:
    """The best and the median over rounds, each of enough calls for the clock."""
    call()
    start = time.perf_counter()
    call()
    calls = max(1, int(ROUND_SECONDS / (time.perf_counter() - start)))
    rounds = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        for _ in range(calls):
            call()
        rounds.append((time.perf_counter() - start) / calls)
    return min(rounds), statistics.median(rounds)


def measure(shape: tuple[int, ...], simd: bool) -> Iterator[dict[str, Any]]:
    """One row for each sample type and operation."""
    for dtype in DTYPES:
        voxels = noisy_ramp(shape, dtype)
        for operation, bits, call in operations(voxels, simd):
            best, median = seconds_per_call(call)
            yield {
                "dtype": dtype,
                "operation": operation,
                "bits": bits,
                "best_gb_per_s": round(voxels.nbytes / best / 1e9, 2),
                "median_gb_per_s": round(voxels.nbytes / median / 1e9, 2),
            }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    parser.add_argument("--shape", default="64,64,64", help="voxels of the brick, z,y,x")
    parser.add_argument("--baseline", action="store_true", help="without AVX2")
    arguments = parser.parse_args()
    shape = tuple(int(n) for n in arguments.shape.split(","))
    simd = not arguments.baseline
    if arguments.json:
        rows = list(measure(shape, simd))
        json.dump({"shape_zyx": shape, "block": BLOCK, "simd": simd, "rows": rows}, sys.stdout)
        print()
        return
    print(f"brick {shape}, blocks {BLOCK}, one thread; GB/s of voxels, best (median)")
    for row in measure(shape, simd):
        bits = "" if row["bits"] is None else f"{row['bits']} bits"
        figures = f"{row['best_gb_per_s']:7.2f} ({row['median_gb_per_s']:.2f})"
        print(f"{row['dtype']:>8} {row['operation']:>8} {bits:>7} {figures}")


if __name__ == "__main__":
    main()
