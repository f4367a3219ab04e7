"""What there is to choose from: range and entropy of every brick that was looked at."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass

from octobrick.codec import metrics
from octobrick.measure.brick_pass import BRICK, BrickKey, BrickPass, Place, brick_box
from octobrick.measure.reference import Reference
from octobrick.store.box import Box, grid_of
from octobrick.store.ingest_finish import shown_window
from octobrick.store.probes import SMALL_NVOXELS, regions
from octobrick.store.sources import Source


@dataclass(frozen=True, slots=True)
class BrickFacts:
    """What is known of a brick without coding it."""

    key: BrickKey
    nvoxels: int
    least: float
    greatest: float
    entropy_bits: float

    @property
    def range(self) -> float:
        """Greatest less least voxel."""
        return self.greatest - self.least


@dataclass(frozen=True, slots=True)
class Scan:
    """All bricks that were looked at.

    Attributes:
        places: that were to be read.
        bricks: in the order of reading.
        nbricks, nvoxels: of level 0, in all time steps and channels.
        value_range: least and greatest voxel.
        range_of: "all voxels", or "estimated from N of M bricks".
        window: values worth showing, as an ingest finds them.
    """

    places: tuple[Place, ...]
    bricks: tuple[BrickFacts, ...]
    nbricks: int
    nvoxels: int
    value_range: tuple[float, float]
    range_of: str
    window: tuple[float, float]

    @property
    def peak(self) -> float:
        """Of a PSNR: greatest less least voxel."""
        low, high = self.value_range
        return high - low

    @property
    def whole(self) -> bool:
        """Whether every brick was looked at."""
        return len(self.bricks) == self.nbricks

    def box_of(self, brick: BrickFacts) -> Box:
        """Where a brick lies in the volume."""
        return brick_box(self.places, brick.key)


def scan(
    reference: Reference,
    executor: Executor,
    *,
    full: bool,
    over: Callable[[], bool],
    report: Callable[[float], None],
) -> Scan:
    """Look at all bricks, or at those of a sixteenth of a large source, spread over it.

    Args:
        reference: what is measured.
        executor: looks at bricks.
        full: look at all, however many.
        over: whether time is; what was not seen then is left out.
        report: told what share was seen.

    Raises:
        NotFiniteError, SourceError: as reading raises them.
    """
    source = reference.source
    nvoxels = source.nt * source.nc * math.prod(source.shape_zyx)
    if full or nvoxels <= SMALL_NVOXELS:
        places = tuple(Place(t, Box.of_shape(source.shape_zyx)) for t in range(source.nt))
    else:
        places = tuple(Place(t, box) for t, box in regions(source, BRICK))
    wanted_nvoxels = source.nc * sum(place.box.nvoxels for place in places)
    run = BrickPass(source, places, reference.options.replace_nonfinite, executor)
    found, seen_nvoxels = [], 0
    passing = run.run(lambda _: True, keep=False)
    for key, seen in passing:
        found.append(BrickFacts(key, seen.nvoxels, seen.least, seen.greatest, seen.entropy_bits))
        seen_nvoxels += seen.nvoxels
        report(seen_nvoxels / wanted_nvoxels)
        if not full and over():
            passing.close()
            break
    return _scan(reference, places, found, run.histogram)


def _scan(
    reference: Reference,
    places: tuple[Place, ...],
    found: list[BrickFacts],
    histogram: metrics.Histogram,
) -> Scan:
    source = reference.source
    nbricks = nbricks_of(source)
    least, greatest = min(b.least for b in found), max(b.greatest for b in found)
    range_of = "all voxels"
    if reference.volume is not None:
        least, greatest = map(float, reference.volume.value_range)
    elif len(found) < nbricks:
        range_of = f"estimated from {len(found)} of {nbricks} bricks"
    low, high = reference.volume.window if reference.volume else (least, greatest)
    if reference.volume is None:
        number = float if source.dtype.kind == "f" else int
        low, high = shown_window([histogram], (number(least), number(greatest)))
    return Scan(
        places=places,
        bricks=tuple(found),
        nbricks=nbricks,
        nvoxels=source.nt * source.nc * math.prod(source.shape_zyx),
        value_range=(least, greatest),
        range_of=range_of,
        window=(float(low), float(high)),
    )


def nbricks_of(source: Source) -> int:
    """How many bricks level 0 has, in all time steps and channels."""
    return source.nt * source.nc * math.prod(grid_of(source.shape_zyx, (BRICK,) * 3))
