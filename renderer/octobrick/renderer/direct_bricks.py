"""All bricks of a picture in one buffer, for rays that decode what they touch: no slab.

The S3Dc paper's own way to render. It needs the whole working set at once, and decodes a voxel
each time that a sample is near it; what it saves is the slab. For comparison, and where memory is
too small for a slab.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from octobrick.codec.errors import UnsupportedError
from octobrick.renderer.brick_codes import BrickCodes
from octobrick.renderer.brick_source import BrickSource
from octobrick.renderer.cells import CellGrid
from octobrick.renderer.classifier import ValueScale
from octobrick.renderer.code_layout import CodeLayout, Values, xyz_text
from octobrick.renderer.context import GraphicsContext
from octobrick.renderer.errors import PictureTooLargeError
from octobrick.renderer.slab_format import SlabFormat
from octobrick.renderer.uniforms import run_over, set_uniforms
from octobrick.store.box import Box, Zyx

if TYPE_CHECKING:
    import moderngl

CODES_BUFFER: Final = 1
SAMPLINGS: Final = {"nearest": 0, "linear": 1, "shared": 2}
"""How voxels are sampled: the nearest; eight of them, each by itself; what they share, once."""


class DirectBricks:
    """The codes of one picture's bricks, and where each lies.

    Args:
        context: where the buffer lives.
        gl: the same, current in this thread.
        budget_nbytes: for the codes.
    """

    def __init__(self, context: GraphicsContext, gl: moderngl.Context, budget_nbytes: int) -> None:
        self._context = context
        self._gl = gl
        limit = int(gl.info["GL_MAX_SHADER_STORAGE_BLOCK_SIZE"])
        self._budget_nbytes = min(budget_nbytes, limit)
        self._codes: moderngl.Buffer | None = None
        self._table: moderngl.Texture3D | None = None
        self._ranges: moderngl.Texture3D | None = None
        self._held: object = None
        self._ranges_of: object = None
        self._layout: CodeLayout | None = None
        self._uniforms: dict[str, Any] = {}
        self.uploaded_nbytes = 0
        """Since this was made."""

    @property
    def nbytes(self) -> int:
        """GPU memory of the codes."""
        return 0 if self._codes is None else int(self._codes.size)

    def load(
        self, source: BrickSource, level: int, t: int, c: int, bricks: Sequence[Zyx]
    ) -> moderngl.Texture3D:
        """Make these bricks, and no others, resident; their table.

        Raises:
            UnsupportedError: another codec than S3Dc at a fixed rate with a linear scale.
            PictureTooLargeError: together they are too large.
            CorruptBrickError: a brick is damaged.
        """
        layout = _checked_layout(source, level)
        held = (source.revision, level, t, c, tuple(bricks))
        if self._table is not None and self._held == held:
            return self._table
        self.release()
        codes = BrickCodes.of_voxels(source, level, t, c)
        brick_nbytes = -(-layout.code_nbytes // 4) * 4
        needed = brick_nbytes * len(bricks)
        if needed > self._budget_nbytes:
            raise PictureTooLargeError(
                f"direct rendering needs all {len(bricks)} bricks at once, {needed} bytes of "
                f"{self._budget_nbytes}; raise memory_budget, show a coarser level, or render by "
                "slabs",
                nbytes=needed,
                budget_nbytes=self._budget_nbytes,
            )
        box = Box.of_shape(source.levels[level].grid_zyx)
        table = np.zeros(box.shape_zyx, np.uint32)
        self._codes = self._gl.buffer(reserve=max(needed, 4))
        at = 0
        for zyx in bricks:
            code = codes.upload(zyx)
            if code is None:
                continue
            self._codes.write(code.ljust(brick_nbytes, b"\0"), offset=at)
            table[zyx] = 1 + at // 4
            at += brick_nbytes
            self.uploaded_nbytes += len(code)
        self._table = self._gl.texture3d(table.shape[::-1], 1, table.tobytes(), dtype="u4")
        self._table.filter = (self._gl.NEAREST, self._gl.NEAREST)
        self._layout, self._held = layout, held
        self._uniforms = _uniforms(source, level)
        return self._table

    def ranges(self, grid: CellGrid) -> moderngl.Texture3D:
        """Pairs of stored values by cell, from the end points of blocks."""
        assert self._layout is not None
        assert self._table is not None
        if self._ranges is not None and self._ranges_of == grid:
            return self._ranges
        if self._ranges is not None:
            self._ranges.release()
        texel = SlabFormat.of(self._layout.sample)
        self._ranges_of = grid
        self._ranges = self._gl.texture3d(grid.size_xyz, 2, dtype=texel.gl_dtype)
        self._ranges.filter = (self._gl.NEAREST, self._gl.NEAREST)
        values = self._layout.sample_values() | {
            "BRICK_XYZ": xyz_text(self._layout.brick_zyx),
            "BLOCK_XYZ": xyz_text(self._layout.block_zyx),
            "CELL_XYZ": xyz_text(grid.cell_zyx),
            "RANGE_FORMAT": texel.range_image,
        }
        program = self._context.program("direct_range.comp.glsl", **values)
        self._ranges.bind_to_image(0, read=False, write=True)
        cells = {"cell_origin": grid.origin_xyz, "cell_count": grid.size_xyz}
        set_uniforms(program, self.bind(0) | cells, some_unused=True)
        run_over(program, grid.size_xyz)
        self._gl.memory_barrier()
        return self._ranges

    def bind(self, unit: int) -> dict[str, Any]:
        """Put the codes and the table where shaders find them; the uniforms that they need."""
        assert self._codes is not None
        assert self._table is not None
        self._codes.bind_to_storage_buffer(CODES_BUFFER)
        self._table.use(unit)
        return {"brick_table": unit, **self._uniforms}

    def shader_values(self, sampling: str) -> Values:
        """What the names in direct.glsl stand for."""
        assert self._layout is not None
        return self._layout.sample_values() | {
            "BITS": self._layout.bits,
            "BRICK_XYZ": xyz_text(self._layout.brick_zyx),
            "BLOCK_XYZ": xyz_text(self._layout.block_zyx),
            "SAMPLING": SAMPLINGS[sampling],
        }

    def release(self) -> None:
        """Free all."""
        for thing in (self._codes, self._table, self._ranges):
            if thing is not None:
                thing.release()
        self._codes = self._table = self._ranges = None
        self._held = None


def _checked_layout(source: BrickSource, level: int) -> CodeLayout:
    layout = CodeLayout.of(source, level)
    scale = getattr(layout.codec, "scale", "linear")
    if layout.form != "s3dc" or scale != "linear":
        raise UnsupportedError(
            f"direct rendering reads S3Dc at a fixed rate with a linear scale, not {layout.form} "
            f"({layout.codec}); render by slabs, or ingest the volume with --bits",
            form=layout.form,
        )
    return layout


def _uniforms(source: BrickSource, level: int) -> dict[str, Any]:
    scale = ValueScale.of(source.dtype, source.value_range)
    shape_zyx = source.levels[level].shape_zyx
    uniforms: dict[str, Any] = {
        "table_origin": (0, 0, 0),
        "fill_stored": scale.to_stored(source.fill_value),
        "last_voxel": [n - 1 for n in reversed(shape_zyx)],
    }
    if np.dtype(source.dtype).kind == "f":
        uniforms["value_range"] = tuple(float(v) for v in source.value_range)
    return uniforms
