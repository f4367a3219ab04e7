"""Finds the cells of a slab in which nothing can be seen, so that rays leap over them.

Exact: a skipped sample would have had an opacity of 0. Three steps, all on the GPU: the range of
voxels of each cell (kept as long as the slab is), which ranges the transfer function lets be seen,
and the distance from each empty cell to the nearest that is not.
"""

from __future__ import annotations

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


class EmptySpace:
    """The textures of the current slab's cells: their ranges and their emptiness."""

    def __init__(self, context: GraphicsContext, gl: moderngl.Context) -> None:
        self._context = context
        self._gl = gl
        self._ranges: moderngl.Texture3D | None = None
        self._ranges_of: object = None
        self._emptiness: list[moderngl.Texture3D] = []
        self._opacity = gl.buffer(reserve=4 * (TABLE_ENTRIES + 1))

    def find(
        self,
        slab: SlabBuffer,
        brick_zyx: Zyx,
        grid: CellGrid,
        sampled: Mask,
        classifier: Classifier,
        *,
        skip: bool = True,
    ) -> moderngl.Texture3D:
        """Per cell of the grid: 0 where a sample can be visible, else cells to the nearest such.

        Args:
            slab: holds the content that the grid covers.
            sampled: (nz, ny, nx) bricks of the level in which samples are to be taken.
            skip: False marks every cell of a sampled brick as visible.
        """
        ranges = self._require_ranges(slab, grid)
        near, far = self._require_emptiness(grid)
        self._mark(ranges, near, brick_zyx, grid, sampled, classifier, skip=skip)
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

    def _require_ranges(self, slab: SlabBuffer, grid: CellGrid) -> moderngl.Texture3D:
        """The range of voxels of each cell; computed only when the slab has changed."""
        contents = (slab.held, slab.held_bricks)
        if self._ranges is not None and self._ranges_of == contents:
            return self._ranges
        self._release_ranges()
        assert slab.texture is not None
        assert slab.format is not None
        assert slab.held is not None
        ranges = self._gl.texture3d(grid.size_xyz, 2, dtype=slab.format.gl_dtype)
        ranges.filter = (self._gl.NEAREST, self._gl.NEAREST)
        content = slab.held.box
        program = self._context.program(
            "cell_range.comp.glsl",
            RANGE_FORMAT=slab.format.range_image,
            CELL_XYZ=xyz_text(grid.cell_zyx),
        )
        slab.texture.use(0)
        ranges.bind_to_image(0, read=False, write=True)
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
        self._ranges, self._ranges_of = ranges, contents
        return ranges

    def _require_emptiness(self, grid: CellGrid) -> list[moderngl.Texture3D]:
        if not self._emptiness or self._emptiness[0].size != grid.size_xyz:
            self._release_emptiness()
            for _ in range(2):
                texture = self._gl.texture3d(grid.size_xyz, 1, dtype="u1")
                texture.filter = (self._gl.NEAREST, self._gl.NEAREST)
                self._emptiness.append(texture)
        return self._emptiness

    def _mark(
        self,
        ranges: moderngl.Texture3D,
        emptiness: moderngl.Texture3D,
        brick_zyx: Zyx,
        grid: CellGrid,
        sampled: Mask,
        classifier: Classifier,
        *,
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
        )
        self._opacity.write(classifier.opaque_before.tobytes())
        self._opacity.bind_to_storage_buffer(0)
        ranges.use(0)
        bricks.use(1)
        emptiness.bind_to_image(0, read=False, write=True)
        set_uniforms(
            program,
            {
                "cell_range": 0,
                "sampled_bricks": 1,
                "brick_origin": bricks_box.start_zyx[::-1],
                "cell_origin": grid.origin_xyz,
                "cell_count": grid.size_xyz,
                "entries_per_stored": classifier.entries_per_stored,
                "entry_of_stored_zero": classifier.entry_of_stored_zero,
                "entry_margin": classifier.entry_margin,
                "skip_nothing": not skip,
            },
        )
        run_over(program, grid.size_xyz)
        self._gl.memory_barrier()
        bricks.release()

    def _release_emptiness(self) -> None:
        for texture in self._emptiness:
            texture.release()
        self._emptiness.clear()

    def forget(self) -> None:
        """Free the textures; the next slab makes its own."""
        self._release_ranges()
        self._release_emptiness()

    def _release_ranges(self) -> None:
        if self._ranges is not None:
            self._ranges.release()
        self._ranges, self._ranges_of = None, None
