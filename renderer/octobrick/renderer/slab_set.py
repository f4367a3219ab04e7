"""The buffers that hold one slab of all channels of a picture: voxels, and perhaps directions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from octobrick.renderer.cells import CellGrid
from octobrick.renderer.context import GraphicsContext
from octobrick.renderer.empty_space import CellRanges
from octobrick.renderer.filter_margin import FLOAT_NBYTES, filter_margin
from octobrick.renderer.render_request import RenderRequest
from octobrick.renderer.slab_buffer import SlabBuffer
from octobrick.renderer.slab_filler import Filled, SlabContent, SlabFiller
from octobrick.renderer.slab_format import DIRECTIONS, SlabFormat
from octobrick.store.box import Box, Zyx

if TYPE_CHECKING:
    import moderngl


@dataclass(frozen=True, slots=True)
class SlabLayout:
    """What a slab of a picture is made of, the same for all slabs.

    Attributes:
        nchannels: buffers of voxels.
        voxel: their format.
        decoded: the format that voxels are decoded into, before a filter; the same without one.
        directions: whether there are as many buffers of directions.
        sample_margin: voxels around a sample's base that it reads.
        filter_margin_zyx: voxels around those that the deblocking filter reads; 0 without one.
        level_shape_zyx: voxels of the level, beyond which nothing is read.
    """

    nchannels: int
    voxel: SlabFormat
    decoded: SlabFormat
    directions: bool
    sample_margin: int
    filter_margin_zyx: Zyx
    level_shape_zyx: Zyx

    @classmethod
    def of(cls, request: RenderRequest, level: int) -> Self:
        """The layout for a picture at a level."""
        deblocked = request.deblocking is not None
        dtype = np.dtype(request.volume.dtype)
        return cls(
            len(request.channels),
            SlabFormat.of(dtype, deblocked=deblocked),
            SlabFormat.of(dtype),
            request.stored_gradients(level) is not None,
            request.sample_margin(level),
            filter_margin(request.volume.level_codec(level)) if deblocked else (0, 0, 0),
            request.volume.levels[level].shape_zyx,
        )

    @property
    def brick_margin_zyx(self) -> Zyx:
        """Voxels around a sample's base that must be decoded."""
        z, y, x = (self.sample_margin + n for n in self.filter_margin_zyx)
        return (z, y, x)

    def nbytes(self, side_zyx: Zyx) -> int:
        """Memory of all buffers of such a size, and of the filter's."""
        nbytes = self.nchannels * math.prod(side_zyx) * self.voxel.voxel_nbytes
        if self.directions:
            nbytes += self.nchannels * math.prod(side_zyx) * DIRECTIONS.voxel_nbytes
        if any(self.filter_margin_zyx):  # one channel at a time
            read = math.prod(
                min(side + 2 * margin, n)
                for side, margin, n in zip(
                    side_zyx, self.filter_margin_zyx, self.level_shape_zyx, strict=True
                )
            )
            nbytes += read * (self.decoded.voxel_nbytes + FLOAT_NBYTES)  # weights
            nbytes += 2 * math.prod(side_zyx) * FLOAT_NBYTES  # changes and bounds
        return nbytes


class SlabSet:
    """Buffers by channel, kept between pictures.

    Args:
        context: where the textures live.
        gl: the same, current in this thread.
        filler: what decodes bricks into them.
    """

    def __init__(self, context: GraphicsContext, gl: moderngl.Context, filler: SlabFiller) -> None:
        self._context = context
        self._gl = gl
        self._filler = filler
        self._voxels: list[SlabBuffer] = []
        self._ranges: list[CellRanges] = []
        self._directions: list[SlabBuffer] = []

    def fill(
        self,
        request: RenderRequest,
        level: int,
        layout: SlabLayout,
        buffer_zyx: Zyx,
        box: Box,
        bricks: Sequence[Zyx],
    ) -> Filled:
        """Make the buffers hold a box of all channels, as far as it lies in these bricks."""
        self._require(layout, buffer_zyx)
        volume, filled = request.volume, Filled()
        gradients = request.stored_gradients(level)
        for i, channel in enumerate(request.channels):
            content = SlabContent(
                volume.revision, level, request.t, channel.c, box, request.deblocking
            )
            filled.add(self._filler.fill(volume, self._voxels[i], content, bricks))
            if layout.directions:
                plain = SlabContent(volume.revision, level, request.t, channel.c, box)
                filled.add(
                    self._filler.fill_directions(gradients, self._directions[i], plain, bricks)
                )
        return filled

    def cell_ranges(self, layout: SlabLayout, grid: CellGrid) -> list[moderngl.Texture3D]:
        """The range of voxels of each cell, by channel."""
        return [
            ranges.find(slab, grid)
            for ranges, slab in zip(
                self._ranges[: layout.nchannels], self._voxels[: layout.nchannels], strict=True
            )
        ]

    def voxels(self, layout: SlabLayout) -> list[SlabBuffer]:
        """The buffers of the channels' voxels."""
        return self._voxels[: layout.nchannels]

    def directions(self, layout: SlabLayout) -> list[SlabBuffer]:
        """The buffers of the channels' directions; none where the picture needs none."""
        return self._directions[: layout.nchannels] if layout.directions else []

    @property
    def nbytes(self) -> int:
        """GPU memory of all buffers."""
        return sum(slab.nbytes for slab in (*self._voxels, *self._directions))

    def release(self) -> None:
        """Free all textures."""
        for slab in (*self._voxels, *self._directions):
            slab.release_texture()
        for ranges in self._ranges:
            ranges.release()

    def _require(self, layout: SlabLayout, buffer_zyx: Zyx) -> None:
        """Buffers of the right format and size; those that are not used any more are freed."""
        ndirections = layout.nchannels if layout.directions else 0
        for buffers, count in ((self._voxels, layout.nchannels), (self._directions, ndirections)):
            while len(buffers) < count:
                buffers.append(SlabBuffer(self._context, self._gl))
            for unused in buffers[count:]:
                unused.release_texture()
        while len(self._ranges) < layout.nchannels:
            self._ranges.append(CellRanges(self._context, self._gl))
        for slab in self._voxels[: layout.nchannels]:
            slab.require(layout.voxel, buffer_zyx)
        for slab in self._directions[:ndirections]:
            slab.require(DIRECTIONS, buffer_zyx)
