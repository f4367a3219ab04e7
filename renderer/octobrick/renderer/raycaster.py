"""Ray-casts slabs into a float picture, front to back."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from octobrick.renderer.cells import CellGrid
from octobrick.renderer.classifier import TABLE_ENTRIES, Classifier
from octobrick.renderer.code_layout import xyz_text
from octobrick.renderer.context import GraphicsContext
from octobrick.renderer.lighting import Lighting
from octobrick.renderer.slab_buffer import SlabBuffer
from octobrick.renderer.slabs import Slab
from octobrick.renderer.uniforms import set_uniforms
from octobrick.renderer.view import View
from octobrick.store.box import Box, Zyx

if TYPE_CHECKING:
    import moderngl

TILE = 8
"""Pixels along each side of a work group."""
BOX_SLACK_VOXELS = 0.01
"""Added around the box of visible samples: more than float32 positions err, so that rounding loses
no sample; what lies between is empty by its brick and costs nothing."""
FAR_VOXELS = 1e30
"""Stands for a plane at infinity, with which the shader's arithmetic stays finite."""


@dataclass(frozen=True, slots=True)
class Frame:
    """What all slabs of a picture share.

    Attributes:
        view: the rays.
        shape_zyx: voxels of the level.
        spacing_xyz: world units per voxel.
        step_world: distance between samples.
        box: holds all samples that can be visible.
        classifier: values to colours.
        lighting: None for unshaded.
    """

    view: View
    shape_zyx: Zyx
    spacing_xyz: tuple[float, float, float]
    step_world: float
    box: Box
    classifier: Classifier
    lighting: Lighting | None


class Raycaster:
    """Owns the picture that is being gathered, premultiplied RGBA in float32."""

    def __init__(self, context: GraphicsContext, gl: moderngl.Context) -> None:
        self._context = context
        self._gl = gl
        self._picture: moderngl.Texture | None = None
        self._transfer = gl.texture((TABLE_ENTRIES, 1), 4, dtype="f4")
        self._transfer.filter = (gl.LINEAR, gl.LINEAR)
        self._transfer.repeat_x = self._transfer.repeat_y = False
        self._progress = gl.buffer(reserve=4)
        self._frame: Frame | None = None

    def begin(self, frame: Frame) -> None:
        """Start a picture: nothing gathered yet."""
        size = frame.view.size
        if self._picture is None or self._picture.size != size:
            if self._picture is not None:
                self._picture.release()
            self._picture = self._gl.texture(size, 4, dtype="f4")
        width, height = size
        self._picture.write(bytes(16 * width * height))
        self._transfer.write(frame.classifier.table.tobytes())
        self._frame = frame

    def cast(
        self,
        slab: Slab,
        axis_zyx: int,
        buffer: SlabBuffer,
        grid: CellGrid,
        emptiness: moderngl.Texture3D,
    ) -> None:
        """Add what the rays meet in one slab. Call in the order of the plan."""
        frame = self._frame
        assert frame is not None
        assert buffer.texture is not None
        assert self._picture is not None
        program = self._context.program(
            "raycast.comp.glsl",
            SHADED=frame.lighting is not None,
            CELL_XYZ=xyz_text(grid.cell_zyx),
            ENTRIES=TABLE_ENTRIES,
        )
        buffer.texture.use(0)
        buffer.sampler.use(0)
        emptiness.use(1)
        self._transfer.use(2)
        set_uniforms(
            program,
            {
                "slab": 0,
                "emptiness": 1,
                "transfer": 2,
                "slab_axis": 2 - axis_zyx,
                "slab_low_voxel": _finite(slab.low),
                "slab_high_voxel": _finite(slab.high),
                "cell_origin": grid.origin_xyz,
                **_ray_uniforms(frame),
                **_slab_uniforms(slab, buffer),
                **_shading_uniforms(frame),
            },
        )
        self._progress.write(bytes(4))
        self._progress.bind_to_storage_buffer(0)
        self._picture.bind_to_image(0, read=True, write=True)
        width, height = frame.view.size
        program.run(-(-width // TILE), -(-height // TILE))
        self._gl.memory_barrier()
        # The decoders read the slab texture without this sampler's filter.
        buffer.sampler.clear(0)

    def rays_unfinished(self) -> bool:
        """Whether any ray has light left and samples to take in later slabs. Waits for the GPU."""
        return self._progress.read() != bytes(4)

    def picture(self) -> NDArray[np.float32]:
        """What was gathered: (height, width, 4), top row first, premultiplied."""
        assert self._picture is not None
        width, height = self._picture.size
        return np.frombuffer(self._picture.read(), np.float32).reshape(height, width, 4).copy()


def _ray_uniforms(frame: Frame) -> dict[str, object]:
    view, box = frame.view, frame.box
    return {
        "start_at00_voxel": view.start_voxel.at00,
        "start_by_column_voxel": view.start_voxel.by_column,
        "start_by_row_voxel": view.start_voxel.by_row,
        "toward_at00_world": view.toward_world.at00,
        "toward_by_column_world": view.toward_world.by_column,
        "toward_by_row_world": view.toward_world.by_row,
        "voxels_per_step": [frame.step_world / spacing for spacing in frame.spacing_xyz],
        "samples_longest": _samples_longest(frame),
        "picture_size": view.size,
        "volume_voxels": frame.shape_zyx[::-1],
        "box_low_voxel": [start - BOX_SLACK_VOXELS for start in box.start_zyx[::-1]],
        # Samples reach half a voxel beyond their base voxel's end, less where the volume ends.
        "box_high_voxel": [stop + 0.5 + BOX_SLACK_VOXELS for stop in box.stop_zyx[::-1]],
        "entries_per_stored": frame.classifier.entries_per_stored,
        "entry_of_stored_zero": frame.classifier.entry_of_stored_zero,
    }


def _slab_uniforms(slab: Slab, buffer: SlabBuffer) -> dict[str, object]:
    assert buffer.texture is not None
    return {
        "content_low_voxel": slab.content.start_zyx[::-1],
        "content_high_voxel": slab.content.stop_zyx[::-1],
        "per_texel": [1 / n for n in buffer.texture.size],
    }


def _shading_uniforms(frame: Frame) -> dict[str, object]:
    lighting, smallest = frame.lighting, min(frame.spacing_xyz)
    if lighting is None:
        return {}
    return {
        "difference_weight": [smallest / spacing for spacing in frame.spacing_xyz],
        "ambient": lighting.ambient,
        "diffuse": lighting.diffuse,
        "specular": lighting.specular,
        "shininess": lighting.shininess,
    }


def _samples_longest(frame: Frame) -> int:
    """Samples along the volume's diagonal: the bound of the shader's loop, come what may."""
    edges = (n * s for n, s in zip(reversed(frame.shape_zyx), frame.spacing_xyz, strict=True))
    return math.ceil(math.hypot(*edges) / frame.step_world) + 2


def _finite(plane: float) -> float:
    return plane if math.isfinite(plane) else math.copysign(FAR_VOXELS, plane)
