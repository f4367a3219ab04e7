"""What the deblocking filter needs around a box, and of memory: for planning, without GL."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from octobrick.codec import Zerobit
from octobrick.renderer.brick_source import BlockCode
from octobrick.renderer.slab_format import SlabFormat
from octobrick.store.box import Box, Zyx, grid_of

CELL: Final = 4
"""Zerobit's blocks: its cells, voxels along each axis."""
FLOAT_NBYTES: Final = 4
"""Of a weight, of a change and of a bound."""


def filter_block(codec: object) -> Zyx | None:
    """The blocks at whose borders the codes of a codec are filtered; None where they are not."""
    if isinstance(codec, Zerobit):
        return (CELL,) * 3
    return codec.block if isinstance(codec, BlockCode) else None


def filter_margin(codec: object) -> Zyx:
    """How many voxels (z, y, x) around a box the filter reads.

    A voxel becomes a point of a curve through its own block and the one across the nearer border:
    that is at most a block and a half away, less a voxel. Of these it reads the gradients, which
    is a voxel more on every axis. Levels stored raw are not filtered: 0.

    Args:
        codec: of the level, as `BrickSource.level_codec` gives it.
    """
    block = filter_block(codec)
    if block is None:
        return (0, 0, 0)
    z, y, x = (b + b // 2 if b > 1 else 1 for b in block)
    return (z, y, x)


def filtered_box(box: Box, level_shape_zyx: Zyx, codec: object) -> Box:
    """The voxels that filtering a box reads: it with the margin, where the level has voxels."""
    z, y, x = filter_margin(codec)
    (z0, y0, x0), (z1, y1, x1) = box.start_zyx, box.stop_zyx
    grown = Box((z0 - z, y0 - y, x0 - x), (z1 + z, y1 + y, x1 + x))
    return grown.intersect(Box.of_shape(level_shape_zyx))


def block_box(box: Box, block_zyx: Zyx) -> Box:
    """The blocks that a box touches."""
    z, y, x = (a // b for a, b in zip(box.start_zyx, block_zyx, strict=True))
    return Box((z, y, x), grid_of(box.stop_zyx, block_zyx))


def scratch_nbytes(box: Box, level_shape_zyx: Zyx, dtype: np.dtype[Any], codec: object) -> int:
    """GPU memory that filtering a box takes besides the slab that holds the result.

    Args:
        box: the voxels wanted.
        level_shape_zyx: of the level that they are of.
        dtype: of the volume.
        codec: of the level.
    """
    block = filter_block(codec)
    if block is None or not box.nvoxels:
        return 0
    read = filtered_box(box, level_shape_zyx, codec).nvoxels
    decoded = SlabFormat.of(dtype).voxel_nbytes
    floats = box.nvoxels + math.prod(block_box(box, block).shape_zyx)
    return read * (decoded + FLOAT_NBYTES) + floats * FLOAT_NBYTES
