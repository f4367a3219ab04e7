"""The tiles of a texture on the GPU, and a table of where each of them lies."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from octobrick.renderer.errors import PictureTooLargeError
from octobrick.renderer.solid_texture.mesh_request import MeshRequest
from octobrick.renderer.solid_texture.texture_tiles import BORDER, TileReader, TileSet

if TYPE_CHECKING:
    import moderngl

ATLAS_UNIT: Final = 0
TABLE_UNIT: Final = 1
_TEXEL_NBYTES: Final = 4  # RGBA of 8 bits, or one float32
_ENTRY_NBYTES: Final = 4


@dataclass(frozen=True, slots=True)
class AtlasLayout:
    """How tiles are put into a 3D texture.

    Attributes:
        slots_xyz: how many lie along each axis.
        side: texels along each side of a slot, borders too.
        nbytes: of texels and table.
    """

    slots_xyz: tuple[int, int, int]
    side: int
    nbytes: int

    @classmethod
    def of(cls, tiles: TileSet, side_max: int) -> AtlasLayout | None:
        """The layout, about a cube; None if the driver's textures are too small."""
        side, count = tiles.tile + 2 * BORDER, max(1, len(tiles.tiles_zyx))
        most = side_max // side
        nx = min(most, math.ceil(count ** (1 / 3)))
        if nx == 0 or max(tiles.grid_zyx) > side_max:
            return None
        ny = min(most, math.ceil(math.sqrt(count / nx)))
        nz = math.ceil(count / (nx * ny))
        if nz > most:
            return None
        nbytes = nx * ny * nz * side**3 * _TEXEL_NBYTES
        return cls((nx, ny, nz), side, nbytes + math.prod(tiles.grid_zyx) * _ENTRY_NBYTES)


class TextureAtlas:
    """The tiles of one level on the GPU.

    Args:
        gl: the context, current in this thread.
        request: of which picture.
        tiles: which.
        layout: what `AtlasLayout.of` gave.

    Raises:
        CorruptBrickError: a brick is damaged.
        PictureTooLargeError: the driver has no room.
    """

    def __init__(
        self, gl: moderngl.Context, request: MeshRequest, tiles: TileSet, layout: AtlasLayout
    ) -> None:
        self.tiles, self.layout = tiles, layout
        self.nread = self.nabsent = 0
        texels = self._texels(request)
        size_xyz = texels.shape[2::-1]
        try:
            self._atlas = gl.texture3d(
                size_xyz, texels.shape[3], texels, alignment=1, dtype=_gl_type(texels)
            )
            self._table = gl.texture3d(
                tiles.grid_zyx[::-1], 1, self._slots(), alignment=1, dtype="u4"
            )
        except Exception as error:  # moderngl.Error, which need not be importable here
            raise PictureTooLargeError(
                f"the driver has no room for a texture of {layout.nbytes} bytes: {error}; render "
                "a coarser level",
                nbytes=layout.nbytes,
            ) from error
        self._table.filter = (gl.NEAREST, gl.NEAREST)

    @property
    def nbytes(self) -> int:
        """On the GPU."""
        return self.layout.nbytes

    def sample_by(self, gl: moderngl.Context, name: str) -> None:
        """Sample as this name says from now on."""
        mode = gl.LINEAR if name == "linear" else gl.NEAREST
        self._atlas.filter = (mode, mode)

    def use(self) -> dict[str, Any]:
        """Bind both textures; gives the uniforms that say how they lie."""
        self._atlas.use(ATLAS_UNIT)
        self._table.use(TABLE_UNIT)
        return {
            "atlas": ATLAS_UNIT,
            "slot_of_tile": TABLE_UNIT,
            "slots": self.layout.slots_xyz[:2],
            "level_size": self.tiles.shape_zyx[::-1],
        }

    def release(self) -> None:
        """Free both textures."""
        self._atlas.release()
        self._table.release()

    def _slots(self) -> NDArray[np.uint32]:
        """One more than the slot of each tile; 0 of those that are not there."""
        table = np.zeros(self.tiles.grid_zyx, np.uint32)
        table[tuple(self.tiles.tiles_zyx.T)] = np.arange(1, len(self.tiles.tiles_zyx) + 1)
        return table

    def _texels(self, request: MeshRequest) -> NDArray[Any]:
        """(z, y, x, 4) of uint8, or (z, y, x, 1) of float32 for a transfer function."""
        (nx, ny, nz), side = self.layout.slots_xyz, self.layout.side
        as_colours = request.function is None
        shape = (nz, side, ny, side, nx, side, 4 if as_colours else 1)
        texels: NDArray[Any] = np.zeros(shape, np.uint8 if as_colours else np.float32)
        for component, (c, window) in enumerate(
            zip(request.channels, request.windows, strict=True)
        ):
            reader = TileReader(request.volume, self.tiles.level, request.t, c)
            for slot, voxels in enumerate(reader.tiles(self.tiles)):
                z, y, x = slot // (nx * ny), slot // nx % ny, slot % nx
                texels[z, :, y, :, x, :, component] = _relative(voxels, window, as_colours)
            self.nread += reader.nread
            self.nabsent += reader.nabsent
        return texels.reshape(nz * side, ny * side, nx * side, -1)


def _relative(voxels: NDArray[Any], window: tuple[float, float], as_colours: bool) -> NDArray[Any]:
    """Values as parts of a window: in 255ths, cut off at its ends; or as they are."""
    low, high = window
    if as_colours and voxels.dtype == np.uint8 and (low, high) == (0, 255):
        return voxels
    relative = (voxels.astype(np.float64) - low) / (high - low)
    if not as_colours:
        return relative.astype(np.float32)
    return np.floor(np.clip(relative, 0, 1) * 255 + 0.5).astype(np.uint8)


def _gl_type(texels: NDArray[Any]) -> str:
    return "f1" if texels.dtype == np.uint8 else "f4"
