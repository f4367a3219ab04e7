"""Textures that are needed only while a slab is filled, kept for the next."""

from __future__ import annotations

from typing import TYPE_CHECKING

from octobrick.renderer.slab_format import SlabFormat
from octobrick.store.box import Zyx

if TYPE_CHECKING:
    import moderngl


class ScratchTextures:
    """Textures by name, made anew where one is too small.

    Args:
        gl: the context, current in this thread whenever they are used.
    """

    def __init__(self, gl: moderngl.Context) -> None:
        self._gl = gl
        self._textures: dict[str, tuple[SlabFormat, moderngl.Texture3D]] = {}

    def require(self, name: str, texel: SlabFormat, size_zyx: Zyx) -> moderngl.Texture3D:
        """A texture of at least this size; what it holds has no meaning."""
        found = self._textures.get(name)
        if found is not None:
            has, texture = found
            sides = zip(texture.size, size_zyx[::-1], strict=True)
            if has == texel and all(side >= wanted for side, wanted in sides):
                return texture
            texture.release()
        texture = self._gl.texture3d(size_zyx[::-1], texel.components, dtype=texel.gl_dtype)
        self._textures[name] = (texel, texture)
        return texture

    @property
    def nbytes(self) -> int:
        """GPU memory of all."""
        total = 0
        for texel, texture in self._textures.values():
            x, y, z = texture.size
            total += x * y * z * texel.voxel_nbytes
        return total

    def release(self) -> None:
        """Free all."""
        for _, texture in self._textures.values():
            texture.release()
        self._textures.clear()
