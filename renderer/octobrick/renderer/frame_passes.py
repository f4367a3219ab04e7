"""The passes of a frame, in their order: fill, find empty space, cast; slab by slab."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from octobrick.renderer.cells import CellGrid, bricks_of
from octobrick.renderer.context import GraphicsContext
from octobrick.renderer.direct_bricks import DirectBricks
from octobrick.renderer.empty_space import EmptySpace
from octobrick.renderer.frame_plan import FramePlan, Limits, brick_list
from octobrick.renderer.occlusion import unoccluded
from octobrick.renderer.pass_clock import PassClock
from octobrick.renderer.raycaster import TILE, Raycaster, SlabTextures
from octobrick.renderer.render_request import RenderRequest
from octobrick.renderer.selection import Mask, dilated
from octobrick.renderer.slab_filler import Filled, SlabFiller
from octobrick.renderer.slab_set import SlabSet
from octobrick.renderer.slabs import Slab, SlabPlan
from octobrick.store.box import Box

if TYPE_CHECKING:
    import moderngl

    from octobrick.renderer.canvas import Canvas


@dataclass(slots=True)
class Drawn:
    """What drawing a frame took.

    Attributes:
        sampled: bricks of the level in which samples were taken.
        filled: what was decoded.
        nslabs: that were cast.
    """

    sampled: Mask
    filled: Filled = field(default_factory=Filled)
    nslabs: int = 0

    def counts(self, plan: FramePlan) -> dict[str, int]:
        """Bricks of the level by what became of them."""
        selected = plan.selection.counts
        sampled = int(self.sampled.sum())
        return selected | {
            "occluded": selected["sampled"] - sampled,
            "sampled": sampled,
            "decoded": self.filled.nbricks,
            "absent": self.filled.nabsent,
            "substituted": self.filled.nsubstituted,
        }


class FramePasses:
    """Draws frames on a canvas, with buffers that live between frames.

    Args:
        context: of OpenGL.
        gl: the same, current in this thread whenever this is used.
        filler: what fills slabs.
        limits: of memory.
        cull: False samples every brick and every step.
    """

    def __init__(
        self,
        context: GraphicsContext,
        gl: moderngl.Context,
        filler: SlabFiller,
        limits: Limits,
        *,
        cull: bool,
    ) -> None:
        self._cull = cull
        self._filler = filler
        self._slabs = SlabSet(context, gl, filler)
        self._direct = DirectBricks(context, gl, limits.brick_nbytes)
        self._empty_space = EmptySpace(context, gl)
        self._raycaster = Raycaster(context, gl)

    @property
    def canvas(self) -> Canvas:
        """What was drawn last."""
        return self._raycaster.canvas

    @property
    def slab_nbytes(self) -> int:
        """GPU memory of slab buffers."""
        return self._slabs.nbytes

    @property
    def direct_nbytes(self) -> int:
        """GPU memory of bricks for direct rendering."""
        return self._direct.nbytes

    @property
    def direct_uploaded_nbytes(self) -> int:
        """Bytes sent to the GPU for direct rendering since this was made."""
        return self._direct.uploaded_nbytes

    def release(self) -> None:
        """Free all textures; the next frame makes its own."""
        self._slabs.release()
        self._direct.release()
        self._empty_space.release()
        self.canvas.release()

    def draw(self, request: RenderRequest, plan: FramePlan, clock: PassClock) -> Drawn:
        """Gather a picture on the canvas."""
        drawn = Drawn(np.zeros_like(plan.selection.sampled))
        self._raycaster.begin(request, plan)
        if request.direct is None:
            self._direct.release()
        else:  # both ways together would take twice the budget
            self._filler.forget()
            self._slabs.release()
        if plan.slabs is not None and request.direct is None:
            self._cast_slabs(request, plan, plan.slabs, clock, drawn)
        elif plan.slabs is not None:
            self._cast_directly(request, plan, plan.slabs, clock, drawn)
        self._raycaster.end()
        return drawn

    def _cast_slabs(
        self,
        request: RenderRequest,
        plan: FramePlan,
        slabs: SlabPlan,
        clock: PassClock,
        drawn: Drawn,
    ) -> None:
        brick_zyx, geometry = request.volume.brick_shape_zyx, request.volume.levels[plan.level]
        in_sight = plan.selection.sampled
        for slab in slabs.slabs:
            part = bricks_of(slab.content, brick_zyx).slices
            if not in_sight[part].any():
                continue
            if drawn.nslabs and self._cull:
                tiles = self._raycaster.tiles_unfinished()
                in_sight = unoccluded(in_sight, geometry, brick_zyx, plan.view, tiles, TILE)
                if not in_sight.any():
                    break
                if not in_sight[part].any():
                    continue
            self._cast_slab(request, plan, slabs, slab, in_sight, clock, drawn)
            drawn.sampled[part] |= in_sight[part]

    def _cast_slab(
        self,
        request: RenderRequest,
        plan: FramePlan,
        slabs: SlabPlan,
        slab: Slab,
        in_sight: Mask,
        clock: PassClock,
        drawn: Drawn,
    ) -> None:
        """Decode one slab and take its samples."""
        layout, brick_zyx = plan.layout, request.volume.brick_shape_zyx
        needed = plan.selection.needed
        if in_sight is not plan.selection.sampled:
            needed = dilated(in_sight, brick_zyx, layout.brick_margin_zyx)
        reach = slab.content.grow(max(layout.filter_margin_zyx))
        box = reach.intersect(Box.of_shape(request.volume.levels[plan.level].shape_zyx))
        with clock.measure("decode"):
            bricks = brick_list(needed, bricks_of(box, brick_zyx).slices)
            drawn.filled.add(
                self._slabs.fill(
                    request, plan.level, layout, slabs.buffer_zyx, slab.content, bricks
                )
            )
        grid = CellGrid.of(brick_zyx, slab.content)
        with clock.measure("empty space"):
            ranges = self._slabs.cell_ranges(layout, grid)
            emptiness = self._find_emptiness(request, plan, ranges, grid, in_sight)
        with clock.measure("cast"):
            textures = SlabTextures(
                self._slabs.voxels(layout), self._slabs.directions(layout), ranges, emptiness, grid
            )
            self._raycaster.cast(slab, slabs.axis_zyx, textures)
        drawn.nslabs += 1

    def _cast_directly(
        self,
        request: RenderRequest,
        plan: FramePlan,
        slabs: SlabPlan,
        clock: PassClock,
        drawn: Drawn,
    ) -> None:
        """All samples at once, from bricks that stay compressed."""
        box = Box.of_shape(request.volume.levels[plan.level].shape_zyx)
        everything = Slab(-np.inf, np.inf, box)
        with clock.measure("load"):
            bricks = brick_list(plan.selection.needed, plan.selection.every_brick)
            c = request.channels[0].c
            self._direct.load(request.volume, plan.level, request.t, c, bricks)
        grid = CellGrid.of(request.volume.brick_shape_zyx, box)
        with clock.measure("empty space"):
            ranges = [self._direct.ranges(grid)]
            emptiness = self._find_emptiness(request, plan, ranges, grid, plan.selection.sampled)
        with clock.measure("cast"):
            textures = SlabTextures((), (), ranges, emptiness, grid, self._direct)
            self._raycaster.cast(everything, slabs.axis_zyx, textures)
        drawn.sampled |= plan.selection.sampled

    def _find_emptiness(
        self,
        request: RenderRequest,
        plan: FramePlan,
        ranges: list[moderngl.Texture3D],
        grid: CellGrid,
        in_sight: Mask,
    ) -> moderngl.Texture3D:
        return self._empty_space.find(
            ranges,
            request.volume.brick_shape_zyx,
            grid,
            in_sight,
            plan.classifiers,
            rgb=request.rgb,
            skip=self._cull,
        )
