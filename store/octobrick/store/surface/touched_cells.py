"""Which cells of a grid a surface touches: exact, but for a margin that is always on the safe side.

Separating axes (Gottschalk 1996; Akenine-Möller 2001) tell whether a triangle meets a cube: they
do not meet if, seen along one of 13 directions, they lie apart. The directions are the cube's
three axes, the triangle's normal, and the nine products of an axis with an edge. Triangles go down
a tree of cubes, so that a large one costs as its area does, not as its box.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import InvalidInputError
from octobrick.store.box import Zyx

Triangles = NDArray[np.float64]
Cells = NDArray[np.int64]

TESTS_MAX: Final = 2_000_000_000
"""Of a triangle with a cube, for one surface and level: some ten minutes of work."""
_PLACE_MAX: Final = 2.0**24
"""In cells: up to there float64 tells a cell apart to a millionth."""
_BATCH: Final = 1 << 16
_KEPT: Final = 1 << 22
_OCTANTS: Final = np.array([(z, y, x) for z in (0, 1) for y in (0, 1) for x in (0, 1)], np.int64)


def touched_cells(triangles_zyx: Triangles, grid_zyx: Zyx, margin: float) -> Cells:
    """The cells that come within a margin of a triangle, in ascending order, each once.

    Args:
        triangles_zyx: (n, 3, 3) corners, in cells: cell i spans [i, i + 1].
        grid_zyx: how many cells there are; what lies outside of them is left out.
        margin: in cells, along each axis.

    Returns:
        (k, 3) cells (z, y, x).

    Raises:
        InvalidInputError: places too far away to be told apart, or too much work.
    """
    if triangles_zyx.size and np.abs(triangles_zyx).max() > _PLACE_MAX:
        raise InvalidInputError(
            f"the surface reaches {np.abs(triangles_zyx).max():.3g} cells of 4³ voxels away from "
            f"the volume's first, {_PLACE_MAX:g} at most; place it nearer"
        )
    search = _Search(triangles_zyx, np.array(grid_zyx, np.int64), margin)
    return search.run()


class _Batch(NamedTuple):
    """Pairs of a triangle and a cube of 2^level cells per side."""

    level: int
    triangle: NDArray[np.int64]
    cube: Cells


class _Search:
    def __init__(self, triangles: Triangles, grid: Cells, margin: float) -> None:
        self._triangles, self._margin, self._grid = triangles, margin, grid
        low, high = triangles.min(axis=1) - margin, triangles.max(axis=1) + margin
        self._low = np.maximum(np.floor(low), 0).astype(np.int64)
        self._high = np.minimum(np.floor(high), grid - 1).astype(np.int64)
        self._keys: list[NDArray[np.int64]] = []
        self._nkeys = self._ntests = 0

    def run(self) -> Cells:
        """Go down the tree, a batch at a time, depth first: memory stays that of a few batches."""
        stack = list(self._first())
        while stack:
            batch = stack.pop()
            if len(batch.triangle) > _BATCH:
                stack += [
                    _Batch(batch.level, batch.triangle[i : i + _BATCH], batch.cube[i : i + _BATCH])
                    for i in range(0, len(batch.triangle), _BATCH)
                ]
                continue
            self._ntests += len(batch.triangle)
            if self._ntests > TESTS_MAX:
                raise InvalidInputError(
                    f"finding the cells that {len(self._triangles)} triangles touch takes more "
                    f"than {TESTS_MAX} tests; simplify the mesh, or place it where less of it "
                    "lies on top of itself"
                )
            meets = self._meets(batch)
            triangle, cube = batch.triangle[meets], batch.cube[meets]
            if batch.level == 0:
                self._keep(cube)
            elif len(triangle):
                stack.append(self._children(batch.level - 1, triangle, cube))
        return self._cells()

    def _first(self) -> list[_Batch]:
        """Each triangle with the cubes, at most two per axis, of the level that fits it."""
        inside = np.flatnonzero((self._low <= self._high).all(axis=1))
        extent = (self._high - self._low)[inside].max(axis=1, initial=0)
        # 2^level >= extent: its ends then lie in one cube or in two that touch.
        levels = np.ceil(np.log2(np.maximum(extent, 1))).astype(np.int64)
        batches = []
        for level in np.unique(levels):
            own = inside[levels == level]
            cube = (self._low[own] >> level)[:, np.newaxis] + _OCTANTS
            batches.append(self._clipped(int(level), np.repeat(own, 8), cube.reshape(-1, 3)))
        return batches

    def _children(self, level: int, triangle: NDArray[np.int64], cube: Cells) -> _Batch:
        children = (2 * cube)[:, np.newaxis] + _OCTANTS
        return self._clipped(level, np.repeat(triangle, 8), children.reshape(-1, 3))

    def _clipped(self, level: int, triangle: NDArray[np.int64], cube: Cells) -> _Batch:
        """Without cubes beyond the triangle's box, or beyond the grid."""
        low, high = self._low[triangle] >> level, self._high[triangle] >> level
        meets = ((low <= cube) & (cube <= high)).all(axis=1)
        return _Batch(level, triangle[meets], cube[meets])

    def _meets(self, batch: _Batch) -> NDArray[np.bool_]:
        """Which triangles meet their cubes, grown by the margin."""
        size = float(2**batch.level)
        half = size / 2 + self._margin
        corners = self._triangles[batch.triangle] - ((batch.cube + 0.5) * size)[:, np.newaxis]
        low, high = corners.min(axis=1), corners.max(axis=1)
        meets: NDArray[np.bool_] = np.asarray(((low <= half) & (high >= -half)).all(axis=1))
        # Where a corner lies in the cube no more needs to be asked: half of all pairs.
        inside: NDArray[np.bool_] = np.asarray((np.abs(corners) <= half).all(axis=2))
        has_corner = inside.any(axis=1)
        asked = np.flatnonzero(meets & ~has_corner)
        meets[asked] = _overlap(corners[asked], half)
        return meets

    def _keep(self, cells: Cells) -> None:
        _, ny, nx = self._grid
        self._keys.append((cells[:, 0] * ny + cells[:, 1]) * nx + cells[:, 2])
        self._nkeys += len(cells)
        if self._nkeys > _KEPT:  # most of them the same: neighbours share cells
            self._keys = [np.unique(np.concatenate(self._keys))]
            self._nkeys = -len(self._keys[0]) if len(self._keys[0]) > _KEPT // 2 else 0

    def _cells(self) -> Cells:
        keys = np.unique(np.concatenate([np.empty(0, np.int64), *self._keys]))
        return np.stack(np.unravel_index(keys, tuple(self._grid.tolist())), axis=1)


def _overlap(corners: Triangles, half: float) -> NDArray[np.bool_]:
    """Whether triangles overlap a cube around 0, seen along normals and products of edges."""
    edges = np.roll(corners, -1, axis=1) - corners
    normal = np.cross(edges[:, 0], edges[:, 1])
    distance = np.abs((normal * corners[:, 0]).sum(axis=1))
    overlap = distance <= half * np.abs(normal).sum(axis=1)
    for edge in range(3):
        for axis in range(3):
            overlap &= _overlaps_along(corners, edges[:, edge], axis, half)
    return np.asarray(overlap)


def _overlaps_along(
    corners: Triangles, edge: NDArray[np.float64], axis: int, half: float
) -> NDArray[np.bool_]:
    """Whether triangle and cube overlap, seen along the product of an axis and an edge."""
    a, b = (axis + 1) % 3, (axis + 2) % 3
    # unit(axis) × edge has the components -edge[b] along a and edge[a] along b.
    seen = corners[:, :, b] * edge[:, np.newaxis, a] - corners[:, :, a] * edge[:, np.newaxis, b]
    radius = half * (np.abs(edge[:, a]) + np.abs(edge[:, b]))
    return np.asarray((seen.min(axis=1) <= radius) & (seen.max(axis=1) >= -radius))
