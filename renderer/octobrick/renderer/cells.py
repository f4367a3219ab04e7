"""The grid of cells in which empty space is told from matter: small boxes of base voxels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, cast

from octobrick.store.box import Box, Zyx, ceil_div

CELL_MAX: Final = 8
"""Edge of the largest cell. Measured on llvmpipe: a frame costs a quarter more with 4, and a third
more with 16 (docs/adr/0002)."""


@dataclass(frozen=True, slots=True)
class CellGrid:
    """The cells that touch a slab's content.

    Attributes:
        cell_zyx: voxels of a cell.
        cells: which cells, counted from the level's first.
    """

    cell_zyx: Zyx
    cells: Box

    @classmethod
    def of(cls, brick_zyx: Zyx, content: Box) -> CellGrid:
        """The grid for a slab that holds these voxels."""
        cell = cell_shape(brick_zyx)
        return cls(cell, bricks_of(content, cell))

    def bricks(self, brick_zyx: Zyx) -> Box:
        """The bricks that the cells are in; no cell is in two."""
        start, stop = (
            tuple(i * n for i, n in zip(corner, self.cell_zyx, strict=True))
            for corner in (self.cells.start_zyx, self.cells.stop_zyx)
        )
        return bricks_of(Box(cast("Zyx", start), cast("Zyx", stop)), brick_zyx)

    @property
    def size_xyz(self) -> tuple[int, int, int]:
        """Cells along each axis."""
        z, y, x = self.cells.shape_zyx
        return (x, y, z)

    @property
    def origin_xyz(self) -> tuple[int, int, int]:
        """The first cell."""
        z, y, x = self.cells.start_zyx
        return (x, y, z)


def bricks_of(box: Box, brick_zyx: Zyx) -> Box:
    """The bricks (or cells) that hold at least one voxel of a box that is not empty."""
    (z0, y0, x0), (z1, y1, x1), (bz, by, bx) = box.start_zyx, box.stop_zyx, brick_zyx
    stop = (ceil_div(z1, bz), ceil_div(y1, by), ceil_div(x1, bx))
    return Box((z0 // bz, y0 // by, x0 // bx), stop)


def cell_shape(brick_zyx: Zyx) -> Zyx:
    """The largest divisors of the brick up to CELL_MAX.

    A cell must not straddle bricks, of which one may not be decoded. An edge without a divisor of
    at least half of CELL_MAX, such as a large prime, is one cell.
    """
    z, y, x = (
        next((d for d in range(CELL_MAX, CELL_MAX // 2 - 1, -1) if edge % d == 0), edge)
        for edge in brick_zyx
    )
    return (z, y, x)
