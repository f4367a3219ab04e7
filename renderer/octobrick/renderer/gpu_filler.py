"""Fills slabs on the GPU: bricks go there as they are stored, and are decoded by shaders."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

from octobrick.renderer.brick_codes import BrickCodes
from octobrick.renderer.brick_loader import PENDING, BrickLoader
from octobrick.renderer.brick_pool import BrickPool
from octobrick.renderer.brick_request import BrickAddress
from octobrick.renderer.brick_source import BrickSource, GradientSource
from octobrick.renderer.classifier import ValueScale
from octobrick.renderer.context import GraphicsContext
from octobrick.renderer.deblocker import Deblocker, FilteredVolume
from octobrick.renderer.gpu_substitution import CodesOfLevel, GpuSubstitution
from octobrick.renderer.slab_buffer import SlabBuffer
from octobrick.renderer.slab_decoder import SlabDecoder, Target
from octobrick.renderer.slab_filler import Filled, SlabContent
from octobrick.store.box import Box, Zyx, cells_touching

if TYPE_CHECKING:
    import moderngl

NO_DIRECTION_STORED: Final = 128 / 255
"""What a component of a voxel without a direction is in a texture."""
FRAME_UPLOAD_NBYTES: Final = 64 << 20
"""A frame that does not wait uploads no more, and one brick: some milliseconds on any bus."""


class GpuFiller:
    """A `SlabFiller` with its bricks in GPU memory.

    Args:
        context: where the textures live.
        gl: the same, current in this thread.
        budget_nbytes: GPU memory for compressed bricks.
        loader: reads bricks meanwhile; without one they are read when they are needed.
    """

    def __init__(
        self,
        context: GraphicsContext,
        gl: moderngl.Context,
        budget_nbytes: int,
        loader: BrickLoader | None = None,
    ) -> None:
        self._pool = BrickPool(gl, budget_nbytes)
        self._decoder = SlabDecoder(context, gl)
        self._deblocker = Deblocker(context, gl, self._decoder)
        self._substitution = GpuSubstitution(context, gl, self._decoder, self._pool)
        self._loader = loader
        self._frame_nbytes = 0
        self.waits = True

    @property
    def waits(self) -> bool:
        """Whether bricks are waited for. Else, with a loader, coarser ones stand for them."""
        return self._waits or self._loader is None

    @waits.setter
    def waits(self, waits: bool) -> None:
        """Set before each frame, whose uploads are counted from here."""
        self._waits, self._frame_nbytes = waits, 0

    def holds(self, address: BrickAddress) -> bool:
        """Whether a brick is on the GPU, or known to be absent."""
        at = address
        return self._pool.holds((at.kind, at.revision, at.level, at.t, at.c), at.zyx)

    def fill(
        self, source: BrickSource, slab: SlabBuffer, content: SlabContent, bricks: Sequence[Zyx]
    ) -> Filled:
        """Decode the bricks into the slab, if it does not hold them yet.

        With deblocking, filtered: then the bricks are all those that the content's box touches
        with the margin that `filter_margin` says. Levels that are stored raw are not filtered, nor
        is a slab of which bricks are still to come.

        Raises:
            CorruptBrickError: a brick is damaged.
            ResourceError: the budget does not hold a single brick.
            UnsupportedError: a codec that the GPU does not decode, or cannot filter.
        """
        if slab.holds(content, bricks):
            return Filled()
        slab.held = None

        def codes_of(level: int) -> BrickCodes:
            return BrickCodes.of_voxels(source, level, content.t, content.c)

        codes = codes_of(content.level)
        scale = ValueScale.of(source.dtype, source.value_range)
        target = _target(slab, content, scale.to_stored(source.fill_value))
        low, high = (float(value) for value in source.value_range)
        there, pending, codes = self._arrived(codes, source, bricks)
        if content.deblocking is None or not codes.layout.has_blocks or pending:
            filled = self._decoder.decode(codes, self._pool, target, (low, high), there)
        else:
            level = source.levels[content.level]
            volume = FilteredVolume(codes, level.shape_zyx, source.value_range)
            filled = self._deblocker.fill(volume, self._pool, target, content.deblocking, there)
        if pending:
            self._substitute(source, codes_of, content, target, (low, high), pending, filled)
        slab.held, slab.held_bricks = content, frozenset(bricks) - frozenset(pending)
        return filled

    def fill_directions(
        self,
        gradients: GradientSource,
        slab: SlabBuffer,
        content: SlabContent,
        bricks: Sequence[Zyx],
    ) -> Filled:
        """Make the slab, of the format `DIRECTIONS`, hold the codes of gradients' directions.

        Where a brick is absent, or still to come, every voxel has the code of no direction. A slab
        that has all of them already is left alone.

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
        there, pending, codes = self._arrived(codes, gradients, bricks)
        filled = self._decoder.decode(codes, self._pool, target, (0.0, 1.0), there)
        if pending:
            self._decoder.fill(codes.layout, target, pending)
            filled.nsubstituted += len(pending)
        slab.held, slab.held_bricks = content, frozenset(bricks) - frozenset(pending)
        return filled

    def _arrived(
        self, codes: BrickCodes, source: Any, bricks: Sequence[Zyx]
    ) -> tuple[Sequence[Zyx], list[Zyx], BrickCodes]:
        """Which bricks are at hand, which are still to come, and how to get the former."""
        if self._loader is None:
            return bricks, [], codes
        missing = [zyx for zyx in bricks if not self._pool.holds(codes.address, zyx)]
        requests = {zyx: codes.request(zyx, source) for zyx in missing}
        if self.waits:
            self._loader.urge(requests.values())
            return bricks, [], codes.taken_by(self._loader.take_waiting, source)
        self._loader.want(requests.values(), keep=True)
        came: dict[Zyx, bytes | None] = {}
        for zyx, request in requests.items():
            if self._frame_nbytes > FRAME_UPLOAD_NBYTES:
                break
            code = self._loader.take(request, wait=False)
            if code is not PENDING:
                came[zyx] = code
                self._frame_nbytes += len(code or b"")
        pending = [zyx for zyx in missing if zyx not in came]
        there = [zyx for zyx in bricks if zyx in came or zyx not in requests]

        def taken(request: Any) -> bytes | None:
            zyx = request.address.zyx
            return came[zyx] if zyx in came else request.read()

        return there, pending, codes.taken_by(taken, source)

    def _substitute(
        self,
        source: BrickSource,
        codes_of: CodesOfLevel,
        content: SlabContent,
        target: Target,
        value_range: tuple[float, float],
        pending: list[Zyx],
        filled: Filled,
    ) -> None:
        """Show bricks by coarser ones, of which the coarsest level is always there."""
        last = len(source.levels) - 1
        if content.level < last:
            self._bring_coarsest(source, codes_of(last), source.levels[last].grid_zyx)
        alone, filled.nlevels_up = self._substitution.fill(
            codes_of, content.level, last + 1, target, value_range, pending
        )
        if alone:  # the coarsest level itself: a few bricks, which are waited for
            assert self._loader is not None
            codes = codes_of(content.level).taken_by(self._loader.take_waiting, source)
            filled.add(self._decoder.decode(codes, self._pool, target, value_range, alone))
            for zyx in alone:
                pending.remove(zyx)
        filled.nsubstituted += len(pending)

    def _bring_coarsest(self, source: BrickSource, codes: BrickCodes, grid_zyx: Zyx) -> None:
        """Load the coarsest level, and keep it before all others."""
        assert self._loader is not None
        bricks = list(cells_touching(Box.of_shape(grid_zyx), (1, 1, 1)))
        missing = [zyx for zyx in bricks if not self._pool.holds(codes.address, zyx)]
        if missing:
            self._loader.urge(codes.request(zyx, source) for zyx in missing)
            for _ in self._pool.batches(codes.taken_by(self._loader.take_waiting, source), missing):
                pass
        self._pool.keep(codes.address, bricks)

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
        self._substitution.release()


def _target(slab: SlabBuffer, content: SlabContent, fill_stored: float) -> Target:
    """The whole slab, which was made for the content's voxels."""
    assert slab.texture is not None
    assert slab.format is not None
    return Target(slab.texture, slab.format, content.box, fill_stored)
