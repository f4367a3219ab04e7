"""Decodes resident bricks into a texture, on the GPU: integers bit for bit as the codec."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import Zerobit
from octobrick.renderer.brick_codes import BrickCodes
from octobrick.renderer.brick_pool import BrickPool, Page, Resident
from octobrick.renderer.code_layout import ROWS, RUN_MAX, CodeLayout, fill_values
from octobrick.renderer.context import GraphicsContext
from octobrick.renderer.slab_buffer import PARTS_BUFFER, SLAB_IMAGE
from octobrick.renderer.slab_filler import Filled
from octobrick.renderer.slab_format import SlabFormat
from octobrick.renderer.uniforms import run_over, set_uniforms
from octobrick.store.box import Box, Zyx, ceil_div

if TYPE_CHECKING:
    import moderngl

CODES_BUFFER: Final = 1
CODEBOOK_BUFFER: Final = 2
PARTS_MAX: Final = 1024
"""Bricks of one dispatch: 80 KiB of records."""
PART_NBYTES: Final = 80
WORKGROUPS_MAX: Final = 65535
"""Along an axis, what OpenGL promises at least; parts lie behind each other along z."""
WORD_NBYTES: Final = 4
ZEROBIT_HEADER_NBYTES: Final = 64
"""Where a codebook begins that is in a code (docs/spec/zerobit.md)."""
SHARED_HEADER_NBYTES: Final = 16
"""Where the codewords begin in one that many codes share."""


@dataclass(frozen=True, slots=True)
class Target:
    """What is decoded into.

    Attributes:
        texture: with the box's first cell in its first texel.
        texel: the texture's format.
        box: the cells that are wanted: voxels, or blocks.
        fill_stored: what those of absent bricks become.
    """

    texture: moderngl.Texture3D
    texel: SlabFormat
    box: Box
    fill_stored: float


@dataclass(frozen=True, slots=True)
class Kernel:
    """A program that writes the cells of bricks, and how it is spread over them.

    Attributes:
        program: ready to run but for the bricks.
        brick_zyx: cells of a brick.
        per_invocation_zyx: cells that one invocation writes.
    """

    program: moderngl.ComputeShader
    brick_zyx: Zyx
    per_invocation_zyx: Zyx


BatchDone = Callable[[Sequence[Resident]], None]


@dataclass(frozen=True, slots=True)
class Parts:
    """What of some bricks lies in a box: rows (z, y, x) by brick.

    Attributes:
        places: of the bricks in the level's grid.
        starts: first cell of each part.
        shapes: cells of each part; 0 or less where the brick does not touch the box.
        offsets: of each brick's first byte in its page.
    """

    places: NDArray[np.int64]
    starts: NDArray[np.int64]
    shapes: NDArray[np.int64]
    offsets: NDArray[np.int64]

    @property
    def nvoxels(self) -> int:
        """Cells of all parts."""
        return int(np.maximum(self.shapes, 0).prod(axis=1).sum())

    def of(self, rows: NDArray[np.intp]) -> Parts:
        """Some of them."""
        return Parts(self.places[rows], self.starts[rows], self.shapes[rows], self.offsets[rows])

    def groups(self, batch: Sequence[Resident]) -> Iterator[tuple[Page | None, NDArray[np.intp]]]:
        """Rows of the same page and shape, without those that have no cell in the box."""
        pages: dict[Page | None, int] = {}
        numbers = np.array([pages.setdefault(brick.page, len(pages)) for brick in batch])
        by_number = list(pages)
        touching = np.flatnonzero((self.shapes > 0).all(axis=1))
        keys = np.column_stack([numbers[touching], self.shapes[touching]])
        kinds, members = np.unique(keys, axis=0, return_inverse=True)
        for i, kind in enumerate(kinds):
            yield by_number[kind[0]], touching[members.ravel() == i]


def _parts_of(batch: Sequence[Resident], brick_zyx: Zyx, box: Box) -> Parts:
    places = np.array([brick.brick_zyx for brick in batch], np.int64).reshape(-1, 3)
    low = places * brick_zyx
    starts = np.maximum(low, box.start_zyx)
    shapes = np.minimum(low + brick_zyx, box.stop_zyx) - starts
    offsets = np.array([brick.offset_nbytes for brick in batch], np.int64)
    return Parts(places, starts, shapes, offsets)


class SlabDecoder:
    """Fills textures with the decoded voxels of bricks.

    Args:
        context: where the textures live.
        gl: the same, current in this thread.
    """

    def __init__(self, context: GraphicsContext, gl: moderngl.Context) -> None:
        self._context = context
        self._gl = gl
        self._parts = gl.buffer(reserve=PARTS_MAX * PART_NBYTES)
        self._codebook: tuple[bytes, moderngl.Buffer] | None = None

    def decode(
        self,
        codes: BrickCodes,
        pool: BrickPool,
        target: Target,
        value_range: tuple[float, float],
        bricks: Sequence[Zyx],
        batch_done: BatchDone | None = None,
    ) -> Filled:
        """Make the texture hold the voxels of the target's box that lie in these bricks.

        What the texture holds elsewhere is left as it was.

        Args:
            codes: of the bricks.
            pool: where they are, or are brought.
            target: what is decoded into.
            value_range: of a volume of float32: what is stored as 0 and 1.
            bricks: which.
            batch_done: called when the decoding of some was asked for, and they are still resident.
        """
        filled, layout = Filled(nbricks=len(bricks)), codes.layout
        program = self._context.program(layout.decoder, **layout.decoder_values(target.texel))
        if layout.dtype == "float32":
            set_uniforms(program, {"value_range": value_range})
        kernel = Kernel(program, layout.brick_zyx, layout.per_invocation_zyx)
        for batch in pool.batches(codes, bricks):
            filled.nvoxels += _parts_of(batch, layout.brick_zyx, target.box).nvoxels
            filled.nabsent += sum(brick.page is None for brick in batch)
            self.run(kernel, layout, target, batch)
            if batch_done is not None:
                batch_done(batch)
        self._gl.memory_barrier()
        return filled

    def fill(self, layout: CodeLayout, target: Target, bricks: Sequence[Zyx]) -> None:
        """Make these bricks what absent ones are."""
        kernel = Kernel(self._fill_program(target), layout.brick_zyx, (1, ROWS, RUN_MAX))
        self.run(kernel, layout, target, [Resident(zyx, None, 0) for zyx in bricks])
        self._gl.memory_barrier()

    def run(
        self, kernel: Kernel, layout: CodeLayout, target: Target, batch: Sequence[Resident]
    ) -> None:
        """Write the wanted cells of resident bricks, and fill those of absent ones.

        Bricks of a page whose parts have the same shape go together.
        """
        parts = _parts_of(batch, kernel.brick_zyx, target.box)
        target.texture.bind_to_image(SLAB_IMAGE, read=False, write=True)
        for page, members in parts.groups(batch):
            if page is None:
                program = self._fill_program(target)
                ready = Kernel(program, kernel.brick_zyx, (1, ROWS, RUN_MAX))
            else:
                ready = kernel
                self._bind(layout, page)
            deepest = int(parts.shapes[members[0], 0]) + 2 * ready.per_invocation_zyx[0]
            n = min(PARTS_MAX, WORKGROUPS_MAX // deepest)
            for i in range(0, len(members), n):
                self._dispatch(ready, layout, target.box, parts.of(members[i : i + n]))

    def _dispatch(self, kernel: Kernel, layout: CodeLayout, box: Box, parts: Parts) -> None:
        """Handle parts of the same shape from one page."""
        step = np.array(kernel.per_invocation_zyx)
        bricks = parts.places * kernel.brick_zyx
        first = parts.starts - bricks
        stop = first + parts.shapes
        aligned = first // step * step
        records = np.zeros((len(bricks), PART_NBYTES // 16, 4), np.int32)
        records[:, 0, 0] = parts.offsets // WORD_NBYTES
        records[:, 0, 1] = self._codebook_word(layout, parts.offsets)
        records[:, 1, 0], records[:, 1, 1] = first[:, 1], stop[:, 1]
        records[:, 1, 2], records[:, 1, 3] = first[:, 0], stop[:, 0]
        records[:, 2, :3] = (bricks - box.start_zyx)[:, ::-1]
        records[:, 3, :3] = aligned[:, ::-1]
        records[:, 4, 0], records[:, 4, 1] = first[:, 2], stop[:, 2]
        # Parts of one shape may start at different places of an invocation; the widest decides.
        depth, height, width = (int(n) for n in (stop - aligned).max(axis=0))
        dz, dy, dx = kernel.per_invocation_zyx
        depth = ceil_div(depth, dz) * dz
        set_uniforms(kernel.program, {"part_size": (width, height, depth)})
        self._parts.write(records.tobytes())
        self._parts.bind_to_storage_buffer(PARTS_BUFFER)
        invocations = (ceil_div(width, dx), ceil_div(height, dy), depth // dz * len(bricks))
        run_over(kernel.program, invocations)

    @staticmethod
    def _codebook_word(layout: CodeLayout, offsets: np.ndarray) -> np.ndarray | int:
        """The first codeword: in the code, or in what the codes share."""
        if isinstance(layout.codec, Zerobit) and layout.codec.codebook is not None:
            return SHARED_HEADER_NBYTES // WORD_NBYTES
        return (offsets + ZEROBIT_HEADER_NBYTES) // WORD_NBYTES

    def _bind(self, layout: CodeLayout, page: Page) -> None:
        """Let the shader see the bytes of a page, and the codebook."""
        page.buffer.bind_to_storage_buffer(CODES_BUFFER)
        if not isinstance(layout.codec, Zerobit):
            return
        if layout.codec.codebook is None:
            page.buffer.bind_to_storage_buffer(CODEBOOK_BUFFER)
            return
        data = layout.codec.codebook.data
        if self._codebook is None or self._codebook[0] != data:
            if self._codebook is not None:
                self._codebook[1].release()
            padded = data.ljust(ceil_div(len(data), WORD_NBYTES) * WORD_NBYTES, b"\0")
            self._codebook = (data, self._gl.buffer(padded))
        self._codebook[1].bind_to_storage_buffer(CODEBOOK_BUFFER)

    def _fill_program(self, target: Target) -> moderngl.ComputeShader:
        program = self._context.program("fill.comp.glsl", **fill_values(target.texel))
        set_uniforms(program, {"fill_stored": target.fill_stored})
        return program

    def release(self) -> None:
        """Free the buffers."""
        self._parts.release()
        if self._codebook is not None:
            self._codebook[1].release()
            self._codebook = None
