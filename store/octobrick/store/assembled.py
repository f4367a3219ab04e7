"""A box of a level put together from the bricks that it touches."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numpy.typing import NDArray

from octobrick.store.box import Box, Zyx, cell_box, cells_touching


def fill_from_bricks(
    out: NDArray[Any], box: Box, brick_zyx: Zyx, brick: Callable[[Zyx], NDArray[Any]]
) -> None:
    """Fill an array with the voxels of a box.

    Args:
        out: (z, y, x, …) of the box's shape.
        box: of the level.
        brick_zyx: voxels per brick.
        brick: gives a brick, of its full shape, by its place in the grid.
    """
    z, y, x = box.start_zyx
    for place in cells_touching(box, brick_zyx):
        own = cell_box(place, brick_zyx)
        wanted, (bz, by, bx) = own.intersect(box), own.start_zyx
        voxels = brick(place)
        out[wanted.shift((-z, -y, -x)).slices] = voxels[wanted.shift((-bz, -by, -bx)).slices]
