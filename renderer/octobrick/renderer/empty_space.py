"""Finds the cells of a slab in which nothing can be seen, so that rays leap over them.

Exact: a skipped sample would have had an opacity of 0. Three steps, all on the GPU: the range of
voxels of each cell (kept as long as the slab is), which ranges the transfer function lets be seen,
and the distance from each empty cell to the nearest that is not.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from octobrick.renderer.cells import CellGrid
from octobrick.renderer.classifier import TABLE_ENTRIES, Classifier
from octobrick.renderer.code_layout import xyz_text
from octobrick.renderer.context import GraphicsContext
from octobrick.renderer.selection import Mask
from octobrick.renderer.slab_buffer import SlabBuffer
from octobrick.renderer.uniforms import run_over, set_uniforms
from octobrick.store.box import Zyx

if TYPE_CHECKING:
    import moderngl

REACH: Final = 7
"""Cells within which a distance is told. Measured on llvmpipe: 3 and 7 cost the same, 1 a tenth
more, 15 a quarter more (docs/adr/0002)."""


class CellRanges:
    """The range of voxels of each cell of one channel's slab, kept as long as the slab is."""

    def __init__(self, context: GraphicsContext, gl: moderngl.Context) -> None:
        self._context = context
        self._gl = gl
        self._texture: moderngl.Texture3D | None = None
        self._contents: object = None

    def find(self, slab: SlabBuffer, grid: CellGrid) -> moderngl.Texture3D:
        """Pairs of stored values by cell; computed only when the slab has changed."""
        contents = (slab.held, slab.held_bricks)
        if self._texture is not None and self._contents == contents:
            return self._texture
        self.release()
        assert slab.texture is not None
        assert slab.format is not None
        assert slab.held is not None
        texture = self._gl.texture3d(grid.size_xyz, 2, dtype=slab.format.gl_dtype)
        texture.filter = (self._gl.NEAREST, self._gl.NEAREST)
        content = slab.held.box
        program = self._context.program(
            "cell_range.comp.glsl",
            RANGE_FORMAT=slab.format.range_image,
            CELL_XYZ=xyz_text(grid.cell_zyx),
        )
        slab.texture.use(0)
        texture.bind_to_image(0, read=False, write=True)
        set_uniforms(
            program,
            {
                "slab": 0,
                "content_low": content.start_zyx[::-1],
                "content_size": content.shape_zyx[::-1],
                "cell_origin": grid.origin_xyz,
                "cell_count": grid.size_xyz,
            },
        )
        run_over(program, grid.size_xyz)
        self._gl.memory_barrier()
        self._texture, self._contents = texture, contents
        return texture

    def release(self) -> None:
        """Free the texture."""
        if self._texture is not None:
            self._texture.release()
        self._texture, self._contents = None, None


class EmptySpace:
    """The textures that tell of the current slab's cells how far it is to what can be seen."""

    def __init__(self, context: GraphicsContext, gl: moderngl.Context) -> None:
        self._context = context
        self._gl = gl
        self._emptiness: list[moderngl.Texture3D] = []
        self._opacity: moderngl.Buffer | None = None

    def find(
        self,
        ranges: Sequence[moderngl.Texture3D],
        brick_zyx: Zyx,
        grid: CellGrid,
        sampled: Mask,
        classifiers: Sequence[Classifier],
        *,
        rgb: bool = False,
        skip: bool = True,
    ) -> moderngl.Texture3D:
        """Per cell of the grid: 0 where a sample can be visible, else cells to the nearest such.

        Args:
            ranges: of each channel's cells.
            brick_zyx: voxels of a brick.
            grid: the cells.
            sampled: (nz, ny, nx) bricks of the level in which samples are to be taken.
            classifiers: of each channel.
            rgb: the channels are colours, whose luminance is classified by the first.
            skip: False marks every cell of a sampled brick as visible.
        """
        near, far = self._require_emptiness(grid)
        self._mark(ranges, near, brick_zyx, grid, sampled, classifiers, rgb=rgb, skip=skip)
        if skip:
            program = self._context.program("distance.comp.glsl", REACH=REACH)
            for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1)):
                near.use(0)
                far.bind_to_image(0, read=False, write=True)
                set_uniforms(program, {"nearer": 0, "axis": axis, "cell_count": grid.size_xyz})
                run_over(program, grid.size_xyz)
                self._gl.memory_barrier()
                near, far = far, near
        return near

    def _require_emptiness(self, grid: CellGrid) -> list[moderngl.Texture3D]:
        if not self._emptiness or self._emptiness[0].size != grid.size_xyz:
            self.release()
            for _ in range(2):
                texture = self._gl.texture3d(grid.size_xyz, 1, dtype="u1")
                texture.filter = (self._gl.NEAREST, self._gl.NEAREST)
                self._emptiness.append(texture)
        return self._emptiness

    def _mark(
        self,
        ranges: Sequence[moderngl.Texture3D],
        emptiness: moderngl.Texture3D,
        brick_zyx: Zyx,
        grid: CellGrid,
        sampled: Mask,
        classifiers: Sequence[Classifier],
        *,
        rgb: bool,
        skip: bool,
    ) -> None:
        """0 or REACH + 1 per cell."""
        bricks_box = grid.bricks(brick_zyx)
        part = sampled[bricks_box.slices]
        bricks = self._gl.texture3d(
            part.shape[::-1], 1, np.ascontiguousarray(part, np.uint8).tobytes(), dtype="u1"
        )
        bricks.filter = (self._gl.NEAREST, self._gl.NEAREST)
        program = self._context.program(
            "emptiness.comp.glsl",
            CELL_XYZ=xyz_text(grid.cell_zyx),
            BRICK_XYZ=xyz_text(brick_zyx),
            ENTRIES=TABLE_ENTRIES,
            REACH=REACH,
            CHANNELS=len(ranges),
            RGB=rgb,
        )
        self._bind_opacity(classifiers)
        for unit, texture in enumerate(ranges):
            texture.use(unit)
        bricks.use(len(ranges))
        emptiness.bind_to_image(0, read=False, write=True)
        first = classifiers[0]
        surface = first.surface_stored
        set_uniforms(
            program,
            {
                "cell_range": np.arange(len(ranges)),
                "sampled_bricks": len(ranges),
                "brick_origin": bricks_box.start_zyx[::-1],
                "cell_origin": grid.origin_xyz,
                "cell_count": grid.size_xyz,
                "entries_per_stored": np.array([c.entries_per_stored for c in classifiers]),
                "entry_of_stored_zero": np.array([c.entry_of_stored_zero for c in classifiers]),
                "entry_margin": np.array([c.entry_margin for c in classifiers]),
                "skip_nothing": not skip or first.everything_counts,
                "widened": first.widened,
                "by_surface": surface is not None,
                "surface_stored": surface or (0.0, 0.0),
            },
            some_unused=True,  # of colours, what belongs to the second and third channel
        )
        run_over(program, grid.size_xyz)
        self._gl.memory_barrier()
        bricks.release()

    def _bind_opacity(self, classifiers: Sequence[Classifier]) -> None:
        counts = np.concatenate([classifier.opaque_before for classifier in classifiers])
        if self._opacity is None or self._opacity.size != counts.nbytes:
            if self._opacity is not None:
                self._opacity.release()
            self._opacity = self._gl.buffer(reserve=counts.nbytes)
        self._opacity.write(counts.tobytes())
        self._opacity.bind_to_storage_buffer(0)

    def release(self) -> None:
        """Free the textures; the next slab makes its own."""
        for texture in self._emptiness:
            texture.release()
        self._emptiness.clear()
