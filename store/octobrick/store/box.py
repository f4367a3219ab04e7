"""Boxes of voxels and the brick grid: integer geometry that every layer shares."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from octobrick.codec.errors import InvalidInputError

Zyx = tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class Box:
    """A half-open box of voxels, ``start_zyx`` up to but without ``stop_zyx``."""

    start_zyx: Zyx
    stop_zyx: Zyx

    @classmethod
    def of_shape(cls, shape_zyx: Zyx) -> Box:
        """The box that a whole array of this shape fills."""
        return cls((0, 0, 0), shape_zyx)

    @property
    def shape_zyx(self) -> Zyx:
        """Voxels along each axis; 0 where the box is empty."""
        (z0, y0, x0), (z1, y1, x1) = self.start_zyx, self.stop_zyx
        return (max(0, z1 - z0), max(0, y1 - y0), max(0, x1 - x0))

    @property
    def slices(self) -> tuple[slice, slice, slice]:
        """The index that selects this box from an array."""
        (z0, y0, x0), (z1, y1, x1) = self.start_zyx, self.stop_zyx
        return (slice(z0, z1), slice(y0, y1), slice(x0, x1))

    @property
    def nvoxels(self) -> int:
        """How many voxels the box holds."""
        nz, ny, nx = self.shape_zyx
        return nz * ny * nx

    def intersect(self, other: Box) -> Box:
        """The voxels in both boxes; an empty box where they do not meet."""
        start = _zip(max, self.start_zyx, other.start_zyx)
        stop = _zip(min, self.stop_zyx, other.stop_zyx)
        return Box(start, _zip(max, start, stop))

    def grow(self, margin: int) -> Box:
        """The box with ``margin`` voxels more on every side (not clipped to anything)."""
        (z0, y0, x0), (z1, y1, x1) = self.start_zyx, self.stop_zyx
        return Box((z0 - margin, y0 - margin, x0 - margin), (z1 + margin, y1 + margin, x1 + margin))

    def shift(self, offset_zyx: Zyx) -> Box:
        """The box moved by an offset."""
        (z0, y0, x0), (z1, y1, x1), (dz, dy, dx) = self.start_zyx, self.stop_zyx, offset_zyx
        return Box((z0 + dz, y0 + dy, x0 + dx), (z1 + dz, y1 + dy, x1 + dx))

    def require_within(self, shape_zyx: Zyx, what: str) -> None:
        """Refuse a box that is empty or leaves ``[0, shape)``.

        Raises:
            InvalidInputError: naming the box, the shape and what was asked for.
        """
        inside = all(
            0 <= a < b <= n
            for a, b, n in zip(self.start_zyx, self.stop_zyx, shape_zyx, strict=True)
        )
        if not inside:
            raise InvalidInputError(
                f"{what}: box {self.start_zyx} to {self.stop_zyx} (z, y, x) is empty or leaves "
                f"the volume of {shape_zyx} voxels; choose 0 <= start < stop <= shape on each axis",
                start_zyx=list(self.start_zyx),
                stop_zyx=list(self.stop_zyx),
                shape_zyx=list(shape_zyx),
            )


def ceil_div(a: int, b: int) -> int:
    """``a / b`` rounded up, for non-negative ``a`` and positive ``b``."""
    return -(-a // b)


def grid_of(shape_zyx: Zyx, cell_zyx: Zyx) -> Zyx:
    """How many cells (bricks, shards) it takes to cover a shape, the last ones cut or padded."""
    return _zip(ceil_div, shape_zyx, cell_zyx)


def cell_box(cell: Zyx, cell_zyx: Zyx) -> Box:
    """The voxels of one grid cell, not clipped to the volume."""
    start = _zip(lambda i, n: i * n, cell, cell_zyx)
    return Box(start, _zip(lambda a, n: a + n, start, cell_zyx))


def cells_touching(box: Box, cell_zyx: Zyx) -> Iterator[Zyx]:
    """The grid cells that hold at least one voxel of the box, z slowest, x fastest."""
    (z0, y0, x0) = _zip(lambda a, n: a // n, box.start_zyx, cell_zyx)
    (z1, y1, x1) = _zip(ceil_div, box.stop_zyx, cell_zyx)
    for z in range(z0, z1):
        for y in range(y0, y1):
            for x in range(x0, x1):
                yield (z, y, x)


def _zip(function, a: Zyx, b: Zyx) -> Zyx:  # type: ignore[no-untyped-def]
    z, y, x = (function(i, j) for i, j in zip(a, b, strict=True))
    return (z, y, x)
