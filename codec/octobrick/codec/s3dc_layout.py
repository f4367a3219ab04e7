"""Where the parts of an S3Dc code lie, as the native code has it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from octobrick.codec import _native
from octobrick.codec.arrays import Zyx
from octobrick.codec.errors import CorruptBrickError, InvalidInputError
from octobrick.codec.s3dc_faults import too_large

if TYPE_CHECKING:
    from typing_extensions import Buffer

    from octobrick.codec.s3dc import S3dc


class FixedLayout(NamedTuple):
    """Of a code whose indices all have one width."""

    end_points_nbytes: int
    nbytes: int


class VariableLayout(NamedTuple):
    """Of a code with a width per block: where its parts begin."""

    groups_begin: int
    flags_begin: int
    payload_begin: int
    unit_nbytes: int


def fixed_layout(codec: S3dc, shape: Zyx, sample: np.dtype[Any]) -> FixedLayout:
    """The layout at a fixed rate; of a codec without one, that of end points and one bit.

    Raises:
        InvalidInputError: a volume with more bytes than can be counted.
    """
    layout = _native.layout_nbytes(
        shape, sample.itemsize, codec.block, codec.bits or 1, codec.scale == "trained"
    )
    if isinstance(layout, tuple):
        return FixedLayout(*layout)
    raise too_large(shape)


def variable_layout(
    codec: S3dc, shape: Zyx, sample: np.dtype[Any], predicted: bool
) -> VariableLayout:
    """The layout with a width per block.

    Raises:
        InvalidInputError: a volume with more bytes than can be counted.
    """
    layout = _native.variable_layout(shape, sample.itemsize, codec.block, predicted)
    if isinstance(layout, tuple):
        return VariableLayout(*layout)
    raise too_large(shape)


def grid_of(block: Zyx, shape: tuple[int, ...]) -> Zyx:
    """Blocks along each axis."""
    z, y, x = (-(-n // b) for n, b in zip(shape, block, strict=True))
    return z, y, x


def require_code(
    codec: S3dc, data: Buffer, shape: Zyx, sample: np.dtype[Any], *, predicted: bool = False
) -> memoryview:
    """The bytes of a code, as many as shape and type need; at a variable rate, for its tables.

    To be called before anything is allocated.

    Raises:
        CorruptBrickError: another number of bytes.
        InvalidInputError: they are not contiguous, or more than can be counted.
    """
    view = memoryview(data)
    if not view.c_contiguous:
        raise InvalidInputError("a code must be contiguous in memory; pass bytes(data)")
    if codec.variable or predicted:
        nbytes, has = variable_layout(codec, shape, sample, predicted).payload_begin, "has at least"
        sound = view.nbytes >= nbytes
    else:
        nbytes, has = fixed_layout(codec, shape, sample).nbytes, "has"
        sound = view.nbytes == nbytes
    if not sound:
        raise CorruptBrickError(
            f"the code of {shape} {sample} voxels with {codec} {has} {nbytes} bytes, but "
            f"{view.nbytes} were given; fetch them again, or check shape and parameters",
            expected_nbytes=nbytes,
            given_nbytes=view.nbytes,
        )
    return view.cast("B")
