"""Fills slabs on the GPU: bricks go there as they are stored, and are decoded by shaders."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from octobrick.renderer.brick_codes import BrickCodes
from octobrick.renderer.brick_pool import BrickPool
from octobrick.renderer.brick_request import BrickAddress
from octobrick.renderer.brick_source import BrickSource, GradientSource
from octobrick.renderer.classifier import ValueScale
from octobrick.renderer.context import GraphicsContext
from octobrick.renderer.deblocker import Deblocker, FilteredVolume
from octobrick.renderer.slab_buffer import SlabBuffer
from octobrick.renderer.slab_decoder import SlabDecoder, Target
from octobrick.renderer.slab_filler import Filled, SlabContent
from octobrick.store.box import Zyx

if TYPE_CHECKING:
    import moderngl

NO_DIRECTION_STORED: Final = 128 / 255
"""The byte that each component of a zero gradient has, docs/spec/gradient-code.md."""


class GpuFiller:
    """A `SlabFiller` with its bricks in GPU memory.

    Args:
        context: where the textures live.
        gl: the same, current in this thread.
        budget_nbytes: GPU memory for compressed bricks.
    """

    def __init__(self, context: GraphicsContext, gl: moderngl.Context, budget_nbytes: int) -> None:
        self._pool = BrickPool(gl, budget_nbytes)
        self._decoder = SlabDecoder(context, gl)
        self._deblocker = Deblocker(context, gl, self._decoder)
        self.waits = True

    def holds(self, address: BrickAddress) -> bool:
        """Whether a brick is here."""
        return False

    def fill(
        self, source: BrickSource, slab: SlabBuffer, content: SlabContent, bricks: Sequence[Zyx]
    ) -> Filled:
        """Decode the bricks into the slab, if it does not hold them yet.

        With deblocking, filtered: then the bricks are all those that the content's box touches
        with the margin that `filter_margin` says. Levels that are stored raw are not filtered.

        Raises:
            CorruptBrickError: a brick is damaged.
            ResourceError: the budget does not hold a single brick.
            UnsupportedError: a codec that the GPU does not decode, or cannot filter.
        """
        if slab.holds(content, bricks):
            return Filled()
        slab.held = None
        codes = BrickCodes.of_voxels(source, content.level, content.t, content.c)
        scale = ValueScale.of(source.dtype, source.value_range)
        target = _target(slab, content, scale.to_stored(source.fill_value))
        if content.deblocking is None or not codes.layout.has_blocks:
            low, high = source.value_range
            filled = self._decoder.decode(
                codes, self._pool, target, (float(low), float(high)), bricks
            )
        else:
            level = source.levels[content.level]
            volume = FilteredVolume(codes, level.shape_zyx, source.value_range)
            filled = self._deblocker.fill(volume, self._pool, target, content.deblocking, bricks)
        slab.held, slab.held_bricks = content, frozenset(bricks)
        return filled

    def fill_directions(
        self,
        gradients: GradientSource,
        slab: SlabBuffer,
        content: SlabContent,
        bricks: Sequence[Zyx],
    ) -> Filled:
        """Make the slab, of the format `DIRECTIONS`, hold the codes of gradients' directions.

        Where a brick is absent, every voxel has the code of no direction. A slab that has all of
        them already is left alone.

        Raises:
            CorruptBrickError: a brick is damaged.
            ResourceError: the budget does not hold a single brick.
        """
        if slab.holds(content, bricks):
            return Filled()
        slab.held = None
        codes = BrickCodes.of_directions(
            gradients, content.revision, content.level, content.t, content.c
        )
        target = _target(slab, content, NO_DIRECTION_STORED)
        filled = self._decoder.decode(codes, self._pool, target, (0.0, 1.0), bricks)
        slab.held, slab.held_bricks = content, frozenset(bricks)
        return filled

    @property
    def uploaded_nbytes(self) -> int:
        """Bytes sent to the GPU since the filler was made."""
        return self._pool.uploaded_nbytes

    @property
    def resident_nbytes(self) -> int:
        """Bytes of compressed bricks on the GPU, without what lies between them."""
        return self._pool.resident_nbytes

    @property
    def allocated_nbytes(self) -> int:
        """GPU memory of the pool, never above the budget."""
        return self._pool.allocated_nbytes

    @property
    def scratch_nbytes(self) -> int:
        """GPU memory that deblocking has taken besides, and keeps."""
        return self._deblocker.scratch_nbytes

    def forget(self) -> None:
        """Free the GPU memory of all bricks."""
        self._pool.release()
        self._deblocker.release()


def _target(slab: SlabBuffer, content: SlabContent, fill_stored: float) -> Target:
    """The whole slab, which was made for the content's voxels."""
    assert slab.texture is not None
    assert slab.format is not None
    return Target(slab.texture, slab.format, content.box, fill_stored)
