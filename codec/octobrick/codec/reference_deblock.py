"""The rational Bézier filter in plain numpy: slow, obvious, and the oracle for all other code.

Every formula stands here as docs/spec/deblocking.md has it. Nothing is shared with the native
code; only well-formed arguments are expected.
"""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Zyx = tuple[int, int, int]
Array = NDArray[Any]
Doubles = NDArray[np.float64]


def rational_bezier(
    volume: Array,
    block: Zyx,
    strength: float,
    bound: Array | None = None,
    *,
    limit: str = "auto",
    axes: str = "average",
    value_range: float | None = None,
) -> NDArray[np.float32]:
    """The filtered volume; `bound` has a value per voxel."""
    decoded = volume.astype(np.float32).astype(np.float64)
    low, high = decoded.min(), decoded.max()
    if low == high:
        return decoded.astype(np.float32)
    magnitudes = gradient_magnitudes(decoded, value_range or high - low)
    if axes == "sequential":
        filtered = decoded
        for axis in (2, 1, 0):
            filtered = filter_axis(filtered, magnitudes, axis, block[axis], strength)
    else:
        each = [filter_axis(decoded, magnitudes, axis, block[axis], strength) for axis in range(3)]
        filtered = decoded + sum((f - decoded) / 3 for f in each)
    if bound is not None:
        ranges = block_ranges(decoded, block)
        filtered = decoded + limited(filtered - decoded, bound, ranges, limit)
    return np.clip(filtered, low, high).astype(np.float32)


def gradient_magnitudes(decoded: Doubles, unit: float) -> Doubles:
    """|∇| over the unit, rounded to float32: central differences, one-sided at the faces."""
    squares = np.zeros_like(decoded)
    for axis in (2, 1, 0):
        count = decoded.shape[axis]
        at = np.arange(count)
        below, above = np.maximum(at - 1, 0), np.minimum(at + 1, count - 1)
        scale = np.where((at > 0) & (at < count - 1), 0.5, 1.0)
        difference = decoded.take(above, axis) - decoded.take(below, axis)
        squares += (difference * scale.reshape([-1 if i == axis else 1 for i in range(3)])) ** 2
    largest = np.finfo(np.float32).max
    return np.minimum(np.sqrt(squares) / unit, largest).astype(np.float32).astype(np.float64)


def filter_axis(
    decoded: Doubles, magnitudes: Doubles, axis: int, block: int, strength: float
) -> Doubles:
    """Every border between two blocks along an axis: the inner halves move onto their curve."""
    lines = np.moveaxis(decoded, axis, -1)
    weights = np.moveaxis(magnitudes, axis, -1)
    filtered = lines.copy()
    count = lines.shape[-1]
    for border in range(block, count, block):
        begin, end = border - block, min(border + block, count)
        for s in range(border - block // 2, border + (end - border) // 2):
            filtered[..., s] = curve_at(
                lines[..., begin:end], weights[..., begin:end], s - begin, strength
            )
    return np.moveaxis(filtered, -1, axis)


def curve_at(samples: Doubles, magnitudes: Doubles, s: int, strength: float) -> Doubles:
    """The rational Bézier curve of some control points at t = s / (n − 1), in logarithms."""
    n = samples.shape[-1]
    heaviest = magnitudes.max(-1) if strength < 0 else magnitudes.min(-1)
    with np.errstate(over="ignore"):  # a weight of e^(−∞) is 0
        exponents = log_basis(n, s) - strength * (magnitudes - heaviest[..., np.newaxis])
    weights = np.exp(exponents - exponents.max(axis=-1, keepdims=True))
    origin = samples[..., :1]
    moved = (weights * (samples - origin)).sum(axis=-1) / weights.sum(axis=-1)
    curve: Doubles = origin[..., 0] + moved
    return curve


def log_basis(n: int, s: int) -> Doubles:
    """The logarithms of the Bernstein polynomials of degree n − 1 at t = s / (n − 1)."""
    t = s / (n - 1)
    return np.array(
        [
            math.lgamma(n)
            - math.lgamma(i + 1)
            - math.lgamma(n - i)
            + i * math.log(t)
            + (n - 1 - i) * math.log1p(-t)
            for i in range(n)
        ]
    )


def block_ranges(decoded: Doubles, block: Zyx) -> Doubles:
    """The greatest less the least voxel of the block of every voxel."""
    ranges = np.empty_like(decoded)
    grid = [range(0, n, b) for n, b in zip(decoded.shape, block, strict=True)]
    for begin in itertools.product(*grid):
        cell = tuple(slice(i, i + b) for i, b in zip(begin, block, strict=True))
        ranges[cell] = np.ptp(decoded[cell])
    return ranges


def limited(change: Doubles, bound: Array, ranges: Doubles, limit: str) -> Doubles:
    """What remains of a change where the decoded value can be wrong by no more than a bound."""
    bound = bound.astype(np.float64)
    clamped: Doubles = np.clip(change, -bound, bound)
    ratio = np.abs(np.divide(change, bound, out=np.ones_like(change), where=bound > 0))
    ramp: Doubles = change * np.maximum(0, 1 - ratio**2)
    with np.errstate(over="ignore"):
        coarse = ranges <= 10 * bound
    part: Doubles = np.clip(change, -0.4 * bound, 0.4 * bound)
    auto: Doubles = np.where(coarse, part, change * np.maximum(0, 1 - ratio))
    return {"clamp": clamped, "ramp": ramp, "auto": auto}[limit]
