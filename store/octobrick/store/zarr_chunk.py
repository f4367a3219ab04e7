"""What our codecs of Zarr v3 share: which samples they code, and which chunks are bricks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import InvalidInputError, UnsupportedError
from octobrick.store.box import Zyx

if TYPE_CHECKING:
    from zarr.core.array_spec import ArraySpec
    from zarr.core.buffer import NDBuffer

SUPPORTED_DTYPES = frozenset({"uint8", "int8", "uint16", "int16", "float32"})


def require_array(name: str, shape: tuple[int, ...], dtype: Any) -> np.dtype[Any]:
    """The sample type of an array that the codec of this name can hold.

    Args:
        name: of the codec, for messages.
        shape: of the array.
        dtype: Zarr's data type.

    Raises:
        UnsupportedError: the sample type.
        InvalidInputError: fewer than three axes.
    """
    native: np.dtype[Any] = np.dtype(dtype.to_native_dtype())
    if native.name not in SUPPORTED_DTYPES:
        raise UnsupportedError(
            f"{name}: cannot code {native.name}; convert to one of {sorted(SUPPORTED_DTYPES)}"
        )
    if len(shape) < 3:
        raise InvalidInputError(f"{name}: shape {shape} needs at least the axes z, y, x")
    return native


def brick_shape(name: str, chunk_shape: tuple[int, ...]) -> Zyx:
    """The (z, y, x) of a chunk that is one brick.

    Raises:
        InvalidInputError: an axis before z, y, x is longer than 1.
    """
    *leading, nz, ny, nx = chunk_shape
    if any(n != 1 for n in leading):
        raise InvalidInputError(
            f"{name}: chunk shape {chunk_shape} must be 1 along the axes before z, y, x"
        )
    return nz, ny, nx


def chunk_of(voxels: NDArray[Any], chunk_spec: ArraySpec) -> NDBuffer:
    """Decoded voxels as the chunk that Zarr asked for."""
    chunk = voxels.reshape(chunk_spec.shape)
    return chunk_spec.prototype.nd_buffer.from_ndarray_like(cast("Any", chunk))
