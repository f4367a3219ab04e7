"""What the codec accepts as a volume: one place that says yes or no, and why."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from octobrick.codec.errors import InvalidInputError, NotFiniteError, UnsupportedError

Zyx = tuple[int, int, int]
Voxels = NDArray[Any]

SAMPLE_DTYPES = tuple(np.dtype(t) for t in ("uint8", "int8", "uint16", "int16", "float32"))
"""The sample types of the codec, in native byte order."""

HALF = np.dtype(np.float16)

_MAX_EXTENT = 2**62
"""Above any array that can exist, and small enough to reach the native code as an integer."""

# Beyond, a quotient of two sample values could leave the range of float64.
_LEAST_SPACING, _GREATEST_SPACING = 1e-150, 1e150


def require_dtype(dtype: DTypeLike) -> np.dtype[Any]:
    """The sample type in native byte order.

    Raises:
        UnsupportedError: it is none of `SAMPLE_DTYPES`.
    """
    native = np.dtype(dtype).newbyteorder("=")
    if native not in SAMPLE_DTYPES:
        names = ", ".join(d.name for d in SAMPLE_DTYPES)
        raise UnsupportedError(
            f"the codec has no {native} samples; convert the voxels to one of {names}",
            dtype=str(native),
        )
    return native


def coded_dtype(dtype: DTypeLike) -> np.dtype[Any]:
    """The sample type that S3Dc codes for this one: float16, which float32 holds exactly, as that.

    Raises:
        UnsupportedError: it is neither float16 nor one of `SAMPLE_DTYPES`.
    """
    native = np.dtype(dtype).newbyteorder("=")
    return np.dtype(np.float32) if native == HALF else require_dtype(native)


def widened(array: Voxels) -> Voxels:
    """An array of float16 as float32; any other as it is."""
    array = np.asarray(array)
    return array.astype(np.float32) if array.dtype.newbyteorder("=") == HALF else array


def narrowed(array: Voxels, dtype: DTypeLike) -> Voxels:
    """The mirror of `widened`: rounded to float16, within its range, where that is the type."""
    if np.dtype(dtype).newbyteorder("=") != HALF:
        return array
    most = np.float32(np.finfo(HALF).max)
    return np.clip(array, -most, most).astype(HALF)


def require_extents(values: Iterable[int], what: str) -> Zyx:
    """Three positive integers (z, y, x).

    Raises:
        InvalidInputError: there are not three, or one is no integer, below 1 or absurdly large.
    """
    try:
        extents = tuple(operator.index(v) for v in values)
    except TypeError as error:
        raise InvalidInputError(f"{what} must be three integers (z, y, x): {error}") from error
    if len(extents) != 3 or not all(1 <= v <= _MAX_EXTENT for v in extents):
        raise InvalidInputError(
            f"{what} is {extents}; give three integers (z, y, x), each at least 1",
            given=[str(v) for v in extents],
        )
    return extents


def require_spacing(spacing_zyx: Sequence[float]) -> tuple[float, float, float]:
    """The distance of voxels along each axis (z, y, x).

    Raises:
        InvalidInputError: there are not three, or one is not within 1e-150 and 1e150.
    """
    spacing = tuple(float(s) for s in spacing_zyx)
    if len(spacing) != 3 or not all(_LEAST_SPACING <= s <= _GREATEST_SPACING for s in spacing):
        raise InvalidInputError(
            f"spacing_zyx is {spacing}; give three positive distances (z, y, x), each within "
            f"{_LEAST_SPACING:g} and {_GREATEST_SPACING:g}",
            spacing_zyx=[str(s) for s in spacing],
        )
    return spacing


def require_volume(array: Voxels, what: str = "the array") -> Voxels:
    """An array (z, y, x) of a sample type in native byte order; strides stay as they are.

    Only an array of foreign byte order is copied.

    Raises:
        InvalidInputError: it has not three axes, or one is empty.
        UnsupportedError: its type is none of `SAMPLE_DTYPES`.
    """
    array = np.asarray(array)
    dtype = require_dtype(array.dtype)
    if array.ndim != 3 or array.size == 0:
        raise InvalidInputError(
            f"{what} has shape {array.shape}; give three axes (z, y, x) of at least one voxel",
            shape=list(array.shape),
        )
    return array.astype(dtype, copy=False)


def require_out(out: Voxels | None, shape_zyx: Zyx, dtype: np.dtype[Any]) -> Voxels:
    """An array to write voxels into, or a new one.

    Raises:
        InvalidInputError: it has another shape or type, or cannot be written.
    """
    if out is None:
        return np.empty(shape_zyx, dtype)
    if out.shape != shape_zyx or out.dtype != dtype or not out.flags.writeable:
        raise InvalidInputError(
            f"out is {out.shape} {out.dtype}; give a writeable array of {shape_zyx} {dtype}",
            out_shape=list(out.shape),
            shape=list(shape_zyx),
        )
    return out


def contiguous(array: Voxels) -> Voxels:
    """The array C-contiguous, aligned and in native byte order; copied only where it is not so."""
    return np.require(array, array.dtype.newbyteorder("="), ["C_CONTIGUOUS", "ALIGNED"])


def require_threads(threads: int | None) -> int:
    """The number of threads as the native code takes it, where 0 lets it choose.

    Raises:
        InvalidInputError: below 1, or above 1024.
    """
    if threads is None:
        return 0
    if not 1 <= threads <= 1024:
        raise InvalidInputError(f"threads is {threads}; give 1 to 1024, or None", threads=threads)
    return threads


def not_finite(volume: Voxels, index: int, consequence: str) -> NotFiniteError:
    """The error for a voxel that is NaN or infinite, to be raised.

    Args:
        volume: (z, y, x).
        index: of the voxel, z slowest, x fastest.
        consequence: what cannot be done with it, such as "it has no gradient".
    """
    at = tuple(int(i) for i in np.unravel_index(index, volume.shape))
    return NotFiniteError(
        f"voxel (z, y, x) = {at} is {volume[at]}: {consequence}; replace such voxels first, for "
        "instance with the background's value",
        voxel_zyx=list(at),
        value=str(volume[at]),
    )
