"""The part of a texture that a surface needs: tiles of it, with what interpolation reads around.

A tile is 16³ texels, zerobit's unit block, and one texel on every side: so any sample in it reads
no other tile.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from octobrick.renderer.brick_source import BrickSource
from octobrick.renderer.host_decoder import HostDecoder
from octobrick.store.box import Box, Zyx, cell_box, cells_touching, grid_of
from octobrick.store.surface import Mesh, Placement
from octobrick.store.surface.selection import DILATION_VOXELS, voxel_places
from octobrick.store.surface.touched_cells import touched_cells

TILE: Final = 16
BORDER: Final = 1
_DECODED_NBYTES_MAX: Final = 256 * 2**20
"""Of decoded bricks that are kept while tiles are cut from them and their neighbours."""

Voxels = NDArray[Any]


@dataclass(frozen=True, slots=True)
class TileSet:
    """The tiles of a level that a placed surface touches.

    Attributes:
        level: of the pyramid.
        shape_zyx: its voxels.
        tile: texels along each side, without the border.
        tiles_zyx: (n, 3), in ascending order.
    """

    level: int
    shape_zyx: Zyx
    tile: int
    tiles_zyx: NDArray[np.int64]

    @property
    def grid_zyx(self) -> Zyx:
        """How many tiles the whole level has."""
        return grid_of(self.shape_zyx, (self.tile,) * 3)

    def bricks_zyx(self, brick_zyx: Zyx) -> set[Zyx]:
        """The bricks whose voxels lie in the tiles, without borders."""
        found: set[Zyx] = set()
        for at in self.tiles_zyx.tolist():
            box = cell_box((at[0], at[1], at[2]), (self.tile,) * 3)
            found.update(cells_touching(box.intersect(Box.of_shape(self.shape_zyx)), brick_zyx))
        return found


def touched_tiles(
    volume: BrickSource, mesh: Mesh, placement: Placement, level: int, tile: int = TILE
) -> TileSet:
    """The tiles of a level in which a placed mesh has a place, or would if it were clamped.

    Raises:
        InvalidInputError: the mesh lies too far away, or is too much work.
    """
    shape_zyx = volume.levels[level].shape_zyx
    places = voxel_places(mesh, placement, volume.levels[0].spacing_xyz[::-1], level)
    margin = DILATION_VOXELS / tile
    grid = grid_of(shape_zyx, (tile,) * 3)
    tiles = touched_cells(places[mesh.faces] / tile, grid, margin)
    return TileSet(level, shape_zyx, tile, tiles)


class TileReader:
    """Cuts tiles out of bricks of one time step, each of which is decoded once or little more.

    Args:
        volume: whose bricks.
        level: of the pyramid.
        t: time step.
        c: channel.
    """

    def __init__(self, volume: BrickSource, level: int, t: int, c: int) -> None:
        self._volume, self._level, self._t, self._c = volume, level, t, c
        self._decoder = HostDecoder(volume, level)
        self._whole = Box.of_shape(volume.levels[level].shape_zyx)
        brick_nbytes = int(np.prod(volume.brick_shape_zyx)) * self._decoder.dtype.itemsize
        self._nkept = max(8, _DECODED_NBYTES_MAX // brick_nbytes)
        self._bricks: OrderedDict[Zyx, Voxels | None] = OrderedDict()
        self.nread = self.nabsent = 0

    def tiles(self, tiles: TileSet) -> Iterable[Voxels]:
        """The voxels of each tile, with its border, (tile + 2)³; the level's last are repeated.

        Raises:
            CorruptBrickError: naming the brick.
        """
        for at in tiles.tiles_zyx.tolist():
            box = cell_box((at[0], at[1], at[2]), (tiles.tile,) * 3).grow(BORDER)
            part = box.intersect(self._whole)
            before = np.subtract(part.start_zyx, box.start_zyx)
            after = np.subtract(box.stop_zyx, part.stop_zyx)
            yield np.pad(self._read(part), list(zip(before, after, strict=True)), mode="edge")

    def _read(self, box: Box) -> Voxels:
        out = np.empty(box.shape_zyx, self._decoder.dtype)
        for brick_zyx in cells_touching(box, self._volume.brick_shape_zyx):
            own = cell_box(brick_zyx, self._volume.brick_shape_zyx)
            part = own.intersect(box)
            voxels = self._brick(brick_zyx)
            inside = part.shift(_negative(own.start_zyx)).slices
            value = self._volume.fill_value if voxels is None else voxels[inside]
            out[part.shift(_negative(box.start_zyx)).slices] = value
        return out

    def _brick(self, zyx: Zyx) -> Voxels | None:
        if zyx in self._bricks:
            self._bricks.move_to_end(zyx)
            return self._bricks[zyx]
        code = self._volume.brick_code(self._level, zyx, self._t, self._c)
        voxels: Voxels | None = None
        self.nread += 1
        if code is None:
            self.nabsent += 1
        else:
            shape = self._volume.brick_shape_zyx
            voxels = np.empty(shape, self._decoder.dtype)
            self._decoder.decode(code, zyx, Box.of_shape(shape), voxels)
        self._bricks[zyx] = voxels
        if len(self._bricks) > self._nkept:
            self._bricks.popitem(last=False)
        return voxels


def _negative(zyx: Zyx) -> Zyx:
    z, y, x = zyx
    return (-z, -y, -x)
