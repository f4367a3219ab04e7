"""Coarser levels of a volume, made from its voxels."""

from __future__ import annotations

import numpy as np

from octobrick.codec import _native
from octobrick.codec.arrays import Voxels, require_volume


def mean2(array: Voxels) -> Voxels:
    """The volume at half resolution: every voxel is the mean of 2×2×2 finer ones.

    An odd axis gets one coarse voxel more, which averages those that exist. Integers are rounded
    half up, exactly; float32 is summed in float64, in the order that
    `octobrick.codec.reference.mean2` has. NaN and ±Inf spread to the coarse voxel. Thread-safe;
    from 4 MiB on it uses all processors, with the same result.

    Args:
        array: (z, y, x), of uint8, int8, uint16, int16 or float32, with any strides.

    Returns:
        A new C-contiguous array of the same type, each axis halved and rounded up.

    Raises:
        InvalidInputError: not three axes, or an empty one.
        UnsupportedError: another sample type.
    """
    array = require_volume(array)
    coarse: Voxels = np.empty([-(-n // 2) for n in array.shape], array.dtype)
    reduced = _native.mean2_into(array, coarse)
    assert reduced, (array.shape, coarse.shape)
    return coarse
