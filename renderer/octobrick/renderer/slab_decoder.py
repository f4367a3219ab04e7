"""Decodes resident bricks into the slab buffer, on the GPU: integers bit for bit as the codec."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from octobrick.renderer.brick_pool import BrickPool, Page, Resident
from octobrick.renderer.brick_source import BrickSource
from octobrick.renderer.classifier import ValueScale
from octobrick.renderer.code_layout import ROWS, CodeLayout
from octobrick.renderer.context import GraphicsContext
from octobrick.renderer.slab_buffer import PARTS_BUFFER, SLAB_IMAGE, SlabBuffer
from octobrick.renderer.slab_filler import Filled, SlabContent
from octobrick.renderer.uniforms import run_over, set_uniforms
from octobrick.store.box import Box, Zyx, cell_box

if TYPE_CHECKING:
    import moderngl

PARTS_MAX: Final = 1024
"""Bricks of one dispatch: 80 KiB of records."""
PART_NBYTES: Final = 80
WORKGROUPS_MAX: Final = 65535
"""Along an axis, what OpenGL promises at least; parts lie behind each other along z."""


class SlabDecoder:
    """Fills a slab buffer with the decoded voxels of bricks."""

    def __init__(self, context: GraphicsContext, gl: moderngl.Context) -> None:
        self._context = context
        self._gl = gl
        self._parts = gl.buffer(reserve=PARTS_MAX * PART_NBYTES)

    def decode(
        self,
        source: BrickSource,
        pool: BrickPool,
        slab: SlabBuffer,
        content: SlabContent,
        bricks: Sequence[Zyx],
    ) -> Filled:
        """Make the slab hold the voxels of the content's box that lie in these bricks.

        What the slab holds elsewhere is left as it was.
        """
        filled, box = Filled(nbricks=len(bricks)), content.box
        for batch in pool.batches(source, content.level, content.t, content.c, bricks):
            groups: dict[tuple[Page | None, Zyx], list[tuple[Resident, Box]]] = defaultdict(list)
            for brick in batch:
                part = cell_box(brick.brick_zyx, source.brick_shape_zyx).intersect(box)
                groups[brick.page, part.shape_zyx].append((brick, part))
                filled.nvoxels += part.nvoxels
                filled.nabsent += brick.page is None
            for (page, _), members in groups.items():
                n = min(PARTS_MAX, WORKGROUPS_MAX // members[0][1].shape_zyx[0])
                for i in range(0, len(members), n):
                    self._dispatch(source, slab, box, page, members[i : i + n])
        self._gl.memory_barrier()
        return filled

    def _dispatch(
        self,
        source: BrickSource,
        slab: SlabBuffer,
        content: Box,
        page: Page | None,
        members: list[tuple[Resident, Box]],
    ) -> None:
        """Decode parts of the same shape from one page."""
        layout = page.layout if page is not None else CodeLayout.of(source, 0)
        run = layout.run
        records = np.zeros((len(members), PART_NBYTES // 16, 4), np.int32)
        for record, (brick, part) in zip(records, members, strict=True):
            brick_box = cell_box(brick.brick_zyx, layout.brick_zyx)
            first = part.shift(_negative(brick_box.start_zyx)).start_zyx
            if page is not None:
                record[0, :3] = page.texel_of(brick.slot, len(layout.parts) - 1)
                record[1, :3] = page.texel_of(brick.slot, 0)
            record[2, :3] = brick_box.shift(_negative(content.start_zyx)).start_zyx[::-1]
            record[3, :3] = (first[2] // run * run, first[1], first[0])
            record[4, :2] = (first[2], first[2] + part.shape_zyx[2])
        # Parts of one shape may start at different places of a run; the widest decides.
        width = int((records[:, 4, 1] - records[:, 3, 0]).max())
        depth, height, _ = members[0][1].shape_zyx
        program = self._program(source, layout, page)
        set_uniforms(program, {"part_size": (width, height, depth)})
        self._parts.write(records.tobytes())
        self._parts.bind_to_storage_buffer(PARTS_BUFFER)
        assert slab.texture is not None
        slab.texture.bind_to_image(SLAB_IMAGE, read=False, write=True)
        run_over(program, (-(-width // run), -(-height // ROWS), depth * len(members)))

    def _program(
        self, source: BrickSource, layout: CodeLayout, page: Page | None
    ) -> moderngl.ComputeShader:
        if page is None:
            scale = ValueScale.of(source.dtype, source.value_range)
            program = self._context.program("fill.comp.glsl", **layout.fill_values())
            set_uniforms(program, {"fill_stored": scale.to_stored(source.fill_value)})
            return program
        name = "decode_raw.comp.glsl" if layout.block_zyx is None else "decode_s3dc.comp.glsl"
        program = self._context.program(name, **layout.decoder_values())
        for unit, (part, texture) in enumerate(zip(layout.parts, page.textures, strict=True)):
            texture.use(unit)
            set_uniforms(program, {part.name: unit})
        if layout.dtype == "float32":
            low, high = source.value_range
            set_uniforms(program, {"value_range": (float(low), float(high))})
        return program

    def release(self) -> None:
        """Free the record buffer."""
        self._parts.release()


def _negative(zyx: Zyx) -> Zyx:
    z, y, x = zyx
    return (-z, -y, -x)
