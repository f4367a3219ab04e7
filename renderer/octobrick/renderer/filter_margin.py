"""How far around a voxel the deblocking filter reads: no GL, only sizes."""

from __future__ import annotations

from octobrick.codec import Zerobit
from octobrick.codec.zerobit_bounds import CELL
from octobrick.renderer.brick_source import BlockCode
from octobrick.store.box import Zyx


def filter_block(codec: object) -> Zyx | None:
    """The blocks that a codec's voxels are coded in; None where there are no borders to smooth."""
    if isinstance(codec, Zerobit):
        return (CELL, CELL, CELL)
    return codec.block if isinstance(codec, BlockCode) else None


def filter_margin(codec: object) -> Zyx:
    """Voxels around a box that the filter reads, along each axis; 0 where it does nothing.

    The half of a block beside a border moves onto a curve through all of the next block, whose
    weights are gradients: ⌊b/2⌋ − 1 voxels to the border at most, b of the next block, and 1.
    """
    block = filter_block(codec)
    if block is None:
        return (0, 0, 0)
    z, y, x = (b + b // 2 for b in block)
    return (z, y, x)
