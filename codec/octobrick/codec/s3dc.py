"""S3Dc: fixed-rate, randomly accessible compression of scalar volumes.

Yela, Navazo, Vázquez, "S3Dc: A 3Dc-based Volume Compression Algorithm", 2008. The bytes are
specified in docs/spec/s3dc.md; `octobrick.codec.reference` is the same in plain numpy.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import DTypeLike

from octobrick.codec import _native
from octobrick.codec.arrays import (
    Voxels,
    Zyx,
    require_dtype,
    require_extents,
    require_threads,
    require_volume,
)
from octobrick.codec.errors import CorruptBrickError, InvalidInputError, NotFiniteError

if TYPE_CHECKING:
    from typing_extensions import Buffer

# The most by which rounding to float32 changes a number, relative to it, and what the arithmetic
# in float64 before it may add; and the same for denormal numbers, absolute.
_FLOAT32_ROUNDING = 2.0**-24 * (1 + 2.0**-20)
_FLOAT32_TINY = 2.0**-149


@dataclass(frozen=True, slots=True)
class S3dc:
    """A block-wise code: each block keeps its minimum and maximum, each voxel an index between.

    The code's size depends on shape, type and these parameters alone, and any voxel can be
    decoded by itself, so a GPU can keep it compressed. Every decoded voxel lies within its
    block's minimum and maximum, at most `error_bound` away from the original.

    An instance is an immutable value; every method is safe to call from many threads, and lets
    other Python threads run meanwhile. Results depend neither on the number of threads nor on the
    machine.

    Args:
        block: voxels per block (z, y, x), each at least 1. Blocks that reach over the volume are
            cut at its faces.
        bits: bits per index, 1 to 8. GPU textures take 1, 2, 4 and 8.

    Raises:
        InvalidInputError: a parameter is out of its range.
    """

    block: Zyx = (8, 8, 8)
    bits: int = 4

    def __post_init__(self) -> None:
        object.__setattr__(self, "block", require_extents(self.block, "S3dc block"))
        try:
            bits = operator.index(self.bits)
        except TypeError as error:
            raise InvalidInputError(f"S3dc bits must be an integer: {error}") from error
        if not 1 <= bits <= 8:
            raise InvalidInputError(f"S3dc bits is {bits}; give 1 to 8 bits per index", bits=bits)
        object.__setattr__(self, "bits", bits)

    def encode(self, array: Voxels, *, threads: int | None = None) -> bytes:
        """The code of an array.

        Args:
            array: (z, y, x), of uint8, int8, uint16, int16 or float32. Any strides are read in
                place; only a foreign byte order costs a copy.
            threads: how many may work; None is one, or all processors from 4 MiB on.

        Raises:
            InvalidInputError: not three axes, or an empty one.
            NotFiniteError: a float32 voxel is NaN or infinite.
            UnsupportedError: another sample type.
        """
        array = require_volume(array)
        result = _native.encode(array, self.block, self.bits, require_threads(threads))
        if isinstance(result, bytes):
            return result
        if result.status is _native.Status.NOT_FINITE:
            raise NotFiniteError(
                f"voxel (z, y, x) = {result.at} is {result.first}: S3dc encodes finite numbers; "
                "replace such voxels first, for instance with the background's value",
                voxel_zyx=list(result.at),
                value=str(result.first),
            )
        raise _too_large(array.shape)

    def decode(
        self, data: Buffer, shape: Iterable[int], dtype: DTypeLike, *, threads: int | None = None
    ) -> Voxels:
        """The voxels of a code, as a new C-contiguous array.

        Safe for hostile bytes: nothing is allocated before the size is found to be right.

        Args:
            data: what `encode` returned, in any contiguous buffer.
            shape: (z, y, x) of the encoded array.
            dtype: its sample type.
            threads: how many may work; None is one, or all processors from 4 MiB on.

        Raises:
            CorruptBrickError: the bytes are not a code of this shape, type and parameters.
            InvalidInputError: a shape that no array has.
            UnsupportedError: another sample type.
        """
        shape_zyx, sample_dtype = require_extents(shape, "shape"), require_dtype(dtype)
        view = require_code(self, data, shape_zyx, sample_dtype)
        out: Voxels = np.empty(shape_zyx, sample_dtype)
        outcome = _native.decode_into(view, out, self.block, self.bits, require_threads(threads))
        require_sound(outcome)
        return out

    def encoded_nbytes(self, shape: Iterable[int], dtype: DTypeLike) -> int:
        """How long `encode` makes the code of any array of this shape and type.

        Raises:
            InvalidInputError: a shape that no array has.
            UnsupportedError: another sample type.
        """
        return self._layout_nbytes(shape, dtype)[1]

    def end_points_nbytes(self, shape: Iterable[int], dtype: DTypeLike) -> int:
        """How many bytes the end points (MMV) take: the offset of the indices (IV) in the code.

        Raises:
            InvalidInputError: a shape that no array has.
            UnsupportedError: another sample type.
        """
        return self._layout_nbytes(shape, dtype)[0]

    def compression_ratio(self, shape: Iterable[int], dtype: DTypeLike) -> float:
        """Bytes of the voxels over bytes of their code, row padding and cut blocks included.

        Where blocks divide the shape and rows need no padding, this is the paper's eq. 5.

        Raises:
            InvalidInputError: a shape that no array has.
            UnsupportedError: another sample type.
        """
        shape_zyx, sample_dtype = require_extents(shape, "shape"), require_dtype(dtype)
        nbytes = math.prod(shape_zyx) * sample_dtype.itemsize
        return nbytes / self.encoded_nbytes(shape_zyx, sample_dtype)

    def error_bound(self, array: Voxels) -> float:
        """The most by which any decoded voxel of this array can differ from the original.

        With R the widest block's range and L = 2^bits − 1: for integers floor(R/(2L) + 1/2), and
        0 if R <= L (the paper's eq. 6, for these data); for float32 the largest R/(2L) plus one
        rounding to float32, of any block that is not constant.

        Raises:
            InvalidInputError, NotFiniteError, UnsupportedError: as `encode`.
        """
        array = require_volume(array)
        end_points_nbytes = self.end_points_nbytes(array.shape, array.dtype)
        ends = np.frombuffer(self.encode(array)[:end_points_nbytes], array.dtype).reshape(-1, 2)
        levels = 2**self.bits - 1
        if array.dtype.kind == "f":
            low, high = ends.T.astype(np.float64)
            greatest = np.maximum(np.abs(low), np.abs(high))
            rounding = greatest * _FLOAT32_ROUNDING + _FLOAT32_TINY
            bounds = np.where(low < high, (high - low) / (2 * levels) + rounding, 0.0)
            return float(bounds.max())
        widest = int(np.diff(ends.astype(np.int64)).max())
        return float((widest + levels) // (2 * levels) if widest > levels else 0)

    def _layout_nbytes(self, shape: Iterable[int], dtype: DTypeLike) -> tuple[int, int]:
        shape_zyx, sample_dtype = require_extents(shape, "shape"), require_dtype(dtype)
        layout = _native.layout_nbytes(shape_zyx, sample_dtype.itemsize, self.block, self.bits)
        if isinstance(layout, tuple):
            return layout
        raise _too_large(shape_zyx)


def _too_large(shape: tuple[Any, ...]) -> InvalidInputError:
    return InvalidInputError(
        f"a volume of {shape} voxels has more bytes than this machine can count",
        shape=[str(n) for n in shape],
    )


def require_code(codec: S3dc, data: Buffer, shape_zyx: Zyx, dtype: np.dtype[Any]) -> memoryview:
    """The bytes of a code, which are as many as this shape and type have.

    Raises:
        CorruptBrickError: another number of bytes.
        InvalidInputError: they are not contiguous, or the shape is one that no array has.
    """
    nbytes = codec.encoded_nbytes(shape_zyx, dtype)
    view = memoryview(data)
    if not view.c_contiguous:
        raise InvalidInputError("a code must be contiguous in memory; pass bytes(data)")
    if view.nbytes != nbytes:
        raise CorruptBrickError(
            f"the code of {shape_zyx} {dtype} voxels with {codec} has {nbytes} bytes, "
            f"but {view.nbytes} were given; fetch them again, or check shape and parameters",
            expected_nbytes=nbytes,
            given_nbytes=view.nbytes,
        )
    return view


def require_sound(outcome: _native.Outcome) -> None:
    """Nothing, where the native code found a code of the right size to be sound.

    Raises:
        CorruptBrickError: end points or padding are not what `encode` writes.
    """
    if outcome.status is not _native.Status.OK:
        raise _corrupt(outcome)


def _corrupt(outcome: _native.Outcome) -> CorruptBrickError:
    if outcome.status is _native.Status.BAD_END_POINTS:
        return CorruptBrickError(
            f"block (bz, by, bx) = {outcome.at} has minimum {outcome.first:g} and maximum "
            f"{outcome.second:g}: not what encode writes; fetch the bytes again",
            block_zyx=list(outcome.at),
            minimum=str(outcome.first),
            maximum=str(outcome.second),
        )
    z, y, _ = outcome.at
    return CorruptBrickError(
        f"the row of voxels (z, y) = ({z}, {y}) has padding bits that are set, where encode "
        "writes zeros; fetch the bytes again",
        row_zy=[z, y],
    )
