"""Fills slabs on the GPU: bricks go there as they are stored, and are decoded by shaders."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from octobrick.renderer.brick_pool import BrickPool
from octobrick.renderer.brick_source import BrickSource
from octobrick.renderer.context import GraphicsContext
from octobrick.renderer.slab_buffer import SlabBuffer
from octobrick.renderer.slab_decoder import SlabDecoder
from octobrick.renderer.slab_filler import DirectionSource, Filled, SlabContent
from octobrick.store.box import Zyx

if TYPE_CHECKING:
    import moderngl


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

    def fill(
        self, source: BrickSource, slab: SlabBuffer, content: SlabContent, bricks: Sequence[Zyx]
    ) -> Filled:
        """Decode the bricks into the slab, if it does not hold them yet."""
        if slab.holds(content, bricks):
            return Filled()
        slab.held = None
        filled = self._decoder.decode(source, self._pool, slab, content, bricks)
        slab.held, slab.held_bricks = content, frozenset(bricks)
        return filled

    def fill_directions(
        self,
        gradients: DirectionSource,
        slab: SlabBuffer,
        content: SlabContent,
        bricks: Sequence[Zyx],
    ) -> Filled:
        """Decode the bricks' directions into the slab."""
        raise NotImplementedError

    @property
    def uploaded_nbytes(self) -> int:
        """Bytes sent to the GPU since the filler was made."""
        return self._pool.uploaded_nbytes

    @property
    def resident_nbytes(self) -> int:
        """Bytes of compressed bricks on the GPU, without empty slots."""
        return self._pool.resident_nbytes

    @property
    def allocated_nbytes(self) -> int:
        """GPU memory of the pool, never above the budget."""
        return self._pool.allocated_nbytes

    def forget(self) -> None:
        """Free the GPU memory of all bricks."""
        self._pool.release()
