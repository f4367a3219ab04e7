"""How far the filter across block borders stays finite, in the hull, and within its bound."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import S3dc, deblock
from octobrick.measure.extremes.search import Promise

_HULL = "finite, between least and greatest voxel; how far one is outside, of the range"
_BOUND = "no voxel moves further than its block's bound; the most, relative to it"
_EXTREME = 1e300
_ROUNDED = 1 + 2.0**-10
"""Relative to a bound, what rounding to float32 may add to a change."""


def deblocking_promises(seed: int) -> Iterator[Promise]:
    """What is searched of deblocking."""
    rng = np.random.default_rng(seed)
    z, y, x = np.indices((9, 17, 26))
    unit = np.sin(x / 5 + y / 7) * np.cos(z / 4) + rng.normal(size=x.shape) * 0.05
    unit /= float(np.abs(unit).max())
    one = partial(Promise, "deblocking", "C++")
    for sign, word in ((1, "λ"), (-1, "−λ")):
        yield one(
            f"{word}, unlimited", _HULL, 0.0, partial(_hull, unit, sign), 4.0, 1 / _EXTREME,
            _EXTREME,
        )  # fmt: skip
        yield one(
            f"{word}, 2 bits", _BOUND, _ROUNDED, partial(_moved, unit, sign), 4.0, 1 / _EXTREME,
            _EXTREME,
        )  # fmt: skip
    yield one(
        "float32 range, unlimited", _HULL, 0.0, partial(_hull_of_range, unit), 1.0, 2.0**-149,
        float(np.finfo(np.float32).max),
    )  # fmt: skip
    yield one(
        "voxels of a block along x", _HULL, 0.0, partial(_hull_of_block, unit), 8, 1, 26, "whole", 5
    )


def _outside(volume: NDArray[np.float32], filtered: NDArray[np.float32]) -> float:
    if not np.isfinite(filtered).all():
        return float("inf")
    low, high = float(volume.min()), float(volume.max())
    beyond = max(low - float(filtered.min()), float(filtered.max()) - high, 0.0)
    return beyond / (high - low) if high > low else beyond


def _hull(unit: NDArray[np.float64], sign: int, strength: float) -> float:
    volume = unit.astype(np.float32)
    return _outside(volume, deblock.rational_bezier(volume, (8, 8, 8), sign * strength))


def _hull_of_range(unit: NDArray[np.float64], size: float) -> float:
    volume = (unit * size).astype(np.float32)
    return _outside(volume, deblock.rational_bezier(volume, (8, 8, 8)))


def _hull_of_block(unit: NDArray[np.float64], block: float) -> float:
    volume = unit.astype(np.float32)
    return _outside(volume, deblock.rational_bezier(volume, (4, 4, int(block))))


def _moved(unit: NDArray[np.float64], sign: int, strength: float) -> float:
    volume, codec = unit.astype(np.float32), S3dc(bits=2)
    code = codec.encode(volume)
    decoded = codec.decode(code, volume.shape, volume.dtype)
    bounds = deblock.s3dc_bounds(codec, code, volume.shape, volume.dtype)
    filtered = deblock.deblocked(codec, code, volume.shape, volume.dtype, strength=sign * strength)
    for axis in range(3):
        bounds = np.repeat(bounds, 8, axis).take(range(volume.shape[axis]), axis)
    moved = np.abs(filtered.astype(np.float64) - decoded)
    if not np.isfinite(moved).all():
        return float("inf")
    return float((moved / bounds).max())
