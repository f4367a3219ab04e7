"""S3Dc: block-wise, randomly accessible compression of scalar volumes, at a fixed or variable rate.

Yela, Navazo, Vázquez, "S3Dc: A 3Dc-based Volume Compression Algorithm", 2008. The bytes are
specified in docs/spec/s3dc.md and docs/spec/s3dc-variable.md; `octobrick.codec.reference` and
`octobrick.codec.reference_variable` are the same in plain numpy.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import KW_ONLY, dataclass, fields
from typing import TYPE_CHECKING, Literal, Self

import numpy as np
from numpy.typing import DTypeLike, NDArray

from octobrick.codec import _native, metrics
from octobrick.codec.arrays import (
    HALF,
    SAMPLE_DTYPES,
    Voxels,
    Zyx,
    coded_dtype,
    narrowed,
    require_extents,
    require_out,
    require_threads,
    require_volume,
    widened,
)
from octobrick.codec.errors import InvalidInputError
from octobrick.codec.s3dc_faults import cannot_encode, require_sound
from octobrick.codec.s3dc_layout import fixed_layout, grid_of, require_code, variable_layout
from octobrick.codec.s3dc_rule import (
    half_bound,
    native_rule,
    require_fitted,
    require_rule,
    require_scale,
)

if TYPE_CHECKING:
    from typing_extensions import Buffer

# The most by which rounding to float32 changes a number, relative to it, and what the arithmetic
# in float64 before it may add; and the same for denormal numbers, absolute.
_FLOAT32_ROUNDING = 2.0**-24 * (1 + 2.0**-20)
_FLOAT32_TINY = 2.0**-149


@dataclass(frozen=True, slots=True, repr=False)
class S3dc:
    """A block-wise code: each block keeps two end points, each voxel an index between.

    Any voxel can be decoded by itself, so a GPU can keep it compressed. No decoded voxel leaves
    the range of its block (but for rounding where there is a prediction).

    One of `bits`, `max_error`, `bits_per_voxel` and `slope` says how many bits an index has. With
    `bits`, 4 unless told otherwise, all have the same, and the size depends on shape and type
    alone. With the others every block has a width of its own, from none, for one value, to as
    many as a sample has, which copies it.

    An instance is an immutable value; every method is safe to call from many threads, and lets
    other Python threads run meanwhile. Results depend neither on the number of threads nor on the
    machine.

    Args:
        block: voxels per block (z, y, x), each at least 1. Blocks that reach over the volume are
            cut at its faces. Variable widths take blocks of 4³ or 8³ voxels, or other multiples of
            32.
        bits: bits per index, 1 to 8. GPU textures take 1, 2, 4 and 8.
        max_error: no voxel is further off than this, at least 0; blocks get the fewest bits.
        bits_per_voxel: the size, end points and tables included; bits go to the blocks where they
            lower the squared error most.
        slope: bits go wherever each lowers the squared error by this much or more; `balanced`
            finds it for many volumes.
        fitted: whether end points are put where they lower the squared error, instead of at the
            least and the greatest voxel. None fits with `bits_per_voxel` and `slope`. With
            `max_error` they are put where they lower the largest error. `block_ranges` tells the
            true range, for culling.
        scale: "linear" spaces the values between end points evenly; "trained" chooses for each
            block among eight scales that are found for the array (only with `bits`).

    Raises:
        InvalidInputError: a parameter is out of its range, or does not go with another.
    """

    block: Zyx = (8, 8, 8)
    bits: int | None = None
    _: KW_ONLY
    max_error: float | None = None
    bits_per_voxel: float | None = None
    slope: float | None = None
    fitted: bool | None = None
    scale: Literal["linear", "trained"] = "linear"

    def __post_init__(self) -> None:
        object.__setattr__(self, "block", require_extents(self.block, "S3dc block"))
        rule, value = require_rule(self)
        object.__setattr__(self, rule, value)
        object.__setattr__(self, "fitted", require_fitted(self, rule))
        require_scale(self, rule, bool(self.fitted))

    def __repr__(self) -> str:
        named = ((f.name, getattr(self, f.name)) for f in fields(self))
        return (
            f"S3dc({', '.join(f'{k}={v!r}' for k, v in named if v not in (None, False, 'linear'))})"
        )

    @classmethod
    def balanced(
        cls,
        arrays: Iterable[Voxels],
        bits_per_voxel: float,
        *,
        block: Zyx = (8, 8, 8),
        fitted: bool = True,
        predictions: Iterable[Voxels] | None = None,
        threads: int | None = None,
    ) -> Self:
        """A codec with the one `slope` at which arrays together have so many bits per voxel.

        Bricks of a volume, coded with it one by one, get bits where these help most in all of
        them; empty bricks give theirs away.

        Args:
            arrays: of one type; each is looked at once, and not kept.
            bits_per_voxel: for all of them together, to be reached within some percent from below.
            block: of the codec, as is `fitted`.
            predictions: as in `encode`, one for each array.
            threads: as in `encode`.

        Raises:
            InvalidInputError: no arrays, arrays of several types, or too few bits.
            NotFiniteError, UnsupportedError: as `encode`.
        """
        codec = cls(block, bits_per_voxel=bits_per_voxel, fitted=fitted)
        others = None if predictions is None else iter(predictions)
        finder, first = None, None
        for array in arrays:
            array = require_volume(widened(array))
            prediction = _require_prediction(None if others is None else next(others), array)
            if finder is None:
                first = array.dtype
                finder = _native.SlopeFinder(codec.block, fitted, SAMPLE_DTYPES.index(first))
            if array.dtype != first:
                raise InvalidInputError(
                    f"a slope is for one type, but there are arrays of {first} and {array.dtype}"
                )
            outcome = finder.add(array, prediction, require_threads(threads))
            if outcome.status is not _native.Status.OK:
                raise cannot_encode(outcome, array.shape)
        if finder is None:
            raise InvalidInputError("there are no arrays to find a slope for; give at least one")
        assert codec.bits_per_voxel is not None
        slope = finder.slope(codec.bits_per_voxel)
        # Infinite where no block can have an index: only end points fit, or not even these.
        return cls(block, slope=min(slope, np.finfo(np.float64).max), fitted=fitted)

    @property
    def variable(self) -> bool:
        """Whether blocks have widths of their own."""
        return self.bits is None

    def encode(
        self,
        array: Voxels,
        *,
        prediction: Voxels | None = None,
        replace_nonfinite: float | None = None,
        threads: int | None = None,
    ) -> bytes:
        """The code of an array.

        Args:
            array: (z, y, x), of uint8, int8, uint16, int16, float32 or float16 (which is coded as
                float32). Any strides are read in place; only a foreign byte order and float16
                cost a copy.
            prediction: an array of the same shape and type that the decoder will have too, such
                as the upsampled parent level (`reduce.upsample2`) or the time step before. Blocks
                are coded as differences to it where that is better. The code is then of the
                variable form, even with `bits`.
            replace_nonfinite: what stands for NaN and ±Inf; by default they are refused.
            threads: how many may work; None is one, or all processors from 4 MiB on.

        Raises:
            InvalidInputError: not three axes, an empty one, another prediction, or a
                `bits_per_voxel` that end points and tables exceed.
            NotFiniteError: a float32 voxel, or one of the prediction, is NaN or infinite.
            UnsupportedError: another sample type.
        """
        if self.max_error is not None and np.asarray(array).dtype.newbyteorder("=") == HALF:
            floats = _finite(widened(array), replace_nonfinite)
            codec = S3dc(self.block, max_error=half_bound(self.max_error, floats))
            return codec.encode(floats, prediction=prediction, threads=threads)
        array = _finite(require_volume(widened(array)), replace_nonfinite)
        prediction = _require_prediction(prediction, array)
        workers = require_threads(threads)
        if self.variable or prediction is not None:
            rule, value = native_rule(self)
            result = _native.variable_encode(
                array, self.block, rule, value, bool(self.fitted), prediction, workers
            )
        else:
            assert self.bits is not None
            result = _native.encode(
                array,
                self.block,
                self.bits,
                workers,
                fitted=bool(self.fitted),
                scaled=self.scale == "trained",
            )
        if isinstance(result, bytes):
            return result
        raise cannot_encode(result, array.shape)

    def decode(
        self,
        data: Buffer,
        shape: Iterable[int],
        dtype: DTypeLike,
        *,
        prediction: Voxels | None = None,
        out: Voxels | None = None,
        threads: int | None = None,
    ) -> Voxels:
        """The voxels of a code, as a new C-contiguous array unless they have a place.

        Safe for hostile bytes: nothing is allocated before the size is found to be right, or for a
        variable rate at least as long as its tables.

        Args:
            data: what `encode` returned, in any contiguous buffer.
            shape: (z, y, x) of the encoded array.
            dtype: its sample type.
            prediction: what `encode` was given.
            out: where to put them: an array of this shape and type (not float16), of any strides.
            threads: how many may work; None is one, or all processors from 4 MiB on.

        Raises:
            CorruptBrickError: the bytes are not a code of this shape, type and parameters.
            InvalidInputError: a shape that no array has, or another prediction or `out`.
            UnsupportedError: another sample type.
        """
        shape_zyx, sample_dtype = require_extents(shape, "shape"), coded_dtype(dtype)
        predicted = prediction is not None
        view = require_code(self, data, shape_zyx, sample_dtype, predicted=predicted)
        out = require_out(out, shape_zyx, sample_dtype)
        workers = require_threads(threads)
        if self.variable or predicted:
            prediction = _require_prediction(prediction, out)
            outcome = _native.variable_decode_into(view, out, self.block, prediction, workers)
        else:
            assert self.bits is not None
            outcome = _native.decode_into(
                view, out, self.block, self.bits, workers, scaled=self.scale == "trained"
            )
        if outcome.status is _native.Status.NOT_FINITE:
            raise cannot_encode(outcome, shape_zyx)
        require_sound(outcome)
        return narrowed(out, dtype)

    def encoded_nbytes(self, shape: Iterable[int], dtype: DTypeLike) -> int:
        """How long `encode` makes the code of any array of this shape and type.

        Raises:
            InvalidInputError: a shape that no array has, or a variable rate, whose size depends on
                the voxels.
            UnsupportedError: another sample type.
        """
        shape_zyx, sample = require_extents(shape, "shape"), coded_dtype(dtype)
        if self.bits is None:
            raise InvalidInputError(
                f"the size of a code of {self} depends on the voxels; encode them and look"
            )
        return fixed_layout(self, shape_zyx, sample).nbytes

    def end_points_nbytes(self, shape: Iterable[int], dtype: DTypeLike) -> int:
        """How many bytes the end points (MMV) take, which a code begins with.

        Raises:
            InvalidInputError: a shape that no array has.
            UnsupportedError: another sample type.
        """
        shape_zyx, sample = require_extents(shape, "shape"), coded_dtype(dtype)
        return fixed_layout(self, shape_zyx, sample).end_points_nbytes

    def compression_ratio(self, shape: Iterable[int], dtype: DTypeLike) -> float:
        """Bytes of the voxels over bytes of their code, row padding and cut blocks included.

        Where blocks divide the shape and rows need no padding, this is the paper's eq. 5.

        Raises:
            InvalidInputError, UnsupportedError: as `encoded_nbytes`.
        """
        shape_zyx, sample_dtype = require_extents(shape, "shape"), coded_dtype(dtype)
        nbytes = math.prod(shape_zyx) * np.dtype(dtype).itemsize
        return nbytes / self.encoded_nbytes(shape_zyx, sample_dtype)

    def error_bound(self, array: Voxels, *, prediction: Voxels | None = None) -> float:
        """The most by which any decoded voxel of this array can differ from the original.

        With `bits` and end points that are least and greatest, it follows from these: with R the
        widest block's range and L = 2^bits − 1, for integers floor(R/(2L) + 1/2), and 0 if R <= L
        (the paper's eq. 6, for these data); for float32 the largest R/(2L) plus one rounding to
        float32, of any block that is not constant. Otherwise the array is encoded and decoded, and
        the bound is what was found: exactly what any decoder will find.

        Raises:
            InvalidInputError, NotFiniteError, UnsupportedError: as `encode`.
        """
        array = np.asarray(array)
        half = array.dtype.newbyteorder("=") == HALF
        follows = not (self.variable or self.fitted or self.scale == "trained" or half)
        if not follows or prediction is not None:
            code = self.encode(array, prediction=prediction)
            decoded = self.decode(code, array.shape, array.dtype, prediction=prediction)
            return metrics.max_error(array, decoded)
        assert self.bits is not None
        ends, levels = self.block_ranges(array).reshape(-1, 2), 2**self.bits - 1
        if array.dtype.kind == "f":
            low, high = ends.T.astype(np.float64)
            greatest = np.maximum(np.abs(low), np.abs(high))
            rounding = greatest * _FLOAT32_ROUNDING + _FLOAT32_TINY
            bounds = np.where(low < high, (high - low) / (2 * levels) + rounding, 0.0)
            return float(bounds.max())
        widest = int(np.diff(ends.astype(np.int64)).max())
        return float((widest + levels) // (2 * levels) if widest > levels else 0)

    def block_ranges(self, array: Voxels) -> Voxels:
        """The least and the greatest voxel of every block, (nbz, nby, nbx, 2).

        For culling, where the end points in the code are not the range.

        Raises:
            InvalidInputError, NotFiniteError, UnsupportedError: as `encode`.
        """
        given, array = np.asarray(array), require_volume(widened(array))
        code = S3dc(self.block, 1).encode(array)
        nbytes = self.end_points_nbytes(array.shape, array.dtype)
        ends = np.frombuffer(code[:nbytes], array.dtype)
        return narrowed(ends.reshape(*grid_of(self.block, array.shape), 2), given.dtype)

    def block_widths(
        self, data: Buffer, shape: Iterable[int], dtype: DTypeLike, *, predicted: bool = False
    ) -> NDArray[np.uint8]:
        """The bits of an index in every block, (nbz, nby, nbx); those of a sample where it is raw.

        Args:
            data: a code, whose tables are believed.
            shape: (z, y, x) of the encoded array.
            dtype: its sample type.
            predicted: whether it was made with a prediction.

        Raises:
            CorruptBrickError: the code is too short.
            InvalidInputError, UnsupportedError: as `decode`.
        """
        shape_zyx, sample = require_extents(shape, "shape"), coded_dtype(dtype)
        grid = grid_of(self.block, shape_zyx)
        if not (self.variable or predicted):
            return np.full(grid, self.bits, np.uint8)
        view = require_code(self, data, shape_zyx, sample, predicted=predicted)
        layout = variable_layout(self, shape_zyx, sample, predicted)
        words = (layout.flags_begin - layout.groups_begin) // 4
        groups = np.frombuffer(view, "<u4", words, layout.groups_begin).reshape(-1, 2)
        nibbles = groups[:, 1:] >> np.arange(0, 32, 4, dtype=np.uint32) & 15
        widths = nibbles.astype(np.uint8).ravel()[: math.prod(grid)].reshape(grid)
        return np.where(widths == 15, np.uint8(8 * sample.itemsize), widths)


def _require_prediction(prediction: Voxels | None, array: Voxels) -> Voxels | None:
    """The prediction in native byte order."""
    if prediction is None:
        return None
    prediction = require_volume(widened(prediction), "the prediction")
    if prediction.shape != array.shape or prediction.dtype != array.dtype:
        raise InvalidInputError(
            f"the prediction is {prediction.shape} {prediction.dtype}, but the array "
            f"{array.shape} {array.dtype}; give one of the same shape and type",
            prediction_shape=list(prediction.shape),
            shape=list(array.shape),
        )
    return prediction


def _finite(array: Voxels, replacement: float | None) -> Voxels:
    """The array with what is not finite replaced; copied only where there is such a voxel."""
    if replacement is None or array.dtype.kind != "f":
        return array
    value = array.dtype.type(replacement)
    if not np.isfinite(value):
        raise InvalidInputError(
            f"replace_nonfinite is {replacement}; give a number that {array.dtype} can hold"
        )
    finite = np.isfinite(array)
    return array if finite.all() else np.where(finite, array, value)
