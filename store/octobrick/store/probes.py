"""Bricks of every level that stand for all of them: what codecs are measured with.

A small source is read whole, so that the peak of every level is known; of a large one boxes of
2³ bricks are, spread over it, which give bricks of two levels. Either way only some of the bricks
are kept, the more likely the harder they are to code, and stand for all.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import S3dc, metrics
from octobrick.store.box import Box, Zyx, cell_box, grid_of
from octobrick.store.brick_encoder import EncodedBrick
from octobrick.store.piece_reader import PieceReader
from octobrick.store.pyramid import Address, Pyramid, PyramidPlan, feed
from octobrick.store.reducers import level_shapes
from octobrick.store.sources import Source
from octobrick.store.sources.region import RegionSource
from octobrick.store.window import memory_window

Voxels = NDArray[np.generic]

SMALL_NVOXELS = 2**27  # up to here a source is read whole
_KEPT_NVOXELS = 2**24  # of a level: 64 bricks of 64³
_AHEAD_BRICKS = 8  # under way at once
_KEPT_BRICKS = (2, 1024)  # at least and at most, whatever their size
_LARGE_SHARE = 16  # one voxel in so many is read of a large source
_REGION_BRICKS = 2  # along each side
_GOLDEN = (math.sqrt(5) - 1) / 2
_FLAT_BRICKS = 4  # kept of those that have one value
_HARDNESS_EXPONENT = 0.25  # of a squared error; bits grow with its logarithm
_HARDNESS = S3dc((4, 4, 4), bits=2)  # quick, and loses most where any codec does


@dataclass(frozen=True, slots=True)
class Probe:
    """A brick's voxels, without padding, and how many bricks it stands for."""

    voxels: Voxels
    weight: float


@dataclass(frozen=True, slots=True)
class LevelProbes:
    """What is known of a level before it is written.

    Attributes:
        probes: bricks that stand for all.
        peak: greatest less least voxel of all that was read; at most that of the level.
        nvoxels: how many the probes stand for.
        whole: whether all of the level was read.
    """

    probes: tuple[Probe, ...]
    peak: float
    nvoxels: int
    whole: bool


def read_probes(
    source: Source,
    brick: int,
    shapes: tuple[Zyx, ...],
    reducer: str,
    replace_nonfinite: float | None,
    executor: Executor,
    tick: Callable[[], None],
) -> list[LevelProbes]:
    """Probes of the finest levels, or of all of them if the source is small.

    Args:
        source: with voxels as they are stored.
        brick: voxels per brick and axis.
        shapes: of all levels.
        reducer: makes the coarser levels, one of `REDUCERS`.
        replace_nonfinite: what stands for NaN and ±Inf; None refuses them.
        executor: measures bricks.
        tick: called after each piece; what it raises ends the reading.

    Raises:
        NotFiniteError, SourceError: as reading raises them.
    """
    whole = source.nt * source.nc * math.prod(source.shape_zyx) <= SMALL_NVOXELS
    if whole:
        places = [(t, Box.of_shape(source.shape_zyx)) for t in range(source.nt)]
    else:
        places = regions(source, brick)
    nlevels = len(shapes) if whole else min(2, len(shapes))
    sieve = _Sieve(nlevels, brick)
    for t, box in places:
        region = source if whole else RegionSource(source, box)
        reader = PieceReader(region, replace_nonfinite, brick)
        plan = PyramidPlan(
            shapes_zyx=level_shapes(box.shape_zyx, brick, nlevels),
            dtype=source.dtype,
            encoders=[_ProbeEncoder(brick)] * nlevels,
            reducer=reducer,
            spacing_zyx=source.spacing_zyx,
            directions=None,
            source_nplanes=reader.nplanes,
            make_window=memory_window,
            nahead=_AHEAD_BRICKS,
        )
        pyramids = [Pyramid(plan, t, c, executor, sieve) for c in range(source.nc)]
        for piece in reader.pieces(t, 0):
            feed(pyramids, piece)
            tick()
    return [level.finish(whole=whole) for level in sieve.levels]


def regions(source: Source, brick: int) -> list[tuple[int, Box]]:
    """Time steps and boxes, in reading order, that hold a sixteenth of a large source.

    Boxes have 2³ bricks, or what else costs no less to read: whole chunks, and whole planes of a
    source that is only read forwards. Of boxes as large as these there are two at least.
    """
    side = brick * _REGION_BRICKS
    nz, ny, nx = source.shape_zyx
    cz, cy, cx = (math.ceil(n / side) * side for n in source.chunk_zyx or (1, 1, 1))
    cell: Zyx = (cz, ny, nx) if source.ascending else (cz, min(cy, ny), min(cx, nx))
    grid = (source.nt, *grid_of(source.shape_zyx, cell))
    ncells = math.prod(grid)
    count = min(ncells // _LARGE_SHARE, SMALL_NVOXELS // (math.prod(cell) * source.nc))
    places = []
    for index in _spread(ncells, max(count, min(2, ncells))):
        t, z, y, x = (int(i) for i in np.unravel_index(index, grid))
        places.append((t, cell_box((z, y, x), cell).intersect(Box.of_shape((nz, ny, nx)))))
    return places


def _spread(total: int, count: int) -> list[int]:
    """So many of the numbers below a total, ascending, evenly but on no raster."""
    step = total / count
    return [int((i + (0.5 + i * _GOLDEN) % 1) * step) for i in range(count)]


class _LevelSieve:
    """Keeps the bricks of a level that tell most of it, in one pass and bounded memory.

    Priority sampling (Duffield, Lund, Thorup 2007): a brick of size s gets the priority s/u, with u
    spread evenly over 0 to 1; those of the greatest priorities are kept, and one that is stands
    for max(1, p/s) bricks, p being the greatest priority that was not. Sums over all bricks that
    are estimated so have no bias and, where what is summed grows with s, little variance.
    """

    def __init__(self, brick: int) -> None:
        least, most = _KEPT_BRICKS
        self._nkept_max = max(least, min(most, _KEPT_NVOXELS // brick**3))
        self._kept: list[tuple[float, int, float, Voxels]] = []  # a heap by priority
        self._flat: list[Voxels] = []
        self._nbricks = self._nflat = self._nvoxels = 0
        self._low, self._high = math.inf, -math.inf

    def add(self, voxels: Voxels, low: float, high: float, hardness: float) -> None:
        """Take note of the next brick."""
        self._low, self._high = min(self._low, low), max(self._high, high)
        self._nvoxels += voxels.size
        if hardness == 0:  # would never be kept, but is not free of cost
            self._nflat += 1
            if len(self._flat) < _FLAT_BRICKS:
                self._flat.append(voxels)
            return
        size = voxels.size * hardness**_HARDNESS_EXPONENT
        priority = size / max((self._nbricks * _GOLDEN + 0.5) % 1, 1e-6)
        self._nbricks += 1
        if len(self._kept) <= self._nkept_max:
            heapq.heappush(self._kept, (priority, self._nbricks, size, voxels))
        elif priority > self._kept[0][0]:
            heapq.heapreplace(self._kept, (priority, self._nbricks, size, voxels))

    def finish(self, *, whole: bool) -> LevelProbes:
        """The kept bricks, each with its weight."""
        threshold = 0.0
        if len(self._kept) > self._nkept_max:
            threshold = heapq.heappop(self._kept)[0]
        flat = [Probe(voxels, self._nflat / len(self._flat)) for voxels in self._flat]
        kept = [
            Probe(voxels, max(1.0, threshold / size))
            for _, _, size, voxels in sorted(self._kept, key=lambda one: one[1])
        ]
        peak = self._high - self._low
        return LevelProbes((*flat, *kept), peak, self._nvoxels, whole)


class _Sieve:
    """Hands bricks to the sieves of their levels; a `Sink`."""

    def __init__(self, nlevels: int, brick: int) -> None:
        self.levels = [_LevelSieve(brick) for _ in range(nlevels)]

    def wants(self, _: Address) -> bool:
        return True

    def take(self, address: Address, encoded: EncodedBrick) -> None:
        assert isinstance(encoded, _SeenBrick)
        level = self.levels[int(address.array)]
        level.add(encoded.voxels, float(encoded.low), float(encoded.high), encoded.hardness)

    def count(self, t: int, c: int, histogram: metrics.Histogram) -> None:
        pass

    def end_layer(self, array: str, t: int, c: int, index: int) -> None:
        pass


@dataclass(frozen=True, slots=True)
class _SeenBrick(EncodedBrick):
    """A brick that was only looked at; ``low`` and ``high`` are of its own voxels."""

    voxels: Voxels = field(default_factory=lambda: np.zeros((1, 1, 1)))
    hardness: float = 0.0


@dataclass(frozen=True, slots=True)
class _ProbeEncoder:
    """In the place of an encoder: tells how hard a brick is to code."""

    brick: int

    def encode(self, voxels: Voxels, _low: Any, _high: Any) -> EncodedBrick:
        """Least and greatest voxel, and the mean squared error of a quick code."""
        low, high, hardness = voxels.min(), voxels.max(), 0.0
        if low != high:
            decoded = _HARDNESS.decode(_HARDNESS.encode(voxels), voxels.shape, voxels.dtype)
            hardness = metrics.compare(voxels, decoded).rmse ** 2
        return _SeenBrick(None, low, high, voxels=voxels.copy(), hardness=hardness)
