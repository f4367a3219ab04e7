"""The part of a volume that is drawn: all of a small one, else what there is most to see of."""

from __future__ import annotations

import numpy as np

from octobrick.measure.scan import Scan
from octobrick.store.box import Box, Zyx

SIDE = 256
"""Voxels along an axis, at most, of the part of a volume of more than `SIDE`³."""


def drawn_box(scan: Scan, shape_zyx: Zyx) -> Box:
    """Which voxels are drawn, at full resolution.

    Of a large volume it is a box around the centre of what is informative: of the bricks of the
    first time step and channel, each counted by its entropy.
    """
    whole = Box.of_shape(shape_zyx)
    if whole.nvoxels <= SIDE**3:
        return whole
    bricks = [brick for brick in scan.bricks if _is_first(scan, brick.key.place, brick.key.c)]
    weights = np.array([brick.nvoxels * brick.entropy_bits for brick in bricks])
    middle = np.array(shape_zyx) / 2
    if weights.sum() > 0:
        boxes = [scan.box_of(brick) for brick in bricks]
        centres = np.array([np.add(box.start_zyx, box.stop_zyx) / 2 for box in boxes])
        middle = (weights[:, np.newaxis] * centres).sum(axis=0) / weights.sum()
    spans = [_span(float(at), n) for at, n in zip(middle, shape_zyx, strict=True)]
    (z, y, x) = spans
    return Box((z[0], y[0], x[0]), (z[1], y[1], x[1]))


def _span(middle: float, n: int) -> tuple[int, int]:
    """So many voxels around a position, inside of an axis."""
    length = min(n, SIDE)
    start = min(max(round(middle - length / 2), 0), n - length)
    return start, start + length


def _is_first(scan: Scan, place: int, c: int) -> bool:
    return scan.places[place].t == 0 and c == 0
