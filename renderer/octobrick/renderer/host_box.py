"""The voxels of one slab on their way to its texture: decoded, filtered, converted. No GL."""

from __future__ import annotations

import threading
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import S3dc, deblock
from octobrick.codec.errors import CorruptBrickError, UnsupportedError
from octobrick.renderer.brick_request import Kind
from octobrick.renderer.brick_source import BrickSource
from octobrick.renderer.filter_margin import filter_block
from octobrick.renderer.host_decoder import HostDecoder, kind_of
from octobrick.renderer.slab_filler import Filled, SlabContent
from octobrick.renderer.stored_values import StoredValues
from octobrick.renderer.substitution import ancestor, covering, enlarged
from octobrick.store.box import Box, Zyx, ceil_div, cell_box, grid_of

Texels = NDArray[Any]

NO_DIRECTION: Final = 128
"""What a component of a voxel without a direction is coded as."""


class Scratch:
    """Memory that slabs are decoded into, one after the other: new pages cost as much as decoding.

    What it holds at first is 0, later any voxels of the type, so that floats are never NaN.
    """

    def __init__(self) -> None:
        self._flat: Texels = np.empty(0, np.uint8)

    def take(self, shape: tuple[int, ...], dtype: np.dtype[Any]) -> Texels:
        """An array, valid until the next is taken."""
        n = int(np.prod(shape))
        if self._flat.dtype != dtype or self._flat.size < n:
            self._flat = np.zeros(n, dtype)
        return self._flat[:n].reshape(shape)

    def release(self) -> None:
        """Give the memory back."""
        self._flat = np.empty(0, np.uint8)


class BoxToFill(Protocol):
    """Texels of a slab that bricks are put into, from several threads at once."""

    filled: Filled
    coarsest: tuple[int, Zyx] | None  # the last level and its grid, where that is to be pinned
    may_be_blank: bool  # whether bricks that nothing can stand for need not be waited for

    def kind_at(self, level: int) -> Kind:
        """Which bytes bricks of a level have."""

    def touches(self, brick_zyx: Zyx) -> bool:
        """Whether any voxel of a brick is needed."""

    def put(self, brick_zyx: Zyx, code: bytes | None) -> None:
        """Decode a brick."""

    def put_coarser(self, brick_zyx: Zyx, nlevels_up: int, code: bytes | None) -> None:
        """Show a brick by its ancestor's code meanwhile."""

    def texels(self) -> Texels:
        """What the texture takes, (z, y, x) or (z, y, x, 4), when all bricks are there."""


class VoxelBox:
    """A `BoxToFill` of voxels.

    Args:
        source: the volume.
        content: of the slab.
        scratch: for voxels, where they are not filtered.

    Raises:
        UnsupportedError: voxels or codes that the renderer does not know, or blocks to be filtered
            that do not divide bricks.
    """

    may_be_blank = False

    def __init__(self, source: BrickSource, content: SlabContent, scratch: Scratch) -> None:
        self.filled = Filled()
        self._source, self._content, self._lock = source, content, threading.Lock()
        self._decoder = HostDecoder(source, content.level)
        last = len(source.levels) - 1
        self.coarsest: tuple[int, Zyx] | None = None
        if content.level < last:
            self.coarsest = (last, source.levels[last].grid_zyx)
        self._brick_zyx, dtype = source.brick_shape_zyx, self._decoder.dtype
        self._values = StoredValues.of(dtype, source.value_range)
        self._block: Zyx | None = None
        self.region = content.box
        if content.deblocking is None:
            self._voxels = scratch.take(content.box.shape_zyx, dtype)
            return
        if self._decoder.kind == "voxels":
            self._block = _whole_blocks(
                filter_block(source.level_codec(content.level)), self._brick_zyx
            )
        if self._block is not None:
            shape = source.levels[content.level].shape_zyx
            self.region = _region_read(content.box, self._block, Box.of_shape(shape))
        # Within the range, so that it looks like a part of the volume to the filter.
        self._voxels = np.full(self.region.shape_zyx, source.value_range[0], dtype)
        if self._block is not None:
            self._bounds = np.zeros(grid_of(self.region.shape_zyx, self._block), np.float32)

    def kind_at(self, level: int) -> Kind:
        """As the volume stores it, or decoded by it."""
        return kind_of(self._source.level_codec(level))

    def touches(self, brick_zyx: Zyx) -> bool:
        """Whether a voxel of the brick is needed, for the filter too."""
        return self._part(brick_zyx).nvoxels > 0

    def put(self, brick_zyx: Zyx, code: bytes | None) -> None:
        """Decode the part of a brick that lies in the box."""
        own = cell_box(brick_zyx, self._brick_zyx)
        part = own.intersect(self.region)
        out = self._voxels[_within(part, self.region)]
        self._decoder.decode(code, brick_zyx, part.shift(_negative(own.start_zyx)), out)
        if self._block is not None:
            self._put_bounds(part, own, self._decoder.bounds(code, brick_zyx, self._block))
        self._finish(part, out, absent=code is None)

    def put_coarser(self, brick_zyx: Zyx, nlevels_up: int, code: bytes | None) -> None:
        """Fill a brick with the voxels that cover it in a coarser one."""
        part, level = self._part(brick_zyx), self._content.level + nlevels_up
        coarse_part = covering(part, nlevels_up)
        coarse_zyx = ancestor(brick_zyx, nlevels_up)
        own = cell_box(coarse_zyx, self._brick_zyx)
        coarse = np.empty(coarse_part.shape_zyx, self._decoder.dtype)
        decoder = HostDecoder(self._source, level)
        decoder.decode(code, coarse_zyx, coarse_part.shift(_negative(own.start_zyx)), coarse)
        out = self._voxels[_within(part, self.region)]
        out[...] = enlarged(coarse, part, nlevels_up)
        self._finish(part, out, substituted=True)
        self.filled.nlevels_up = max(self.filled.nlevels_up, nlevels_up)

    def texels(self) -> Texels:
        """What the slab texture holds of the content's box."""
        if self._content.deblocking is None:
            return self._voxels
        low, high = (float(v) for v in self._source.value_range)
        filtered = self._voxels.astype(np.float32)
        if self._block is not None and low < high:
            codec = self._source.level_codec(self._content.level)
            is_exact = isinstance(codec, S3dc) and not codec.variable
            filtered = deblock.rational_bezier(
                filtered,
                self._block,
                self._content.deblocking,
                self._bounds,
                limit="auto" if is_exact else "ramp",
                value_range=(low, high),
            )
        return self._values.of_filtered(filtered[_within(self._content.box, self.region)])

    def _part(self, brick_zyx: Zyx) -> Box:
        return cell_box(brick_zyx, self._brick_zyx).intersect(self.region)

    def _put_bounds(self, part: Box, own: Box, bounds: NDArray[np.float32]) -> None:
        """The region and bricks begin with whole blocks; at the level's end blocks may be cut."""
        assert self._block is not None
        blocks, first = _blocks_of(part, self._block), _blocks_of(own, self._block).start_zyx
        region = _blocks_of(self.region, self._block)
        self._bounds[_within(blocks, region)] = bounds[blocks.shift(_negative(first)).slices]

    def _finish(
        self, part: Box, out: Texels, *, absent: bool = False, substituted: bool = False
    ) -> None:
        if self._content.deblocking is None:
            self._values.store_in_place(out)
        with self._lock:
            self.filled.add(
                Filled(part.nvoxels, int(not substituted), int(absent), int(substituted))
            )


class DirectionBox:
    """A `BoxToFill` of codes of gradient directions, three bytes and one unused."""

    coarsest: tuple[int, Zyx] | None = None
    may_be_blank = True

    def __init__(self, content: SlabContent, brick_zyx: Zyx, scratch: Scratch) -> None:
        self.filled = Filled()
        self._content, self._brick_zyx, self._lock = content, brick_zyx, threading.Lock()
        self._codes = scratch.take((*content.box.shape_zyx, 4), np.dtype(np.uint8))

    def kind_at(self, level: int) -> Kind:  # noqa: ARG002
        """Codes of directions."""
        return "directions"

    def touches(self, brick_zyx: Zyx) -> bool:
        """Whether a voxel of the brick is needed."""
        return self._part(brick_zyx).nvoxels > 0

    def put(self, brick_zyx: Zyx, code: bytes | None) -> None:
        """Copy the part of a brick that lies in the box."""
        part = self._part(brick_zyx)
        self._copy(brick_zyx, part, code, self._codes[_within(part, self._content.box)][..., :3])
        with self._lock:
            self.filled.add(Filled(part.nvoxels, 1, int(code is None)))

    def put_coarser(self, brick_zyx: Zyx, nlevels_up: int, code: bytes | None) -> None:
        """Fill a brick with the directions that cover it in a coarser one."""
        part = self._part(brick_zyx)
        coarse_part = covering(part, nlevels_up)
        coarse = np.empty((*coarse_part.shape_zyx, 3), np.uint8)
        self._copy(ancestor(brick_zyx, nlevels_up), coarse_part, code, coarse)
        out = self._codes[_within(part, self._content.box)][..., :3]
        out[...] = enlarged(coarse, part, nlevels_up)
        with self._lock:
            self.filled.add(Filled(part.nvoxels, nsubstituted=1))

    def texels(self) -> Texels:
        """Codes of the content's box, (z, y, x, 4)."""
        return self._codes

    def _part(self, brick_zyx: Zyx) -> Box:
        return cell_box(brick_zyx, self._brick_zyx).intersect(self._content.box)

    def _copy(self, brick_zyx: Zyx, part: Box, code: bytes | None, out: Texels) -> None:
        shape = (*self._brick_zyx, 3)
        if code is None:
            out[...] = NO_DIRECTION
            return
        if len(code) != int(np.prod(shape)):
            raise CorruptBrickError(
                f"directions of brick {brick_zyx}: {len(code)} bytes, expected {np.prod(shape)}; "
                "fetch them again or re-ingest the volume",
                brick_zyx=list(brick_zyx),
                nbytes=len(code),
            )
        own = cell_box(brick_zyx, self._brick_zyx)
        inside = part.shift(_negative(own.start_zyx))
        out[...] = np.frombuffer(code, np.uint8).reshape(shape)[inside.slices]


def _whole_blocks(block: Zyx | None, brick: Zyx) -> Zyx | None:
    """The blocks of the level, which must be the same grid in every brick."""
    if block is None:
        return None
    z, y, x = (min(b, n) for b, n in zip(block, brick, strict=True))
    if brick[0] % z or brick[1] % y or brick[2] % x:
        raise UnsupportedError(
            f"blocks of {block} voxels do not divide bricks of {brick}, which deblocking needs; "
            "render without it, or ingest the volume with blocks that do",
            block_zyx=list(block),
            brick_zyx=list(brick),
        )
    return (z, y, x)


def _region_read(box: Box, block: Zyx, level: Box) -> Box:
    """Whole blocks with all that the filter reads for a box of a level."""
    start, stop = [], []
    for a, b, n in zip(box.start_zyx, box.stop_zyx, block, strict=True):
        margin = n + n // 2
        start.append((a - margin) // n * n)
        stop.append(ceil_div(b + margin, n) * n)
    z0, y0, x0 = start
    z1, y1, x1 = stop
    return Box((z0, y0, x0), (z1, y1, x1)).intersect(level)


def _blocks_of(box: Box, block: Zyx) -> Box:
    (z0, y0, x0), (bz, by, bx) = box.start_zyx, block
    z1, y1, x1 = grid_of(box.stop_zyx, block)
    return Box((z0 // bz, y0 // by, x0 // bx), (z1, y1, x1))


def _within(part: Box, whole: Box) -> tuple[slice, slice, slice]:
    """Where a part lies in an array of the whole."""
    return part.shift(_negative(whole.start_zyx)).slices


def _negative(zyx: Zyx) -> Zyx:
    z, y, x = zyx
    return (-z, -y, -x)
