"""Shows bricks that are not there yet by coarser ones, on the GPU."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Final

from octobrick.renderer.brick_codes import BrickCodes
from octobrick.renderer.brick_pool import BrickPool
from octobrick.renderer.context import GraphicsContext
from octobrick.renderer.scratch_textures import ScratchTextures
from octobrick.renderer.slab_buffer import SLAB_IMAGE
from octobrick.renderer.slab_decoder import SlabDecoder, Target
from octobrick.renderer.substitution import ancestor, covering, nlevels_up_held
from octobrick.renderer.uniforms import run_over, set_uniforms
from octobrick.store.box import Box, Zyx, cell_box

if TYPE_CHECKING:
    import moderngl

COARSE_UNIT: Final = 0

CodesOfLevel = Callable[[int], BrickCodes]
"""The bricks of a level of the volume that is shown."""


class GpuSubstitution:
    """Fills parts of slabs with enlarged voxels of coarser bricks.

    Args:
        context: where the textures live.
        gl: the same, current in this thread.
        decoder: what decodes bricks.
        pool: where they are.
    """

    def __init__(
        self,
        context: GraphicsContext,
        gl: moderngl.Context,
        decoder: SlabDecoder,
        pool: BrickPool,
    ) -> None:
        self._context = context
        self._gl = gl
        self._decoder = decoder
        self._pool = pool
        self._scratch = ScratchTextures(gl)

    def fill(
        self,
        codes_of: CodesOfLevel,
        level: int,
        nlevels: int,
        target: Target,
        value_range: tuple[float, float],
        bricks: Sequence[Zyx],
    ) -> tuple[list[Zyx], int]:
        """Show bricks by the finest coarser ones that are resident.

        Args:
            codes_of: the bricks of a level.
            level: that is shown.
            nlevels: of the pyramid.
            target: the slab.
            value_range: of a volume of float32: what is stored as 0 and 1.
            bricks: of the level.

        Returns:
            the bricks that no coarser one can stand for, and how much coarser the coarsest is.
        """
        alone: list[Zyx] = []
        by_ancestor: dict[tuple[int, Zyx], list[Zyx]] = defaultdict(list)
        for zyx in bricks:
            up = nlevels_up_held(
                zyx, level, nlevels, lambda n, place: self._pool.holds(codes_of(n).address, place)
            )
            if up is None:
                alone.append(zyx)
            else:
                by_ancestor[up, ancestor(zyx, up)].append(zyx)
        for (up, coarse_zyx), members in by_ancestor.items():
            self._enlarge(codes_of(level + up), up, coarse_zyx, members, target, value_range)
        return alone, max((up for up, _ in by_ancestor), default=0)

    def release(self) -> None:
        """Free the memory kept for the next slab."""
        self._scratch.release()

    def _enlarge(
        self,
        codes: BrickCodes,
        up: int,
        coarse_zyx: Zyx,
        bricks: Sequence[Zyx],
        target: Target,
        value_range: tuple[float, float],
    ) -> None:
        brick_zyx = codes.layout.brick_zyx
        box = cell_box(coarse_zyx, brick_zyx)
        texture = self._scratch.require("coarse", target.texel, brick_zyx)
        coarse = Target(texture, target.texel, box, target.fill_stored)
        self._decoder.decode(codes, self._pool, coarse, value_range, [coarse_zyx])
        program = self._context.program("enlarge.comp.glsl", IMAGE_FORMAT=target.texel.image)
        for zyx in bricks:
            part = cell_box(zyx, brick_zyx).intersect(target.box)
            if part.nvoxels and _lies_within(covering(part, up), box):
                texture.use(COARSE_UNIT)
                target.texture.bind_to_image(SLAB_IMAGE, read=False, write=True)
                set_uniforms(
                    program,
                    {
                        "coarse": COARSE_UNIT,
                        "coarse_origin": box.start_zyx[::-1],
                        "first_voxel": part.start_zyx[::-1],
                        "voxel_count": part.shape_zyx[::-1],
                        "content_low": target.box.start_zyx[::-1],
                        "levels_up": up,
                    },
                )
                z, y, x = part.shape_zyx
                run_over(program, (x, y, z))
        self._gl.memory_barrier()


def _lies_within(inner: Box, outer: Box) -> bool:
    return inner.intersect(outer) == inner
