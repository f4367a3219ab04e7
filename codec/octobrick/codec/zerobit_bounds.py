"""By how much the voxels of a zerobit code are likely to be wrong: for deblocking."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.zerobit import Zerobit

if TYPE_CHECKING:
    from typing_extensions import Buffer

CELL = 4
"""Voxels of a cell along each axis: the block for the filter."""

_CELLS_PER_UNIT_BLOCK = 4  # along each axis


def zerobit_bounds(codec: Zerobit, data: Buffer) -> NDArray[np.float32]:
    """Twice the threshold of its unit block, for every cell of 4³ voxels.

    The scale of the error, not a bound: zerobit has none. For `rational_bezier`, with blocks of 4³
    and `limit="ramp"`.

    Returns:
        float32 (ncz, ncy, ncx), ceil(n/4) per axis.

    Raises:
        CorruptBrickError: the bytes are not a code with this codebook.
    """
    with np.errstate(over="ignore"):  # beyond float32 it does not limit
        bounds = 2 * codec.block_thresholds(data)
    shape = codec.decode_level(data, 2).shape[:3]
    for axis, cells in enumerate(shape):
        bounds = np.repeat(bounds, _CELLS_PER_UNIT_BLOCK, axis).take(range(cells), axis)
    return bounds
