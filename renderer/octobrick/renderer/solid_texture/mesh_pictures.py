"""Finished pictures of meshes: what was drawn, what is known of its truth, and what it cost."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

from octobrick.renderer.brick_ranges import brick_errors
from octobrick.renderer.context import GraphicsContext
from octobrick.renderer.image import Fidelity, RenderedImage, RenderStats
from octobrick.renderer.pass_clock import PassClock
from octobrick.renderer.selection import finest_useful_level
from octobrick.renderer.solid_texture.mesh_drawer import MeshDrawer
from octobrick.renderer.solid_texture.mesh_request import MeshRequest
from octobrick.renderer.solid_texture.texture_atlas import TextureAtlas

if TYPE_CHECKING:
    import moderngl


class MeshPictures:
    """Makes pictures of meshes, and keeps on the GPU what the last one needed.

    Args:
        context: the renderer's.
        gl: the same, current in this thread.
        budget_nbytes: of textures.
    """

    def __init__(self, context: GraphicsContext, gl: moderngl.Context, budget_nbytes: int) -> None:
        self._context, self._gl = context, gl
        self.drawer = MeshDrawer(context, gl, budget_nbytes)

    def render(self, request: MeshRequest, started: float) -> RenderedImage:
        """The picture that was asked for at a time of `time.perf_counter`."""
        clock, drawer = PassClock(self._gl, software=self._context.software), self.drawer
        uploaded_before = drawer.uploaded_nbytes
        with clock.measure("load", on_gpu=False):
            atlas = drawer.texture(request)
        with clock.measure("draw"):
            drawer.draw(request)
        with clock.measure("finish"):
            rgba = drawer.canvas.finished(request.background)
        premultiplied = drawer.canvas.picture()
        uploaded_nbytes = drawer.uploaded_nbytes - uploaded_before
        level, volume = atlas.tiles.level, request.volume
        stats = RenderStats(
            level=level,
            bricks=_bricks(request, atlas),
            slabs=0,
            slabs_planned=0,
            uploaded_nbytes=uploaded_nbytes,
            resident_nbytes=atlas.nbytes,
            decoded_nbytes=uploaded_nbytes,
            slab_nbytes=0,
            step_world=0.0,
            reference_length_world=0.0,
            window=request.windows[0],
            milliseconds=clock.milliseconds() | {"total": 1e3 * (time.perf_counter() - started)},
            gl_renderer=self._context.renderer_name,
        )
        wanted = finest_useful_level(volume, request.camera, request.size)
        fidelity = Fidelity(level, wanted, _max_error(request, atlas), converged=level <= wanted)
        return RenderedImage(rgba, premultiplied, fidelity, stats)

    def release(self) -> None:
        """Free everything."""
        self.drawer.release()


def _bricks(request: MeshRequest, atlas: TextureAtlas) -> dict[str, int]:
    """Of all channels: "total", "sampled" by the surface or near it, and the "absent" of these."""
    total = math.prod(request.volume.levels[atlas.tiles.level].grid_zyx) * len(request.channels)
    return {"total": total, "sampled": atlas.nread, "absent": atlas.nabsent}


def _max_error(request: MeshRequest, atlas: TextureAtlas) -> float:
    bricks = list(atlas.tiles.bricks_zyx(request.volume.brick_shape_zyx))
    if not bricks:
        return 0.0
    at = tuple(zip(*bricks, strict=True))
    return max(
        float(brick_errors(request.volume, atlas.tiles.level, request.t, c)[at].max())
        for c in request.channels
    )
