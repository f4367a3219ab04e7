"""What Zerobit accepts as an image, a mask, a colour or a position, and what it says otherwise."""

from __future__ import annotations

import operator
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from octobrick.codec.arrays import Voxels, Zyx, require_dtype, require_extents, require_volume
from octobrick.codec.errors import InvalidInputError, UnsupportedError

_COLOUR_DTYPES = ("uint8", "uint16")
_NO_COLOURS = "colours are uint8 or uint16 (z, y, x, 3)"


def require_image(array: Voxels) -> tuple[Voxels, int]:
    """A C-contiguous array in native byte order, and its channels: 1 or 3.

    Raises:
        InvalidInputError: it has neither three axes, nor four of which the last is 3; or none.
        UnsupportedError: a sample type that there is no code for.
    """
    array = np.asarray(array)
    if array.ndim != 4:
        return np.ascontiguousarray(require_volume(array)), 1
    dtype = require_dtype(array.dtype)
    if array.shape[3] != 3 or array.size == 0:
        raise InvalidInputError(
            f"the array has shape {array.shape}; {_NO_COLOURS}, with at least one voxel",
            shape=list(array.shape),
        )
    if dtype.name not in _COLOUR_DTYPES:
        raise UnsupportedError(
            f"Zerobit has no {dtype} colours: {_NO_COLOURS}; encode the channels one by one",
            dtype=str(dtype),
        )
    return np.ascontiguousarray(array, dtype), 3


def require_image_shape(shape: Iterable[int]) -> tuple[int, ...]:
    """(z, y, x) or (z, y, x, 3).

    Raises:
        InvalidInputError: another shape.
    """
    extents = tuple(shape)
    if len(extents) == 4 and extents[3] == 3:
        return (*require_extents(extents[:3], "shape"), 3)
    return require_extents(extents, "shape")


def require_cell_mask(mask: ArrayLike | None, shape: Zyx) -> NDArray[np.bool_] | None:
    """A contiguous boolean array, one per cell of 4³ voxels.

    Raises:
        InvalidInputError: it has another shape or type.
    """
    if mask is None:
        return None
    wanted, cells = np.asarray(mask), tuple(-(-n // 4) for n in shape)
    if wanted.shape != cells or wanted.dtype != np.bool_:
        raise InvalidInputError(
            f"wanted is {wanted.dtype} of shape {wanted.shape}; a volume of {shape} voxels needs a "
            f"bool per cell of 4³ voxels, {cells}",
            expected=list(cells),
            given=list(wanted.shape),
        )
    return np.ascontiguousarray(wanted)


def require_position(zyx: Iterable[int], within: Zyx, what: str) -> Zyx:
    """Three integers (z, y, x) inside of a grid.

    Raises:
        InvalidInputError: there are not three, or one is out of range.
    """
    try:
        at = tuple(operator.index(v) for v in zyx)
    except TypeError as error:
        raise InvalidInputError(f"{what} must be three integers (z, y, x): {error}") from error
    if len(at) != 3 or not all(0 <= v < n for v, n in zip(at, within, strict=True)):
        raise InvalidInputError(
            f"{what} (z, y, x) = {at} is not one of {within}; count from 0",
            given=[str(v) for v in at],
            within=list(within),
        )
    return at


def colour_of(
    value: float | tuple[float, ...], dtype: np.dtype[Any], channels: int
) -> tuple[float, float, float]:
    """A background as three numbers that the sample type has; a single one serves all channels.

    Raises:
        InvalidInputError: it has another number of channels, or the type has no such sample.
    """
    given = np.atleast_1d(np.asarray(value, np.float64))
    if given.shape not in ((1,), (channels,)):
        raise InvalidInputError(f"background is {value}; give one number, or one per channel")
    with np.errstate(over="ignore", invalid="ignore"):  # compared below
        samples = np.clip(given, *_limits(dtype)).astype(dtype)
    if not np.array_equal(samples.astype(np.float64), given):
        raise InvalidInputError(
            f"background is {value}, which no {dtype} sample can be", background=str(value)
        )
    full = np.zeros(3)
    full[:channels] = samples
    return float(full[0]), float(full[1]), float(full[2])


def thread_count(threads: int | None) -> int:
    """What the native code takes: 0 for None."""
    if threads is None:
        return 0
    if not 1 <= threads <= 1024:
        raise InvalidInputError(f"threads is {threads}; give 1 to 1024, or None", threads=threads)
    return threads


def _limits(dtype: np.dtype[Any]) -> tuple[float, float]:
    info: Any = np.finfo(dtype) if dtype.kind == "f" else np.iinfo(dtype)
    return float(info.min), float(info.max)
