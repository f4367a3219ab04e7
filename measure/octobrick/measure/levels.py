"""What a coarser level costs: its voxels, spread over level 0's, against these."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import metrics, reduce
from octobrick.measure.measurement import LevelRow
from octobrick.measure.sample import SampleBrick
from octobrick.store.box import Box, Zyx

Voxels = NDArray[np.generic]

LEVELS = (1, 2, 3)
_MARGIN = 8  # voxels of level 0 that level 3 needs beside a brick's own; a multiple of 2³


class LevelTally:
    """Adds up bricks at coarser levels, each by its weight.

    Args:
        shape_zyx: of the volume.
    """

    def __init__(self, shape_zyx: Zyx) -> None:
        self._shape_zyx = shape_zyx
        self._count = dict.fromkeys(LEVELS, 0.0)
        self._squares = dict.fromkeys(LEVELS, 0.0)
        self._worst = dict.fromkeys(LEVELS, 0.0)

    def add(self, bricks: Iterable[SampleBrick]) -> None:
        """Take note of bricks.

        Voxels beside another brick are left out, since interpolation would need that one's: what
        is compared is what the whole volume would give.
        """
        for brick in bricks:
            inner = self._inner(brick.box)
            if inner is None:
                continue
            coarse, shapes = brick.voxels, [brick.voxels.shape]
            for level in LEVELS:
                coarse = reduce.mean2(coarse)
                shown = coarse
                for shape in reversed(shapes):
                    shown = reduce.upsample2(shown, shape)
                shapes.append(coarse.shape)
                errors = metrics.compare(brick.voxels[inner.slices], shown[inner.slices])
                self._count[level] += brick.weight * errors.count
                self._squares[level] += brick.weight * errors.sum_squared
                self._worst[level] = max(self._worst[level], errors.max_abs)

    def rows(self, peak: float) -> tuple[LevelRow, ...]:
        """The figures of each level; none where no brick had a voxel to tell from."""
        rows = []
        for level in LEVELS:
            if not self._count[level]:
                continue
            mean_squared = self._squares[level] / self._count[level]
            errors = metrics.ErrorStats(1, self._worst[level], mean_squared)
            rows.append(
                LevelRow(
                    level=level,
                    psnr_db=None if errors.max_abs == 0 else errors.psnr(peak),
                    max_error=float(errors.max_abs),
                    rmse=errors.rmse,
                )
            )
        return tuple(rows)

    def _inner(self, box: Box) -> Box | None:
        """The part of a brick that needs no other, in its own voxels."""
        inner = Box(
            tuple(0 if a == 0 else _MARGIN for a in box.start_zyx),  # type: ignore[arg-type]
            tuple(  # type: ignore[arg-type]
                n - (0 if b == end else _MARGIN)
                for n, b, end in zip(box.shape_zyx, box.stop_zyx, self._shape_zyx, strict=True)
            ),
        ).intersect(Box.of_shape(box.shape_zyx))
        return inner if inner.nvoxels else None
