"""The slab buffer: decoded voxels of one slab, as a texture that hardware interpolates.

It holds *stored* values: integers as normalised offset-binary, float32 relative to the volume's
range. It keeps what it holds between frames, so that a view that needs the same voxels again
decodes nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from octobrick.renderer.code_layout import ROWS, RUN_MAX
from octobrick.renderer.context import GraphicsContext
from octobrick.renderer.slab_filler import SlabContent
from octobrick.renderer.slab_format import FLOATS, SlabFormat
from octobrick.renderer.uniforms import run_over, set_uniforms
from octobrick.store.box import Zyx

if TYPE_CHECKING:
    import moderngl

SLAB_IMAGE: Final = 0
PARTS_BUFFER: Final = 0


class SlabBuffer:
    """The slab texture, what it holds, and the sampler that interpolates it.

    Args:
        context: where the texture lives.
        gl: the same, current in this thread.
    """

    def __init__(self, context: GraphicsContext, gl: moderngl.Context) -> None:
        self._context = context
        self._gl = gl
        self.texture: moderngl.Texture3D | None = None
        self.format: SlabFormat | None = None
        self.held: SlabContent | None = None
        self.held_bricks: frozenset[Zyx] = frozenset()
        self.sampler = gl.sampler(filter=(gl.LINEAR, gl.LINEAR))
        # Border colour, not clamping to the edge, though nothing samples beyond the edge: with
        # the latter Mesa's llvmpipe interpolates 8-bit textures in 8 bits, which shows as bands.
        self.sampler.border_color = (0.0, 0.0, 0.0, 0.0)

    def require(self, texel: SlabFormat, size_zyx: Zyx) -> moderngl.Texture3D:
        """The texture, made anew if it has another format or size; then it holds nothing."""
        size_xyz = size_zyx[::-1]
        fits = self.texture is not None and self.texture.size == size_xyz
        if fits and self.format == texel:
            assert self.texture is not None
            return self.texture
        self.release_texture()
        self.texture = self._gl.texture3d(size_xyz, texel.components, dtype=texel.gl_dtype)
        self.format = texel
        if texel == FLOATS:
            self._fill_with_zeros(size_zyx)
        return self.texture

    def _fill_with_zeros(self, size_zyx: Zyx) -> None:
        """New memory may hold NaN, which would survive an interpolation with weight 0."""
        assert self.texture is not None
        depth, height, width = size_zyx
        record = np.zeros((5, 4), np.int32)
        record[4, 1] = width
        program = self._context.program(
            "fill.comp.glsl", IMAGE_FORMAT=FLOATS.image, RUN=RUN_MAX, ROWS=ROWS
        )
        set_uniforms(program, {"part_size": (width, height, depth), "fill_stored": 0.0})
        buffer = self._gl.buffer(record.tobytes())
        buffer.bind_to_storage_buffer(PARTS_BUFFER)
        self.texture.bind_to_image(SLAB_IMAGE, read=False, write=True)
        run_over(program, (-(-width // RUN_MAX), -(-height // ROWS), depth))
        self._gl.memory_barrier()
        buffer.release()

    def holds(self, content: SlabContent, bricks: Sequence[Zyx]) -> bool:
        """Whether these bricks' voxels of the content are in the texture."""
        return self.held == content and self.held_bricks.issuperset(bricks)

    @property
    def nbytes(self) -> int:
        """GPU memory of the texture."""
        if self.texture is None or self.format is None:
            return 0
        x, y, z = self.texture.size
        return int(x * y * z * self.format.voxel_nbytes)

    def release_texture(self) -> None:
        """Free the texture."""
        if self.texture is not None:
            self.texture.release()
        self.texture = None
        self.held = None

    def read(self) -> bytes:
        """What the texture holds, for tests: x fastest, without padding of rows."""
        assert self.texture is not None
        return bytes(self.texture.read(alignment=1))
