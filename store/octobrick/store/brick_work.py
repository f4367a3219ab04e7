"""All that is made of one brick while its voxels are in the processor's cache."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import gradients, metrics
from octobrick.store.box import Box, Zyx, cell_box
from octobrick.store.brick_encoder import BrickEncoder, EncodedBrick
from octobrick.store.reducers import Reducer

Voxels = NDArray[np.generic]


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
        shape_zyx: voxels of the level.
        encoder: of its bricks.
        reducer: makes the coarser level; None on the coarsest.
        has_histogram: whether values are counted.
        spacing_zyx: world size of a voxel.
        ngradients: how many levels of gradients are made from a brick alone.
    """

    shape_zyx: Zyx
    encoder: BrickEncoder
    reducer: Reducer | None
    has_histogram: bool
    spacing_zyx: tuple[float, float, float]
    ngradients: int

    def box(self, brick_zyx: Zyx) -> Box:
        """The voxels of a brick that the level has."""
        return cell_box(brick_zyx, (self.encoder.brick,) * 3).intersect(self._level_box)

    def around(self, brick_zyx: Zyx) -> Box:
        """The same with those one voxel beyond, where the level goes on."""
        return self.box(brick_zyx).grow(1).intersect(self._level_box)

    def run(self, brick_zyx: Zyx, around: Voxels, *, is_wanted: bool) -> BrickResult:
        """Do it for one brick.

        Args:
            brick_zyx: which.
            around: the voxels of the box that `around` gave.
            is_wanted: whether it is to be encoded.
        """
        z, y, x = self.around(brick_zyx).start_zyx
        core = self.box(brick_zyx).shift((-z, -y, -x))
        voxels = around[core.slices]
        encoded = self.encoder.encode(around, core) if is_wanted else None
        directions, gradient = self._gradients(around, core)
        return BrickResult(
            encoded,
            metrics.histogram(voxels, voxels.min(), voxels.max()) if self.has_histogram else None,
            None if self.reducer is None else self.reducer(voxels),
            directions,
            gradient,
        )

    @property
    def _level_box(self) -> Box:
        return Box.of_shape(self.shape_zyx)

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
