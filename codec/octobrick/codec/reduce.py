"""Coarser levels of a volume, made from its voxels; and back, as far as that goes."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from octobrick.codec import _native
from octobrick.codec.arrays import (
    Voxels,
    narrowed,
    require_extents,
    require_volume,
    widened,
)
from octobrick.codec.errors import InvalidInputError


def mean2(array: Voxels) -> Voxels:
    """The volume at half resolution: every voxel is the mean of 2×2×2 finer ones.

    An odd axis gets one coarse voxel more, which averages those that exist. Integers are rounded
    half up, exactly; float32 is summed in float64, in the order that
    `octobrick.codec.reference.mean2` has. NaN and ±Inf spread to the coarse voxel. Thread-safe;
    from 4 MiB on it uses all processors, with the same result.

    Args:
        array: (z, y, x), of uint8, int8, uint16, int16, float32 or float16 (worked as float32, then
            rounded), with any strides.

    Returns:
        A new C-contiguous array of the same type, each axis halved and rounded up.

    Raises:
        InvalidInputError: not three axes, or an empty one.
        UnsupportedError: another sample type.
    """
    given, array = np.asarray(array), require_volume(widened(array))
    coarse: Voxels = np.empty([-(-n // 2) for n in array.shape], array.dtype)
    reduced = _native.mean2_into(array, coarse)
    assert reduced, (array.shape, coarse.shape)
    return narrowed(coarse, given.dtype)


def upsample2(coarse: Voxels, shape: Iterable[int]) -> Voxels:
    """A volume at twice the resolution, interpolated: what a coarser level says of a finer one.

    Coarse voxels lie in the middle of 2×2×2 finer ones, as `mean2` makes them, and are
    interpolated linearly, with the outermost ones repeated beyond the faces. Integers are rounded
    half up, exactly; float32 is interpolated in float64, in the order that
    `octobrick.codec.reference.upsample2` has: so every decoder gets the same prediction. NaN and
    ±Inf spread. Thread-safe; from 4 MiB on it uses all processors, with the same result.

    Args:
        coarse: (z, y, x), of the types that `mean2` takes, with any strides.
        shape: (z, y, x) of the result, whose half, rounded up, is the shape of `coarse`.

    Returns:
        A new C-contiguous array of the same type.

    Raises:
        InvalidInputError: not three axes, an empty one, or a shape that does not fit.
        UnsupportedError: another sample type.
    """
    given, shape_zyx = np.asarray(coarse), require_extents(shape, "shape")
    coarse = require_volume(widened(given))
    if coarse.shape != tuple(-(-n // 2) for n in shape_zyx):
        raise InvalidInputError(
            f"a volume of {coarse.shape} voxels is not half of {shape_zyx}, rounded up; give the "
            "shape of the level above",
            coarse_shape=list(coarse.shape),
            shape=list(shape_zyx),
        )
    fine: Voxels = np.empty(shape_zyx, coarse.dtype)
    upsampled = _native.upsample2_into(coarse, fine)
    assert upsampled, (coarse.shape, fine.shape)
    return narrowed(fine, given.dtype)


def max2(array: Voxels) -> Voxels:
    """The volume at half resolution: every voxel is the greatest of 2×2×2 finer ones.

    Args:
        array: (z, y, x), of any type that has an order.

    Returns:
        A new C-contiguous array of the same type, each axis halved and rounded up.

    Raises:
        InvalidInputError: not three axes, or an empty one.
    """
    return np.ascontiguousarray(_eight(array).max(axis=0))


def min2(array: Voxels) -> Voxels:
    """The volume at half resolution: every voxel is the least of 2×2×2 finer ones; see `max2`."""
    return np.ascontiguousarray(_eight(array).min(axis=0))


def nearest2(array: Voxels) -> Voxels:
    """The volume at half resolution: every voxel is the first of 2×2×2 finer ones; see `max2`."""
    first: Voxels = np.ascontiguousarray(_eight(array)[0])
    return first


def mode2(array: Voxels) -> Voxels:
    """The volume at half resolution: the most frequent of 2×2×2 finer voxels, for labels.

    Of several that are equally frequent the least is taken. Otherwise as `max2`.
    """
    eight = np.sort(_eight(array), axis=0)
    best: Voxels = eight[0].copy()
    most = np.zeros(eight.shape[1:], np.uint8)
    for value in eight:
        count = (eight == value).sum(axis=0, dtype=np.uint8)
        better = count > most
        best[better], most[better] = value[better], count[better]
    return best


def _eight(array: Voxels) -> Voxels:
    """The 2×2×2 finer voxels of each coarse one, (8, z, y, x); the last of an odd axis twice."""
    array = np.asarray(array)
    if array.ndim != 3 or array.size == 0:
        raise InvalidInputError(
            f"the volume has shape {array.shape}; give (z, y, x), each axis of at least 1",
            shape=list(array.shape),
        )
    array = np.pad(array, [(0, n % 2) for n in array.shape], mode="edge")
    nz, ny, nx = (n // 2 for n in array.shape)
    eight: Voxels = array.reshape(nz, 2, ny, 2, nx, 2).transpose(1, 3, 5, 0, 2, 4)
    return eight.reshape(8, nz, ny, nx)
