"""Gradients and their codes in plain numpy: slow, obvious, and the oracle for all other code.

The code of directions is docs/spec/gradient-code.md's, step by step. Nothing is shared with the
native code; only well-formed arguments are expected.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Doubles = NDArray[np.float64]
Codes = NDArray[np.uint8]

BLEND_PERCENT = 61
"""The transform's λ, in hundredths: the paper's figure 10 has its best there."""

STEPS = np.arange(255, 86, -2, dtype=np.float32)
"""The greatest magnitudes that the search tries, in its order."""

_CELLS = 32  # of the inverse's table, per axis


def central_differences(volume: NDArray[Any], spacing_zyx: Sequence[float] = (1, 1, 1)) -> Floats:
    """The gradient (z, y, x, 3) of a volume (z, y, x), components (x, y, z)."""
    wide = volume.astype(np.float64)
    axes = [_difference(wide, axis, spacing_zyx[axis]) for axis in (2, 1, 0)]
    gradient = np.stack(axes, axis=-1)
    greatest = np.abs(gradient).max(axis=-1, keepdims=True)
    largest = float(np.finfo(np.float32).max)
    scale = np.divide(largest, greatest, out=np.ones_like(greatest), where=greatest > largest)
    scaled: Floats = (gradient * scale).astype(np.float32)
    return scaled


def _difference(wide: Doubles, axis: int, spacing: float) -> Doubles:
    """Central inside, one-sided at both faces, 0 on an axis of length 1."""
    count = wide.shape[axis]
    at = np.arange(count)
    below, above = np.maximum(at - 1, 0), np.minimum(at + 1, count - 1)
    scale = np.where(above - below == 2, 0.5, 1.0) / spacing
    along = [-1 if i == axis else 1 for i in range(3)]
    difference: Doubles = wide.take(above, axis) - wide.take(below, axis)
    return difference * scale.reshape(along)


def reduce(gradient: Floats, radius: int = 1, sigma: float = 0.75) -> Floats:
    """Half the resolution: the mean weighted by magnitude and a Gaussian (the paper's eq. 1).

    The kernel is even: its centre is that of the coarse voxel, between two fine voxels.
    """
    coarse = tuple(-(-n // 2) for n in gradient.shape[:3])
    # Beyond the faces lie zero vectors: they weigh nothing.
    beyond = [(radius - 1, radius + n % 2) for n in gradient.shape[:3]]
    wide = np.pad(gradient.astype(np.float64), [*beyond, (0, 0)])
    x, y, z = np.moveaxis(wide, -1, 0)
    magnitude = np.sqrt(x * x + y * y + z * z)
    total, weights = np.zeros((*coarse, 3)), np.zeros(coarse)
    for offset in np.ndindex(*(2 * radius,) * 3):
        there = tuple(slice(o, o + 2 * n, 2) for o, n in zip(offset, coarse, strict=True))
        g_z, g_y, g_x = (_gaussian(abs(o - radius + 0.5), sigma) for o in offset)
        weight = g_z * g_y * g_x * magnitude[there]
        total += weight[..., np.newaxis] * wide[there]
        weights += weight
    divisor = np.where(weights == 0, 1.0, weights)[..., np.newaxis]
    reduced: Floats = (total / divisor).astype(np.float32)
    return reduced


def _gaussian(distance: float, sigma: float) -> float:
    """The Gaussian at a distance on one axis, relative to that at the nearest voxels, 1/2."""
    return math.exp((0.5 - distance) / sigma * ((0.5 + distance) / sigma) / 2)


def transform(a: Floats, b: Floats, c: Floats, percent: int = BLEND_PERCENT) -> tuple[Floats, ...]:
    """Steps 3 to 5 of decoding: the magnitudes S, M, W of sorted ones, not yet of length 1."""
    straight = np.float32(100 - percent)
    u, v, w = (part * (np.float32(percent) * part + straight * a) for part in (a - b, b - c, c))
    return u + (v + w), v + w, w


def decode(components: NDArray[Any], percent: int = BLEND_PERCENT) -> Floats:
    """Unit vectors of components −255 … 255, odd integers or interpolated ones (…, 3)."""
    signed = components.astype(np.float32)
    size = np.abs(signed)
    a, c = size.max(axis=-1), size.min(axis=-1)
    b = np.sort(size, axis=-1)[..., 1]
    s, m, w = transform(a, b, c, percent)
    length = np.sqrt(s * s + m * m + w * w)
    scale = np.divide(np.float32(1), length, out=np.zeros_like(length), where=a > 1)
    sorted_sizes = [(part * scale)[..., np.newaxis] for part in (s, m, w)]
    found = np.where(size == a[..., np.newaxis], sorted_sizes[0], sorted_sizes[1])
    found = np.where(
        (size == c[..., np.newaxis]) & (size < a[..., np.newaxis]), sorted_sizes[2], found
    )
    vectors: Floats = np.where(signed < 0, -found, found)
    return vectors


def decode_directions(code: Codes) -> Floats:
    """Unit vectors, or zero, of codes (…, 3)."""
    return decode(2 * code.astype(np.int64) - 255)


def invert(p: NDArray[Any], q: NDArray[Any]) -> tuple[Doubles, Doubles]:
    """The ratios that the transform takes to p = b/a and q = c/a, exactly."""
    p, q = np.asarray(p, np.float64), np.asarray(q, np.float64)
    scale = solve_scale(p, q)
    v, w = _root(scale * (p - q))[0], _root(scale * q)[0]
    return v + w, w


def solve_scale(p: Doubles, q: Doubles) -> Doubles:
    """The scale of (u, v, w) at which their roots add up to 1, by bisection."""
    low, high = np.zeros_like(p), np.ones_like(p)
    for _ in range(53):
        scale = (low + high) / 2
        u, v, w = (_root(scale * part)[0] for part in (1 - p, p - q, q))
        short = u + v + w < 1
        low, high = np.where(short, scale, low), np.where(short, high, scale)
    return high


def _root(y: Any) -> tuple[Any, Any]:
    """The solution u of 0.61 u² + 0.39 u = y, and the square root in it."""
    real = y.dtype.type
    discriminant = np.sqrt(real(0.1521) + real(2.44) * y)
    return 2 * y / (real(0.39) + discriminant), discriminant


def scale_table() -> Floats:
    """The scale on the nodes p = i/32, q = j/32, j <= i."""
    i, j = np.indices((_CELLS + 1, _CELLS + 1))
    return solve_scale(i / _CELLS, np.minimum(i, j) / _CELLS).astype(np.float32)


def interpolate_scale(p: Floats, q: Floats) -> Floats:
    """The scale at any p >= q, linear between the three nearest nodes."""
    table, cells = scale_table(), np.float32(_CELLS)
    i = np.minimum((p * cells).astype(np.int64), _CELLS - 1)
    j = np.minimum((q * cells).astype(np.int64), _CELLS - 1)
    along_p, along_q = p * cells - i.astype(np.float32), q * cells - j.astype(np.float32)
    lower = along_p >= along_q
    first, then = np.where(lower, along_p, along_q), np.where(lower, along_q, along_p)
    near, far = table[i, j], table[i + 1, j + 1]
    side = np.where(lower, table[i + 1, j], table[i, j + 1])
    scale: Floats = near + first * (side - near) + then * (far - side)
    return scale


def approximate_inverse(p: Floats, q: Floats) -> tuple[Floats, Floats]:
    """Step 3 of encoding: one Newton step from the table's scale, in float32."""
    scale = interpolate_scale(p, q)
    parts = (np.float32(1) - p, p - q, q)
    (u, slope_u), (v, slope_v), (w, slope_w) = (_root(scale * part) for part in parts)
    slope = parts[0] / slope_u + parts[1] / slope_v + parts[2] / slope_w
    better = scale - (u + v + w - np.float32(1)) / slope
    v, w = _root(better * parts[1])[0], _root(better * parts[2])[0]
    return v + w, w


def encode_directions(vectors: NDArray[Any]) -> Codes:
    """Codes of finite vectors (…, 3)."""
    flat = vectors.reshape(-1, 3).astype(np.float64)
    size = np.abs(flat)
    order = np.argsort(-size, axis=-1, kind="stable")
    sizes = np.take_along_axis(size, order, axis=-1)
    zero = sizes[:, :1] == 0
    ratios = (sizes[:, 1:] / np.where(zero, 1, sizes[:, :1])).astype(np.float32)
    magnitudes = search(ratios[:, 0], ratios[:, 1])
    odd = np.empty_like(magnitudes)
    np.put_along_axis(odd, order, magnitudes, axis=-1)
    odd = np.where(flat < 0, -odd, odd)
    codes = np.where(zero, 128, (odd + 255) / 2).astype(np.uint8)
    return codes.reshape(vectors.shape)


def search(p: Floats, q: Floats) -> Floats:
    """Step 4 of encoding: the sorted magnitudes (n, 3) whose direction is nearest to (1, p, q)."""
    near_p, near_q = approximate_inverse(p, q)
    best = np.zeros((len(p), 3), np.float32)
    least = np.full(len(p), np.inf, np.float32)
    for a in STEPS:
        b = _nearest_odd(near_p, a)
        c = np.minimum(_nearest_odd(near_q, a), b)
        candidate = np.stack([np.full_like(b, a), b, c], axis=-1)
        found = _distance(p, q, *transform(*candidate.T))
        better = found < least
        least = np.where(better, found, least)
        best = np.where(better[:, np.newaxis], candidate, best)
    return best


def _nearest_odd(ratio: Floats, a: np.float32) -> Floats:
    odd: Floats = 2 * np.floor(ratio * (a / 2)) + 1
    return odd


def _distance(p: Floats, q: Floats, s: Floats, m: Floats, w: Floats) -> Floats:
    """The squared sine of the angle between (1, p, q) and (S, M, W), but for |(1, p, q)|²."""
    x, y, z = p * w - q * m, q * s - w, m - p * s
    distance: Floats = (x * x + y * y + z * z) / (s * s + m * m + w * w)
    return (distance.view(np.int32) & ~127).view(np.float32)  # as precise as the search asks


def largest_hole(percent: int = BLEND_PERCENT) -> tuple[float, float]:
    """The greatest angle, in degrees, that a search finds, and a bound on that to any code.

    Distance to a set grows by no more than one moves. So in a cell of radius r around a point that
    is d away from some code nothing is further than d + r from all codes; cells where that is
    above the greatest distance found are quartered. One region stands for all 48.
    """
    half = 1 / 40  # cells of 2 · half on the face of the cube, seen from its centre at distance 1
    middle = np.arange(half, 1, 2 * half)
    cells = np.stack([g.ravel() for g in np.meshgrid(middle, middle, indexing="ij")], -1)
    hole = 0.0
    while True:
        cells = cells[cells[:, 1] - half <= cells[:, 0] + half]
        distance = np.full(len(cells), np.inf)
        points = np.column_stack([np.ones(len(cells)), cells])
        ratios = _inverse_ratios(cells, percent)
        for a in STEPS:
            distance = np.minimum(distance, _angle(points, _tried(ratios, a, percent)))
        inside = (cells[:, 1] <= cells[:, 0]) & (cells.max(axis=1) <= 1)
        hole = max(hole, float(distance[inside].max(initial=0)))
        reach = np.degrees(half * np.sqrt(2))
        if half < 6e-7 or not len(cells):
            return hole, float((distance + reach).max(initial=hole))
        cells, half = cells[distance + reach > hole], half / 2
        corners = half * np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)])
        cells = (cells[:, np.newaxis] + corners).reshape(-1, 2)


def _inverse_ratios(cells: Doubles, percent: int) -> Doubles:
    """What the transform takes to the points of cells, each moved into the region."""
    inside: Doubles = np.sort(np.clip(cells, 0, 1), axis=1)[:, ::-1]
    return inside if percent == 0 else np.stack(invert(*inside.T), axis=-1)


def _tried(ratios: Doubles, a: np.float32, percent: int) -> Doubles:
    """The directions of the codes of magnitude `a` that the search would try."""
    b, c = np.clip(2 * np.floor(ratios.T * (a / 2)) + 1, 1, a).astype(np.float32)
    return np.stack(transform(np.full(len(b), a), b, c, percent), axis=-1).astype(np.float64)


def _angle(a: Doubles, b: Doubles) -> Doubles:
    """In degrees, exact for small ones too."""
    across, along = np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(axis=-1)
    angle: Doubles = np.degrees(np.arctan2(across, along))
    return angle
