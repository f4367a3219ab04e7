"""What the native S3Dc refuses, as errors that say what, where, both values and what to do."""

from __future__ import annotations

from typing import Any

from octobrick.codec import _native
from octobrick.codec.errors import (
    CorruptBrickError,
    InvalidInputError,
    NotFiniteError,
    OctobrickError,
)

_Status = _native.Status


def too_large(shape: tuple[Any, ...]) -> InvalidInputError:
    """The error for a shape whose bytes cannot be counted, to be raised."""
    return InvalidInputError(
        f"a volume of {shape} voxels has more bytes than this machine can count",
        shape=[str(n) for n in shape],
    )


def cannot_encode(outcome: _native.Outcome, shape: tuple[int, ...]) -> OctobrickError:
    """The error for voxels that cannot be encoded, to be raised."""
    if outcome.status is _Status.NOT_FINITE:
        return NotFiniteError(
            f"voxel (z, y, x) = {outcome.at} is {outcome.first}: S3dc encodes finite numbers; "
            "replace such voxels first, for instance with the background's value "
            "(replace_nonfinite)",
            voxel_zyx=list(outcome.at),
            value=str(outcome.first),
        )
    if outcome.status is _Status.BUDGET_TOO_SMALL:
        return InvalidInputError(
            f"{outcome.first:g} bits per voxel are too few: end points and tables of {shape} "
            f"voxels need {outcome.second:.4g} already; give more, or larger blocks",
            bits_per_voxel=outcome.first,
            least_bits_per_voxel=outcome.second,
        )
    return too_large(shape)


def require_sound(outcome: _native.Outcome) -> None:
    """Nothing, where the native code found a code to be what an encoder writes.

    Raises:
        CorruptBrickError: it is not.
    """
    if outcome.status is not _Status.OK:
        raise _corrupt(outcome)


def _corrupt(outcome: _native.Outcome) -> CorruptBrickError:
    place = f"block (bz, by, bx) = {outcome.at}"
    again = "not what encode writes; fetch the bytes again"
    if outcome.status is _Status.BAD_END_POINTS:
        return CorruptBrickError(
            f"{place} has minimum {outcome.first:g} and maximum {outcome.second:g}: {again}",
            block_zyx=list(outcome.at),
            minimum=str(outcome.first),
            maximum=str(outcome.second),
        )
    if outcome.status is _Status.BAD_PADDING:
        z, y, _ = outcome.at
        return CorruptBrickError(
            f"the row of voxels (z, y) = ({z}, {y}) has padding bits that are set, where encode "
            "writes zeros; fetch the bytes again",
            row_zy=[z, y],
        )
    if outcome.status is _Status.WRONG_NBYTES:
        return CorruptBrickError(
            f"the code by its tables has {outcome.first:.0f} bytes, but {outcome.second:.0f} were "
            "given; fetch them again, or check shape and parameters",
            expected_nbytes=int(outcome.first),
            given_nbytes=int(outcome.second),
        )
    what = {
        _Status.BAD_GROUPS: f"the group of blocks from {place} has a place or widths",
        _Status.BAD_RAW: f"the uncoded {place} has voxels outside of its end points",
        _Status.BAD_SCALES: f"positions of a scale are out of order, or {place} names none",
    }[outcome.status]
    return CorruptBrickError(f"{what}: {again}", block_zyx=list(outcome.at))
