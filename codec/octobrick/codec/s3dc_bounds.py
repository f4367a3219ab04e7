"""By how much the voxels of an S3Dc code can be wrong: for deblocking, which must not exceed it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from octobrick.codec.arrays import Zyx, coded_dtype, require_extents
from octobrick.codec.errors import CorruptBrickError
from octobrick.codec.s3dc import S3dc
from octobrick.codec.s3dc_layout import variable_layout

if TYPE_CHECKING:
    from typing_extensions import Buffer


def s3dc_bounds(
    codec: S3dc,
    data: Buffer,
    shape: Iterable[int],
    dtype: DTypeLike,
    *,
    predicted: bool = False,
) -> NDArray[np.float32]:
    """The greatest error of each block of an S3Dc code, from its end points and widths.

    Half a step between levels: (max − min) / (2·(2^bits − 1)); 0 for integers whose block has no
    more values than indices, and for raw blocks, as they are exact. Rounding to the sample type,
    at most 1/2 for integers, is left out: the filter works before it. For `rational_bezier`.

    Where end points are fitted this is the scale of the error, and not its bound. Blocks of a
    single value, which tell nothing, have `max_error` where there is one, else the median of the
    other blocks' bounds: where bits were spent for the least error, it is about the same in all
    blocks, and where most are exact, so are these.

    Args:
        codec: what made the code.
        data: the code.
        shape: (z, y, x) of the encoded array.
        dtype: its sample type.
        predicted: whether it was made with a prediction.

    Returns:
        float32 (nbz, nby, nbx).

    Raises:
        CorruptBrickError: the code is too short, or has end points that no code has.
        InvalidInputError: a shape that no array has.
        UnsupportedError: another sample type.
    """
    sample, shape_zyx = coded_dtype(dtype), require_extents(shape, "shape")
    view = memoryview(data).cast("B")
    nbytes, given = codec.end_points_nbytes(shape_zyx, sample), view.nbytes
    if given < nbytes:
        raise CorruptBrickError(
            f"the end points of {shape_zyx} {sample} voxels with {codec} have {nbytes} bytes, but "
            f"{given} were given; fetch them again, or check shape and parameters",
            expected_nbytes=nbytes,
            given_nbytes=given,
        )
    widths = codec.block_widths(view, shape_zyx, sample, predicted=predicted)
    extent = _extents(view[:nbytes], sample, widths.shape)
    if predicted:
        extent = _predicted_extents(codec, view, shape_zyx, sample, extent)
    if not (extent >= 0).all() or not np.isfinite(extent).all():
        raise CorruptBrickError(
            "a block's minimum is above its maximum, or not finite: not what encode writes; "
            "fetch the bytes again"
        )
    if codec.scale == "trained":
        half_steps: NDArray[np.float64] = extent * _widest_steps(codec, view, widths.shape) / 2
        return _narrow(half_steps)
    levels = 2.0 ** np.minimum(widths, 16) - 1
    bounds: NDArray[np.float64] = extent / (2 * np.maximum(levels, 1))
    if sample.kind != "f":
        bounds[extent <= levels] = 0
    if codec.variable or predicted:
        bounds = _without_steps(codec, widths, bounds, 8 * sample.itemsize)
    return _narrow(bounds)


def _narrow(bounds: NDArray[np.float64]) -> NDArray[np.float32]:
    """As float32: a `max_error` may be beyond it, and no voxel can be as far off."""
    return np.minimum(bounds, np.finfo(np.float32).max).astype(np.float32)


def _extents(ends: memoryview, sample: np.dtype[Any], grid: tuple[int, ...]) -> NDArray[np.float64]:
    """Last end point less first, of every block."""
    pairs = np.frombuffer(ends, sample.newbyteorder("<")).reshape(*grid, 2).astype(np.float64)
    with np.errstate(invalid="ignore"):  # inf - inf is NaN, which the caller refuses
        difference: NDArray[np.float64] = pairs[..., 1] - pairs[..., 0]
    return difference


def _predicted_extents(
    codec: S3dc, view: memoryview, shape: Zyx, sample: np.dtype[Any], extent: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The same with the signed end points of blocks that are coded as differences."""
    layout = variable_layout(codec, shape, sample, True)
    flag_bytes = np.frombuffer(view[layout.flags_begin : layout.payload_begin], np.uint8)
    bits = np.unpackbits(flag_bytes, bitorder="little")
    flags = bits[: extent.size].reshape(extent.shape) != 0
    signed = np.dtype(sample.str.replace("u", "i"))
    nbytes = codec.end_points_nbytes(shape, sample)
    return np.where(flags, _extents(view[:nbytes], signed, extent.shape), extent)


def _widest_steps(codec: S3dc, view: memoryview, grid: tuple[int, ...]) -> NDArray[np.float64]:
    """The widest step of each block's scale, as a part of its range."""
    assert codec.bits is not None
    blocks = int(np.prod(grid))
    choices_nbytes, indices = (blocks + 1) // 2, 2**codec.bits
    begin = view.nbytes - choices_nbytes - 16 * indices
    if begin < 0:
        raise CorruptBrickError("the code ends before its scales; fetch the bytes again")
    positions = np.frombuffer(view, "<u2", 8 * indices, begin).reshape(8, indices)
    steps = np.diff(positions.astype(np.float64), axis=1).max(axis=1) / 65535
    pairs = np.frombuffer(view, np.uint8, choices_nbytes, view.nbytes - choices_nbytes)
    choices = np.stack([pairs & 7, pairs >> 4 & 7], -1).ravel()[:blocks].reshape(grid)
    widest: NDArray[np.float64] = steps[choices]
    return widest


def _without_steps(
    codec: S3dc, widths: NDArray[np.uint8], bounds: NDArray[np.float64], raw: int
) -> NDArray[np.float64]:
    """Bounds with those of raw blocks, which are exact, and of blocks with a single value."""
    bounds = np.where((widths == raw) & (widths > 8), 0.0, bounds)
    if codec.max_error is not None:
        return np.where(widths == 0, codec.max_error, np.minimum(bounds, codec.max_error))
    stepped = bounds[widths > 0]
    return np.where(widths == 0, np.median(stepped) if stepped.size else 0.0, bounds)
