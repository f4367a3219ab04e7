"""Which bricks of a level pass tests, found by descending from coarse cubes of 2^k³ bricks.

What drops a cube drops its bricks; what lies within all half-spaces needs no more tests against
them, nor do its parts; and where besides something is seen of every brick of a cube, all pass: so
that there are too many is soon known.

A cube's corner lies beyond a plane by a sum of three numbers, one for each axis, so these are
looked up in short tables instead of being computed for every cube.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from octobrick.renderer.brick_ranges import BrickRanges
from octobrick.renderer.brick_source import SourceLevel
from octobrick.renderer.view import PLANE_SLACK
from octobrick.store.box import Zyx

Mask = NDArray[np.bool_]
Places = NDArray[np.intp]
"""Of cubes (3, n), as z, y, x."""
Planes = NDArray[np.float64]
"""(n, 4) half-spaces: normal x, y, z and offset."""
RangeTest = Callable[[NDArray[np.float64], NDArray[np.float64]], Mask]
"""Whether any value from low to high can be seen."""

_PIECE: Final = 2048
"""Cubes that are tested at once: their arrays stay in a core's cache, and of more bricks than are
wanted few are looked at."""
_FIRST_MAX: Final = 512
_OCTANTS: Final = np.array(list(np.ndindex(2, 2, 2)), np.intp).T[:, :, np.newaxis]


def descend(
    geometry: SourceLevel,
    brick_zyx: Zyx,
    planes: Mapping[str, Planes],
    ranges: Sequence[tuple[BrickRanges, RangeTest]],
    bricks_max: int,
) -> tuple[Places, dict[str, int]] | None:
    """The bricks (3, n), in no order, that pass all tests; None as soon as they are too many.

    Args:
        geometry: of the level.
        brick_zyx: voxels of a brick.
        planes: by reason, half-spaces that a brick has to reach into.
        ranges: of every channel, with the test of what is seen of it.
        bricks_max: how many may pass.

    Returns:
        The bricks; and how many the others are, by the first test that they or a cube that holds
        them failed: a reason, or "transparent".
    """
    tests = _Tests(geometry, brick_zyx, planes, ranges)
    k, nodes = _first_cubes(tests.spans)
    pending = [(k, nodes, np.ones(nodes.shape[1], bool))]
    passed: list[list[Places]] = [[] for _ in range(k + 1)]  # by k, cubes of which all bricks do
    npassed = 0
    while pending:
        k, nodes, crossing = pending.pop()
        nodes, crossing = tests.in_sight(k, nodes, crossing)
        nodes, crossing = tests.visible(k, nodes, crossing)
        if not len(crossing):
            continue
        whole = tests.passes_whole(k, nodes, crossing)
        passed[k].append(nodes[:, whole])
        npassed += tests.nbricks(k, passed[k][-1])
        if npassed > bricks_max:
            return None
        if k:
            nodes, crossing = _kept(nodes, crossing, ~whole)
            nodes, crossing = _children(nodes, crossing, tests.spans.counts[k - 1])
            pending += [
                (k - 1, nodes[:, i : i + _PIECE], crossing[i : i + _PIECE])
                for i in range(0, nodes.shape[1], _PIECE)
            ]
    return _bricks_of(passed, tests.spans), tests.counts


def _first_cubes(spans: _Spans) -> tuple[int, Places]:
    """The k to begin with, and all of its cubes: a few hundred take no longer than one does."""
    k = next(k for k, counts in enumerate(spans.counts) if math.prod(counts) <= _FIRST_MAX)
    return k, np.indices(spans.counts[k]).reshape(3, -1)


def _bricks_of(cubes: list[list[Places]], spans: _Spans) -> Places:
    """All bricks of cubes, which are given by k."""
    nodes = np.zeros((3, 0), np.intp)
    for k in reversed(range(len(cubes))):
        nodes = np.concatenate([nodes, *cubes[k]], axis=1)
        if k:
            nodes, _ = _children(nodes, np.zeros(nodes.shape[1], bool), spans.counts[k - 1])
    return nodes


class _Tests:
    """What cubes are tested for, and counts of the bricks that failed.

    Arrays are as in `descend`; of cubes it is also known whether each may cross a plane.
    """

    def __init__(
        self,
        geometry: SourceLevel,
        brick_zyx: Zyx,
        planes: Mapping[str, Planes],
        ranges: Sequence[tuple[BrickRanges, RangeTest]],
    ) -> None:
        self.spans = _spans(geometry.shape_zyx, geometry.grid_zyx, brick_zyx)
        self._ranges = ranges
        self.counts = dict.fromkeys((*planes, "transparent"), 0)
        self._slices: list[tuple[str, slice]] = []
        every = np.concatenate(list(planes.values()))
        self._nplanes, at = len(every), 0
        for reason, half_spaces in planes.items():
            self._slices.append((reason, slice(at, at + len(half_spaces))))
            at += len(half_spaces)
        self._tables = [_reaches(geometry, self.spans, every, axis) for axis in range(3)]

    def in_sight(self, k: int, nodes: Places, crossing: Mask) -> tuple[Places, Mask]:
        """The cubes that reach into all half-spaces, and which of them reach out of any."""
        at = np.flatnonzero(crossing)
        if not len(at):
            return nodes, crossing
        some = len(at) < len(crossing)
        tested = nodes.take(at, axis=1) if some else nodes
        reach = self._reach(k, tested)
        least = -PLANE_SLACK * np.sqrt(reach[self._nplanes])
        alive: Mask | None = None
        for reason, planes in self._slices:
            meets = reach[planes].min(axis=0) >= least
            self._count(reason, k, tested, meets, alive)
            alive = meets if alive is None else alive & meets
        assert alive is not None
        if k:  # of a brick it does not matter any more
            crosses = reach[self._nplanes + 1 :].min(axis=0) < 0
            if some:
                crossing = np.zeros_like(crossing)
                crossing[at] = crosses
            else:
                crossing = crosses
        keep = alive
        if some:
            keep = np.ones(len(crossing), bool)
            keep[at] = alive
        return _kept(nodes, crossing, keep)

    def visible(self, k: int, nodes: Places, crossing: Mask) -> tuple[Places, Mask]:
        """The cubes in which any channel shows anything."""
        if not len(crossing):
            return nodes, crossing
        at = self._index(k, nodes)
        seen: Mask | None = None
        for tree, test in self._ranges:
            shown = test(tree.lows[k].reshape(-1).take(at), tree.highs[k].reshape(-1).take(at))
            seen = shown if seen is None else seen | shown
        assert seen is not None
        self._count("transparent", k, nodes, seen)
        return _kept(nodes, crossing, seen)

    def passes_whole(self, k: int, nodes: Places, crossing: Mask) -> Mask:
        """The cubes, of those that passed both tests, of which every brick does: surely so."""
        if k == 0:
            return np.ones(len(crossing), bool)
        whole = np.zeros(len(crossing), bool)
        within = np.flatnonzero(~crossing)
        at = self._index(k, nodes.take(within, axis=1))
        for tree, test in self._ranges if len(at) else ():
            low = tree.common_lows[k].reshape(-1).take(at)
            high = tree.common_highs[k].reshape(-1).take(at)
            whole[within] |= (low <= high) & test(low, high)
        return whole

    def nbricks(self, k: int, nodes: Places) -> int:
        """How many bricks the cubes hold."""
        if k == 0 or not nodes.size:
            return int(nodes.shape[1])
        z, y, x = (
            nbricks[start[k] :].take(place)
            for nbricks, start, place in zip(
                self.spans.nbricks, self.spans.starts, nodes, strict=True
            )
        )
        return int((z * y * x).sum())

    def _index(self, k: int, nodes: Places) -> NDArray[np.intp]:
        """Where cubes (n,) are in the flattened arrays of a tree."""
        _, ny, nx = self.spans.counts[k]
        return np.asarray((nodes[0] * ny + nodes[1]) * nx + nodes[2])

    def _reach(self, k: int, nodes: Places) -> NDArray[np.float64]:
        """Rows by cube (…, n), of numbers that are sums over the axes.

        Of each plane, how far the cube reaches into its half-space; the square of half the cube's
        diagonal; and, unless cubes are bricks, of each plane how far all of the cube does.
        """
        nrows = None if k else self._nplanes + 1
        reach: NDArray[np.float64] | None = None
        for axis, table in enumerate(self._tables):
            start = self.spans.starts[axis][k]
            part = np.ascontiguousarray(table[:nrows, start : start + self.spans.counts[k][axis]])
            of_axis = part.take(nodes[axis], axis=1)
            reach = of_axis if reach is None else np.add(reach, of_axis, out=reach)
        assert reach is not None
        return reach

    def _count(
        self, reason: str, k: int, nodes: Places, passed: Mask, alive: Mask | None = None
    ) -> None:
        """Count the bricks of the cubes, of those that are alive, that did not pass a test."""
        dropped = ~passed if alive is None else alive & ~passed
        if k == 0:
            self.counts[reason] += int(np.count_nonzero(dropped))
        else:
            self.counts[reason] += self.nbricks(k, nodes.take(np.flatnonzero(dropped), axis=1))


@dataclass(frozen=True, slots=True)
class _Spans:
    """Where cubes of 2^k bricks lie along each axis z, y, x: of all k in one array, k = 0 first.

    Attributes:
        counts: cubes along (z, y, x), by k.
        starts: by axis and k, where those of a k begin in the arrays.
        low: by axis, the first voxel.
        high: by axis, where samples end: half a voxel beyond the last base voxel.
        nbricks: by axis, how many bricks.
    """

    counts: tuple[tuple[int, int, int], ...]
    starts: tuple[tuple[int, ...], ...]
    low: tuple[Places, ...]
    high: tuple[Places, ...]
    nbricks: tuple[Places, ...]

    @property
    def top(self) -> int:
        """The k of the cube that holds all."""
        return len(self.counts) - 1


@lru_cache(maxsize=32)  # of some kB: the same for every view of a level
def _spans(shape_zyx: Zyx, grid_zyx: Zyx, brick_zyx: Zyx) -> _Spans:
    top = (max(grid_zyx) - 1).bit_length()
    nz, ny, nx = grid_zyx
    counts = tuple((-(-nz >> k), -(-ny >> k), -(-nx >> k)) for k in range(top + 1))
    starts, low, high, nbricks = [], [], [], []
    for axis, (n, edge, nvoxels) in enumerate(zip(grid_zyx, brick_zyx, shape_zyx, strict=True)):
        of_k = [np.arange(count[axis], dtype=np.intp) << k for k, count in enumerate(counts)]
        ends = [first + (1 << k) for k, first in enumerate(of_k)]
        starts.append(tuple(np.cumsum([0, *map(len, of_k)]).tolist()[:-1]))
        first, end = np.concatenate(of_k), np.concatenate(ends)
        low.append(first * edge)
        high.append(np.minimum(end * edge + 1, nvoxels))
        nbricks.append(np.minimum(end, n) - first)
    return _Spans(counts, tuple(starts), tuple(low), tuple(high), tuple(nbricks))


def _reaches(
    geometry: SourceLevel, spans: _Spans, planes: Planes, axis: int
) -> NDArray[np.float64]:
    """What an axis adds to the rows of `_Tests._reach`, by cube; the first has the offsets too."""
    spacing, origin = geometry.spacing_xyz[2 - axis], geometry.origin_xyz[2 - axis]
    low = origin - spacing / 2 + spans.low[axis] * spacing
    high = origin - spacing / 2 + spans.high[axis] * spacing
    normal = planes[:, 2 - axis, np.newaxis]
    rows = np.empty((2 * len(planes) + 1, len(low)))
    farther, nearer = rows[: len(planes)], rows[len(planes) + 1 :]
    np.multiply(normal, low, out=nearer)
    np.multiply(normal, high, out=farther)
    nearer[...], farther[...] = np.minimum(nearer, farther), np.maximum(nearer, farther)
    if axis == 0:
        farther += planes[:, 3, np.newaxis]
        nearer += planes[:, 3, np.newaxis]
    rows[len(planes)] = ((high - low) / 2) ** 2
    return rows


def _kept(nodes: Places, crossing: Mask, keep: Mask) -> tuple[Places, Mask]:
    at = np.flatnonzero(keep)
    if len(at) == len(keep):
        return nodes, crossing
    return nodes.take(at, axis=1), crossing.take(at)


def _children(
    nodes: Places, crossing: Mask, count_zyx: tuple[int, int, int]
) -> tuple[Places, Mask]:
    """The eight parts of each cube, of which there are so many along each axis."""
    n = len(crossing)
    # By octant and then by cube: long inner loops take half the time of those of eight.
    children = (2 * nodes[:, np.newaxis] + _OCTANTS).reshape(3, 8 * n)
    crossing = np.concatenate([crossing] * 8)
    exist: Mask | None = None
    for places, count in zip(children, count_zyx, strict=True):
        if count % 2:  # else all cubes have both halves
            within = places < count
            exist = within if exist is None else exist & within
    return (children, crossing) if exist is None else _kept(children, crossing, exist)
