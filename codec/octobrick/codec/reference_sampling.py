"""Sampling of S3Dc codes in plain numpy: slow, obvious, and the oracle for the native sampler.

Every formula stands here as docs/spec/s3dc.md has it. A voxel is what `decode` makes of it; all
else is float64, in the order written. Nothing is shared with the native code, and only well-formed
codes are expected.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Voxels = NDArray[Any]
Points = NDArray[Any]
Samples = NDArray[np.float64]
Indices = NDArray[np.int64]

Fetch = Callable[[Indices, Indices, Indices], Samples]
"""The decoded voxels at (z, y, x): what stands between interpolation and a code."""


def fetch_from(decoded: Voxels) -> Fetch:
    """Voxels of an array (z, y, x)."""
    return lambda z, y, x: decoded[z, y, x].astype(np.float64)


def nearest(fetch: Fetch, shape_zyx: tuple[int, int, int], points_xyz: Points) -> Samples:
    """The voxel that each point lies in."""
    points = points_xyz.astype(np.float64)
    z, y, x = (_inside(points[:, 2 - k], shape_zyx[k]).astype(np.int64) for k in range(3))
    return np.where(np.isnan(points).any(axis=1), np.nan, fetch(z, y, x))


def trilinear(fetch: Fetch, shape_zyx: tuple[int, int, int], points_xyz: Points) -> Samples:
    """Between the eight voxels whose centres surround each point: along x, then y, then z."""
    points = points_xyz.astype(np.float64)
    low, high, weight = [], [], []
    for k in range(3):
        n, p = shape_zyx[k], points[:, 2 - k]
        u = _inside(p - 0.5, n)
        low.append(np.minimum(np.floor(u).astype(np.int64), max(n - 2, 0)))
        high.append(np.minimum(low[k] + 1, n - 1))
        weight.append(np.where(np.isnan(p), np.nan, u - low[k]))

    def along_x(z: Indices, y: Indices) -> Samples:
        return _between(fetch(z, y, low[2]), fetch(z, y, high[2]), weight[2])

    def along_y(z: Indices) -> Samples:
        return _between(along_x(z, low[1]), along_x(z, high[1]), weight[1])

    return _between(along_y(low[0]), along_y(high[0]), weight[0])


def gradient(
    fetch: Fetch,
    shape_zyx: tuple[int, int, int],
    points_xyz: Points,
    spacing_zyx: tuple[float, float, float],
) -> Samples:
    """Differences of trilinear samples a voxel to both sides, (n, 3), components (x, y, z)."""
    points = points_xyz.astype(np.float64)
    slopes = []
    for k in range(3):
        step = np.eye(3)[k]
        ahead = trilinear(fetch, shape_zyx, points + step)
        back = trilinear(fetch, shape_zyx, points - step)
        slopes.append((ahead - back) * (0.5 / spacing_zyx[2 - k]))
    return np.stack(slopes, axis=1)


def _inside(u: Samples, n: int) -> Samples:
    """Clamped to [0, n − 1]; NaN becomes 0."""
    return np.minimum(np.where(u > 0, u, 0.0), n - 1)


def _between(a: Samples, b: Samples, weight: Samples) -> Samples:
    return a * (1 - weight) + b * weight
