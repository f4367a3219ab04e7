"""How far zerobit's ways to read a code agree, and stay within the data."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import Zerobit
from octobrick.measure.extremes.search import Promise

_SAME = "voxel, plane, cell and whole are decoded to the same bits; voxels that differ"
_INSIDE = "no decoded voxel leaves [min, max]; how far one does, of the range"


def zerobit_promises(seed: int) -> Iterator[Promise]:
    """What is searched of zerobit."""
    rng = np.random.default_rng(seed)
    unit = rng.uniform(0, 1, (9, 14, 19))
    one = partial(Promise, "zerobit", "C++")
    for name in ("uint8", "int16", "float32"):
        array = (unit * 250 - (100 if name != "uint8" else 0)).astype(name)
        yield one(
            f"ratio, {name}", _SAME, 0.0, partial(_of_ratio, array), 0.05, 1e-12, 1.0, "log", 5,
        )  # fmt: skip
    yield one(
        "float32 range, ratio 0.05", _INSIDE, 0.0, partial(_of_range, unit), 1.0, 2.0**-149,
        float(np.finfo(np.float32).max),
    )  # fmt: skip
    yield one(
        "voxels along x, 5 × 6 × n", _SAME, 0.0, partial(_of_length, seed), 20, 1, 300, "whole", 6,
    )  # fmt: skip


def differing(codec: Zerobit, array: NDArray[Any], seed: int = 0) -> float:
    """How many of some voxels, of all cells' corners and of random ones, are not alike."""
    code = codec.encode(array)
    whole = codec.decode(code, array.shape, array.dtype)
    picks = np.random.default_rng(seed).integers(0, array.shape, (60, 3))
    count = 0
    for z, y, x in picks.tolist():
        cell, (i, j, k) = (z // 4, y // 4, x // 4), (z % 4, y % 4, x % 4)
        wanted = whole[z, y, x].tobytes()
        found = [codec.decode_voxel(code, (z, y, x)), codec.decode_cell(code, cell)[i, j, k]]
        found += [
            codec.decode_plane(code, cell, axis, offset)[at]
            for axis, offset, at in ((0, i, (j, k)), (1, j, (i, k)), (2, k, (i, j)))
        ]
        count += sum(value.tobytes() != wanted for value in found)
    return float(count)


def _of_ratio(array: NDArray[Any], ratio: float) -> float:
    return differing(Zerobit(ratio), array)


def _of_range(unit: NDArray[np.float64], size: float) -> float:
    array = ((2 * unit - 1) * size).astype(np.float32)
    codec = Zerobit(0.05, background=float(array.flat[0]))
    decoded = codec.decode(codec.encode(array), array.shape, array.dtype).astype(np.float64)
    low, high = float(array.min()), float(array.max())
    if not np.isfinite(decoded).all() or low == high:
        return 0.0 if low == high and (decoded == low).all() else float("inf")
    return max(low - float(decoded.min()), float(decoded.max()) - high, 0.0) / (high - low)


def _of_length(seed: int, length: float) -> float:
    array = np.random.default_rng(seed).integers(0, 256, (5, 6, int(length))).astype(np.uint8)
    return differing(Zerobit(0.1), array, seed)
