"""What shows a brick that is not there yet: a part of a coarser one. Pure, for every filler.

Levels halve: voxel i of a level covers voxels 2i and 2i + 1 of the finer one. As bricks have the
same shape on all levels, one brick of a coarser level covers all of a finer level's brick.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.store.box import Box, Zyx


def ancestor(brick_zyx: Zyx, nlevels_up: int) -> Zyx:
    """The brick of a coarser level that covers a brick."""
    z, y, x = brick_zyx
    return (z >> nlevels_up, y >> nlevels_up, x >> nlevels_up)


def covering(box: Box, nlevels_up: int) -> Box:
    """The voxels of a coarser level that cover a box of voxels."""
    (z0, y0, x0), (z1, y1, x1) = box.start_zyx, box.stop_zyx
    n = nlevels_up
    return Box((z0 >> n, y0 >> n, x0 >> n), (-(-z1 >> n), -(-y1 >> n), -(-x1 >> n)))


def nlevels_up_held(
    brick_zyx: Zyx, level: int, nlevels: int, held: Callable[[int, Zyx], bool]
) -> int | None:
    """How far up the finest coarser level is that holds an ancestor; None where none does.

    Args:
        brick_zyx: of the level.
        level: whose brick is missing.
        nlevels: of the pyramid.
        held: whether a brick of a level is at hand, absent ones included.
    """
    ups = range(1, nlevels - level)
    return next((n for n in ups if held(level + n, ancestor(brick_zyx, n))), None)


def enlarged(coarse: NDArray[Any], box: Box, nlevels_up: int) -> NDArray[Any]:
    """The voxels of a box, each the one that covers it.

    Args:
        coarse: (z, y, x, …) of `covering(box, nlevels_up)`.
        box: of the finer level.
        nlevels_up: how much coarser.
    """
    for axis, (start, stop) in enumerate(zip(box.start_zyx, box.stop_zyx, strict=True)):
        at = (np.arange(start, stop) >> nlevels_up) - (start >> nlevels_up)
        coarse = coarse.take(at, axis)
    return coarse
