"""What the native code found wrong with a volume or a zerobit code, as exceptions."""

from __future__ import annotations

import math

from octobrick.codec import _native
from octobrick.codec.errors import (
    CorruptBrickError,
    Fact,
    InvalidInputError,
    NotFiniteError,
    OctobrickError,
    UnsupportedError,
)


def cannot_encode(outcome: _native.ZerobitOutcome, shape: tuple[int, ...]) -> OctobrickError:
    """Why an array of this shape has no code."""
    status = _native.ZerobitStatus
    facts: dict[str, Fact] = {"shape": list(shape)}
    if outcome.status is status.NOT_FINITE:
        return NotFiniteError(
            f"voxel (z, y, x) = {outcome.at} is {outcome.first}: Zerobit encodes finite numbers; "
            "replace such voxels first, for instance with the background's value",
            voxel_zyx=list(outcome.at),
            value=str(outcome.first),
        )
    if outcome.status is status.WRONG_CODEBOOK:
        return InvalidInputError(
            "the codebook is for another sample type or number of channels, or has no codewords; "
            "train one on arrays like this",
            **facts,
        )
    return UnsupportedError(
        f"a volume of {shape} voxels is too large for one zerobit code, which has less than "
        "4 GiB; encode bricks of it",
        **facts,
    )


def require_sound(outcome: _native.ZerobitOutcome) -> None:
    """Returns where the outcome is OK.

    Raises:
        CorruptBrickError: it is not, and this is why.
    """
    status = _native.ZerobitStatus
    if outcome.status is status.OK:
        return
    if outcome.status is status.WRONG_NBYTES:
        expected, given = math.floor(outcome.first), math.floor(outcome.second)
        raise CorruptBrickError(
            f"the code says that it has {expected} bytes, but {given} were given; fetch them again",
            expected_nbytes=expected,
            given_nbytes=given,
        )
    if outcome.status is status.WRONG_CODEBOOK:
        raise CorruptBrickError(
            "the code was made with a shared codebook, and not with the one given; pass that "
            "codebook to Zerobit(codebook=...)"
        )
    if outcome.status is status.BAD_BLOCK:
        raise CorruptBrickError(
            f"unit block (z, y, x) = {outcome.at} is not what encode writes; fetch the bytes again",
            block_zyx=list(outcome.at),
        )
    raise CorruptBrickError("the header is not one of a zerobit code; fetch the bytes again")
