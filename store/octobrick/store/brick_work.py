"""All that is made of one brick while its voxels are in the processor's cache."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import gradients, metrics
from octobrick.store.box import Box
from octobrick.store.brick_encoder import EncodedBrick
from octobrick.store.reducers import Reducer

Voxels = NDArray[np.generic]


class Encoder(Protocol):
    """What makes of a brick what a sink takes."""

    @property
    def brick(self) -> int:
        """Voxels per brick and axis."""

    def encode(self, voxels: Voxels, low: Any, high: Any) -> EncodedBrick:
        """See `BrickEncoder.encode`."""


@dataclass(frozen=True, slots=True)
class BrickResult:
    """What became of a brick.

    Attributes:
        encoded: to be stored; None where nobody wanted it.
        histogram: of its own voxels; of level 0 only.
        coarser: its voxels at half resolution; None on the coarsest level.
        directions: codes (z, y, x, 3) of its gradient at half resolution, a quarter, …
        gradient: the last of these before it was coded, from which coarser ones are made.
    """

    encoded: EncodedBrick | None
    histogram: metrics.Histogram | None
    coarser: Voxels | None
    directions: tuple[gradients.DirectionCodes, ...]
    gradient: gradients.Vectors | None


@dataclass(frozen=True, slots=True)
class BrickWork:
    """What is to be made of the bricks of one level. Immutable, so many threads can share one.

    Args:
        encoder: of its bricks.
        reducer: makes the coarser level; None on the coarsest.
        has_histogram: whether values are counted.
        spacing_zyx: world size of a voxel.
        ngradients: how many levels of gradients are made from a brick alone.
    """

    encoder: Encoder
    reducer: Reducer | None
    has_histogram: bool
    spacing_zyx: tuple[float, float, float]
    ngradients: int

    def run(self, get_around: Callable[[], Voxels], core: Box, *, is_wanted: bool) -> BrickResult:
        """Do it for one brick.

        Args:
            get_around: gives its voxels and those one voxel around it, as far as the level goes.
            core: where its own voxels lie in them.
            is_wanted: whether it is to be encoded.
        """
        around = get_around()
        voxels = around[core.slices]
        low, high = around.min(), around.max()
        directions, gradient = self._gradients(around, core)
        return BrickResult(
            self.encoder.encode(voxels, low, high) if is_wanted else None,
            metrics.histogram(voxels, low, high) if self.has_histogram else None,
            None if self.reducer is None else self.reducer(voxels),
            directions,
            gradient,
        )

    def _gradients(
        self, around: Voxels, core: Box
    ) -> tuple[tuple[gradients.DirectionCodes, ...], gradients.Vectors | None]:
        directions: list[gradients.DirectionCodes] = []
        gradient: gradients.Vectors | None = None
        for _ in range(self.ngradients):
            gradient = (
                gradients.reduced_differences(
                    around,
                    self.spacing_zyx,
                    start_zyx=core.start_zyx,
                    shape_zyx=core.shape_zyx,
                    threads=1,
                )
                if gradient is None
                else gradients.reduce(gradient, threads=1)
            )
            directions.append(gradients.encode_directions(gradient, threads=1))
        return tuple(directions), gradient
