"""A box of a level put together from the bricks that it touches."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from numpy.typing import NDArray

from octobrick.store.box import Box, Zyx, cell_box


def fill_from_bricks(
    out: NDArray[Any], box: Box, brick_zyx: Zyx, bricks: Iterable[tuple[Zyx, NDArray[Any]]]
) -> None:
    """Fill an array with the voxels of a box.

    Args:
        out: (z, y, x, …) of the box's shape.
        box: of the level.
        brick_zyx: voxels per brick.
        bricks: all that the box touches, in any order: place in the grid, and voxels of the full
            shape. One at a time is held here.
    """
    z, y, x = box.start_zyx
    for place, voxels in bricks:
        own = cell_box(place, brick_zyx)
        wanted, (bz, by, bx) = own.intersect(box), own.start_zyx
        out[wanted.shift((-z, -y, -x)).slices] = voxels[wanted.shift((-bz, -by, -bx)).slices]
