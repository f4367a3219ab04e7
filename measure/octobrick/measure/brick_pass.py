"""One pass over the bricks of a source, in its order and with memory bounded by a slab.

The machinery is that of the ingest, so bricks, and what is refused, are those of the ingest.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import metrics
from octobrick.store.box import Box, Zyx, cell_box
from octobrick.store.brick_encoder import EncodedBrick
from octobrick.store.piece_reader import PieceReader
from octobrick.store.pyramid import Address, Pyramid, PyramidPlan, feed
from octobrick.store.sources import Source
from octobrick.store.sources.region import RegionSource
from octobrick.store.window import memory_window

Voxels = NDArray[np.generic]

BRICK = 64
"""Voxels along each side of a brick, as an ingest makes them by default."""

_AHEAD_BRICKS = 8  # under way at once


class Place(NamedTuple):
    """A box of a time step, read in one go; whole bricks, but for the volume's ends."""

    t: int
    box: Box


class BrickKey(NamedTuple):
    """Which brick: in which place, of which channel, and where in the place's grid."""

    place: int
    c: int
    zyx: Zyx


@dataclass(frozen=True, slots=True)
class SeenBrick(EncodedBrick):
    """A brick that was looked at, in the place of one that is to be stored.

    Attributes:
        least, greatest: of its own voxels.
        entropy_bits: of the values' histogram.
        voxels: its own, without padding; none where nobody wants to keep them.
    """

    least: float = 0.0
    greatest: float = 0.0
    entropy_bits: float = 0.0
    nvoxels: int = 0
    voxels: Voxels = field(default_factory=lambda: np.zeros((0, 0, 0)))


@dataclass(frozen=True, slots=True)
class _Look:
    """In the place of an encoder: takes note of a brick, or keeps it."""

    brick: int
    keep: bool

    def encode(self, voxels: Voxels, _low: Any, _high: Any) -> EncodedBrick:
        """See `BrickEncoder.encode`; the range there is one voxel wider."""
        if self.keep:
            return SeenBrick(None, voxels=voxels.copy(), nvoxels=voxels.size)
        least, greatest = float(voxels.min()), float(voxels.max())
        entropy = 0.0 if least == greatest else entropy_bits(voxels, least, greatest)
        return SeenBrick(
            None,
            least=least,
            greatest=greatest,
            entropy_bits=entropy,
            nvoxels=voxels.size,
        )


class BrickPass:
    """Reads places of a source, brick by brick.

    Args:
        source: with voxels as they are stored.
        places: in reading order.
        replace_nonfinite: what stands for NaN and ±Inf; None refuses them.
        executor: looks at bricks.
    """

    def __init__(
        self,
        source: Source,
        places: Sequence[Place],
        replace_nonfinite: float | None,
        executor: Executor,
    ) -> None:
        self._source = source
        self._places = places
        self._replacement = replace_nonfinite
        self._executor = executor
        self.histogram = metrics.Histogram()

    def run(
        self, wanted: Callable[[BrickKey], bool], *, keep: bool
    ) -> Generator[tuple[BrickKey, SeenBrick], None, None]:
        """The bricks that are wanted, z slowest, x fastest; channels a layer each in turn.

        Places without one are not read.

        Args:
            wanted: says which.
            keep: give their voxels, and no figures; else the figures alone, and `histogram` adds
                up the values of all bricks that are read.

        Raises:
            NotFiniteError, SourceError: as reading raises them.
        """
        for index, place in enumerate(self._places):
            box, shape = place.box, place.box.shape_zyx
            whole = shape == self._source.shape_zyx
            region = self._source if whole else RegionSource(self._source, box)
            reader = PieceReader(region, self._replacement, BRICK)
            plan = PyramidPlan(
                shapes_zyx=(shape,),
                dtype=self._source.dtype,
                encoders=[_Look(BRICK, keep)],
                reducer="mean",
                spacing_zyx=self._source.spacing_zyx,
                directions=None,
                source_nplanes=reader.nplanes,
                make_window=memory_window,
                nahead=_AHEAD_BRICKS,
            )
            sink = _Sink(index, wanted)
            pyramids = [
                Pyramid(plan, place.t, c, self._executor, sink) for c in range(self._source.nc)
            ]
            for piece in reader.pieces(place.t, 0):
                feed(pyramids, piece)
                if not keep:
                    self.histogram = metrics.Histogram.total_of([self.histogram, *sink.counted])
                sink.counted.clear()
                yield from sink.taken
                sink.taken.clear()


def brick_box(places: Sequence[Place], key: BrickKey) -> Box:
    """Where a brick lies in the source."""
    place = places[key.place].box
    (z, y, x) = place.start_zyx
    return cell_box(key.zyx, (BRICK,) * 3).shift((z, y, x)).intersect(place)


class _Sink:
    """Takes what is wanted; a `Sink` of the pyramid."""

    def __init__(self, place: int, wanted: Callable[[BrickKey], bool]) -> None:
        self._place = place
        self._wanted = wanted
        self.taken: list[tuple[BrickKey, SeenBrick]] = []
        self.counted: list[metrics.Histogram] = []

    def wants(self, address: Address) -> bool:
        return self._wanted(self._key(address))

    def take(self, address: Address, encoded: EncodedBrick) -> None:
        assert isinstance(encoded, SeenBrick)
        self.taken.append((self._key(address), encoded))

    def count(self, _t: int, _c: int, histogram: metrics.Histogram) -> None:
        self.counted.append(histogram)

    def end_layer(self, array: str, t: int, c: int, index: int) -> None:
        pass

    def _key(self, address: Address) -> BrickKey:
        return BrickKey(self._place, address.c, address.zyx)


def entropy_bits(voxels: Voxels, low: float, high: float) -> float:
    """Shannon's entropy of a brick's histogram of at most 1024 bins, in bits a voxel."""
    counts = metrics.histogram(voxels, low, high).counts
    shares = counts[counts > 0] / voxels.size
    return float(-(shares * np.log2(shares)).sum())
