"""Ray-casts slabs into a float picture, front to back."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from octobrick.renderer.canvas import Canvas
from octobrick.renderer.cells import CellGrid
from octobrick.renderer.classifier import TABLE_ENTRIES
from octobrick.renderer.clip import PLANES_MAX, planes_in_voxels
from octobrick.renderer.code_layout import xyz_text
from octobrick.renderer.context import GraphicsContext
from octobrick.renderer.direct_bricks import DirectBricks
from octobrick.renderer.frame_plan import FramePlan
from octobrick.renderer.lighting import Lighting
from octobrick.renderer.modes import Isosurface, Projection, Slice
from octobrick.renderer.render_request import RenderRequest
from octobrick.renderer.slab_buffer import SlabBuffer
from octobrick.renderer.slabs import Slab
from octobrick.renderer.uniforms import run_over, set_uniforms
from octobrick.store.box import Zyx

if TYPE_CHECKING:
    import moderngl

TILE = 8
"""Pixels along each side of a work group."""
BOX_SLACK_VOXELS = 0.01
"""Added around the box of visible samples: more than float32 positions err, so that rounding loses
no sample; what lies between is empty by its brick and costs nothing."""
FAR_VOXELS = 1e30
"""Stands for a plane at infinity, with which the shader's arithmetic stays finite."""

# What the shaders call the ways to march along a ray, and to find gradients.
_MARCHES: Final = {"dvr": 0, "mip": 1, "minip": 1, "average": 1, "isosurface": 2, "slice": 3}
_STATISTICS: Final = {"max": 0, "min": 1, "mean": 2}
# What a statistic is before the first sample; stored values lie in 0..1.
_BEFORE: Final = {"max": -1.0, "min": 2.0, "mean": 0.0}
_NO_GRADIENTS, _DIFFERENCES, _STORED_DIRECTIONS = 0, 1, 2


@dataclass(frozen=True, slots=True)
class SlabTextures:
    """What a slab is sampled from.

    Attributes:
        voxels: of each channel.
        directions: of each channel; empty where gradients are found on the fly.
        ranges: of each channel's cells.
        emptiness: of the cells.
        grid: of the cells.
        direct: the bricks, where no slab was decoded; then there are no voxels.
    """

    voxels: Sequence[SlabBuffer]
    directions: Sequence[SlabBuffer]
    ranges: Sequence[moderngl.Texture3D]
    emptiness: moderngl.Texture3D
    grid: CellGrid
    direct: DirectBricks | None = None


class Raycaster:
    """Gathers a picture on its canvas, slab by slab."""

    def __init__(self, context: GraphicsContext, gl: moderngl.Context) -> None:
        self._context = context
        self._gl = gl
        self.canvas = Canvas(context, gl)
        self._transfer: moderngl.Texture | None = None
        self._progress: moderngl.Buffer | None = None
        self._frame: tuple[RenderRequest, FramePlan] | None = None

    def begin(self, request: RenderRequest, plan: FramePlan) -> None:
        """Start a picture: nothing gathered yet."""
        statistic = request.mode.statistic if isinstance(request.mode, Projection) else "mean"
        self.canvas.begin(request.size, _BEFORE[statistic], depth=request.depth)
        tables = np.stack([classifier.table for classifier in plan.classifiers])
        size = (TABLE_ENTRIES, len(tables))
        if self._transfer is None or self._transfer.size != size:
            if self._transfer is not None:
                self._transfer.release()
            self._transfer = self._gl.texture(size, 4, dtype="f4")
            self._transfer.filter = (self._gl.LINEAR, self._gl.LINEAR)
            self._transfer.repeat_x = self._transfer.repeat_y = False
        self._transfer.write(tables.tobytes())
        ntiles = 4 * math.prod(self._tiles_wh(request))
        if self._progress is None or self._progress.size != ntiles:
            if self._progress is not None:
                self._progress.release()
            self._progress = self._gl.buffer(reserve=ntiles)
        self._frame = (request, plan)

    def cast(self, slab: Slab, axis_zyx: int, textures: SlabTextures) -> None:
        """Add what the rays meet in one slab. Call in the order of the plan."""
        assert self._frame is not None
        assert self._progress is not None
        request, plan = self._frame
        name = "raycast.comp.glsl" if textures.direct is None else "raycast_direct.comp.glsl"
        program = self._context.program(name, **_variant(request, textures))
        set_uniforms(
            program,
            {
                "slab_axis": 2 - axis_zyx,
                "slab_low_voxel": _finite(slab.low),
                "slab_high_voxel": _finite(slab.high),
                "cell_origin": textures.grid.origin_xyz,
                **self._bind(textures),
                **_ray_uniforms(request, plan),
                **_slab_uniforms(slab, textures.voxels),
                **_color_uniforms(request, plan),
                **_shading_uniforms(request, plan),
            },
            some_unused=True,
        )
        self._progress.write(bytes(self._progress.size))
        self._progress.bind_to_storage_buffer(0)
        self.canvas.bind(depth=request.depth)
        program.run(*self._tiles_wh(request))
        self._gl.memory_barrier()
        # The decoders read these textures without the sampler's filter.
        for unit, buffer in enumerate((*textures.voxels, *textures.directions)):
            buffer.sampler.clear(unit)

    def tiles_unfinished(self) -> NDArray[np.bool_]:
        """By tile of 8×8 pixels (rows from the top): whether any ray needs samples of later slabs.

        Waits for the GPU.
        """
        assert self._progress is not None
        assert self._frame is not None
        width, height = self._tiles_wh(self._frame[0])
        flags = np.frombuffer(self._progress.read(), np.uint32)
        return np.asarray(flags.reshape(height, width) != 0)

    def end(self) -> None:
        """Make colours of what was gathered, where that is something else."""
        assert self._frame is not None
        request, plan = self._frame
        if not isinstance(request.mode, Projection):
            return
        assert self._transfer is not None
        program = self._context.program(
            "project.comp.glsl",
            CHANNELS=len(request.channels),
            RGB=request.rgb,
            ENTRIES=TABLE_ENTRIES,
            STATISTIC=_STATISTICS[request.mode.statistic],
        )
        self._transfer.use(0)
        self.canvas.bind(depth=False)
        uniforms = {"transfer": 0, **_ray_uniforms(request, plan), **_color_uniforms(request, plan)}
        set_uniforms(program, uniforms, some_unused=True)
        run_over(program, (*request.size, 1))
        self._gl.memory_barrier()

    def _bind(self, textures: SlabTextures) -> dict[str, Any]:
        """Put textures into units, voxels first; the units by the samplers' names."""
        assert self._transfer is not None
        n, m = len(textures.voxels), len(textures.directions)
        for unit, buffer in enumerate((*textures.voxels, *textures.directions)):
            assert buffer.texture is not None
            buffer.texture.use(unit)
            buffer.sampler.use(unit)
        textures.emptiness.use(n + m)
        self._transfer.use(n + m + 1)
        textures.ranges[0].use(n + m + 2)
        direct = textures.direct.bind(n + m + 3) if textures.direct is not None else {}
        return direct | {
            "slab": np.arange(n),
            "directions": np.arange(n, n + m),
            "emptiness": n + m,
            "transfer": n + m + 1,
            "cell_range": n + m + 2,
        }

    @staticmethod
    def _tiles_wh(request: RenderRequest) -> tuple[int, int]:
        width, height = request.size
        return -(-width // TILE), -(-height // TILE)


def _variant(request: RenderRequest, textures: SlabTextures) -> dict[str, str | int | bool]:
    """What the names in the ray caster's text stand for."""
    gradients = _NO_GRADIENTS
    if request.lighting is not None:
        gradients = _STORED_DIRECTIONS if textures.directions else _DIFFERENCES
    statistic = request.mode.statistic if isinstance(request.mode, Projection) else "max"
    sampling = request.direct or "linear"
    own = {} if textures.direct is None else textures.direct.shader_values(sampling)
    return own | {
        "CHANNELS": len(request.channels),
        "MODE": _MARCHES[request.mode.name],
        "STATISTIC": _STATISTICS[statistic],
        "RGB": request.rgb,
        "SHADED": request.lighting is not None,
        "GRADIENTS": gradients,
        "EDGES": request.edges is not None,
        "DEPTH": request.depth,
        "CELL_XYZ": xyz_text(textures.grid.cell_zyx),
        "ENTRIES": TABLE_ENTRIES,
    }


def _ray_uniforms(request: RenderRequest, plan: FramePlan) -> dict[str, Any]:
    view, box = plan.view, plan.selection.box
    geometry = request.volume.levels[plan.level]
    planes = planes_in_voxels(request.clip.planes_world(), geometry)
    return {
        "start_at00_voxel": view.start_voxel.at00,
        "start_by_column_voxel": view.start_voxel.by_column,
        "start_by_row_voxel": view.start_voxel.by_row,
        "toward_at00_world": view.toward_world.at00,
        "toward_by_column_world": view.toward_world.by_column,
        "toward_by_row_world": view.toward_world.by_row,
        "voxels_per_step": [plan.step_world / spacing for spacing in geometry.spacing_xyz],
        "samples_longest": _samples_longest(geometry.shape_zyx, geometry.spacing_xyz, plan),
        "picture_size": view.size,
        "volume_voxels": geometry.shape_zyx[::-1],
        "box_low_voxel": [start - BOX_SLACK_VOXELS for start in box.start_zyx[::-1]],
        # Samples reach half a voxel beyond their base voxel's end, less where the volume ends.
        "box_high_voxel": [stop + 0.5 + BOX_SLACK_VOXELS for stop in box.stop_zyx[::-1]],
        "clip_count": len(planes),
        "clip_planes_voxel": np.concatenate([planes, np.zeros((PLANES_MAX - len(planes), 4))]),
        "depth_of_start": view.start_depth_world,
        "step_world": plan.step_world,
        "forward_world": view.forward_world,
    }


def _slab_uniforms(slab: Slab, voxels: Sequence[SlabBuffer]) -> dict[str, Any]:
    if not voxels:
        return {}
    assert voxels[0].texture is not None
    return {
        "content_low_voxel": slab.content.start_zyx[::-1],
        "content_high_voxel": slab.content.stop_zyx[::-1],
        "per_texel": [1 / n for n in voxels[0].texture.size],
    }


def _color_uniforms(request: RenderRequest, plan: FramePlan) -> dict[str, Any]:
    classifiers = plan.classifiers
    scale = classifiers[0].scale
    uniforms: dict[str, Any] = {
        "entries_per_stored": np.array([c.entries_per_stored for c in classifiers]),
        "entry_of_stored_zero": np.array([c.entry_of_stored_zero for c in classifiers]),
        "rgb_window_stored": [scale.to_stored(value) for value in request.channels[0].window],
    }
    if isinstance(request.mode, Isosurface):
        uniforms["surface_stored"] = scale.to_stored(request.mode.value)
    if isinstance(request.mode, Slice):
        plane = request.mode.plane_world()[np.newaxis]
        uniforms["slice_voxel"] = planes_in_voxels(plane, request.volume.levels[plan.level])[0]
    return uniforms


def _shading_uniforms(request: RenderRequest, plan: FramePlan) -> dict[str, Any]:
    spacing_xyz = request.volume.levels[plan.level].spacing_xyz
    uniforms: dict[str, Any] = {
        "difference_weight": [min(spacing_xyz) / spacing for spacing in spacing_xyz]
    }
    if request.edges is not None:
        # Magnitudes are given in widths of the window per voxel of level 0.
        low, high = request.channels[0].window
        finest = min(request.volume.levels[0].spacing_xyz)
        width = plan.classifiers[0].scale.width
        stored = (high - low) / width * min(spacing_xyz) / finest if width > 0 else 1.0
        uniforms["edge_stored"] = [stored * edge for edge in request.edges]
    if request.lighting is not None:
        uniforms |= light_uniforms(request.lighting)
    return uniforms


def light_uniforms(lighting: Lighting) -> dict[str, Any]:
    """The uniforms of shading.glsl."""
    return {
        "ambient": lighting.ambient,
        "diffuse": lighting.diffuse,
        "specular": lighting.specular,
        "shininess": lighting.shininess,
        "light_count": len(lighting.lights),
        "light_toward_world": np.array([light.unit_world() for light in lighting.lights]),
        "light_color": np.array([light.color for light in lighting.lights]),
    }


def _samples_longest(shape_zyx: Zyx, spacing_xyz: tuple[float, ...], plan: FramePlan) -> int:
    """Samples along the volume's diagonal: the bound of the shader's loop, come what may."""
    edges = (n * s for n, s in zip(reversed(shape_zyx), spacing_xyz, strict=True))
    return math.ceil(math.hypot(*edges) / plan.step_world) + 2


def _finite(plane: float) -> float:
    return plane if math.isfinite(plane) else math.copysign(FAR_VOXELS, plane)
