"""The parameters of S3dc: which make sense together, and what the native code makes of them."""

from __future__ import annotations

import math
import operator
from typing import TYPE_CHECKING

import numpy as np

from octobrick.codec import _native
from octobrick.codec.arrays import Voxels
from octobrick.codec.errors import InvalidInputError

if TYPE_CHECKING:
    from octobrick.codec.s3dc import S3dc

DEFAULT_BITS = 4
RULES = ("bits", "max_error", "bits_per_voxel", "slope")
SCALES = ("linear", "trained")
_HALF_TOP = 65472.0
"""The greatest float16 that has a step above it, as wide as that below it."""


def require_bits(bits: object) -> int:
    """Bits per index.

    Raises:
        InvalidInputError: no integer from 1 to 8.
    """
    try:
        bits = operator.index(bits)  # type: ignore[arg-type]
    except TypeError as error:
        raise InvalidInputError(f"S3dc bits must be an integer: {error}") from error
    if not 1 <= bits <= 8:
        raise InvalidInputError(f"S3dc bits is {bits}; give 1 to 8 bits per index", bits=bits)
    return bits


def require_number(value: object, name: str, least: str) -> float:
    """A finite number, above 0 or at least 0.

    Raises:
        InvalidInputError: it is not.
    """
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError) as error:
        raise InvalidInputError(f"S3dc {name} must be a number: {error}") from error
    if not (number > 0 or (number == 0 and least == "at least 0")) or math.isinf(number):
        raise InvalidInputError(
            f"S3dc {name} is {number}; give a finite number, {least}", value=str(number)
        )
    return number


def require_rule(codec: S3dc) -> tuple[str, float]:
    """The one parameter that says how widths are chosen, and its value.

    Raises:
        InvalidInputError: several of them, or a value out of its range.
    """
    given = [name for name in RULES if getattr(codec, name) is not None] or ["bits"]
    if len(given) > 1:
        raise InvalidInputError(
            f"S3dc has {' and '.join(given)}; give one of {', '.join(RULES)}", given=given
        )
    name = given[0]
    value = getattr(codec, name)
    if name == "bits":
        return name, require_bits(DEFAULT_BITS if value is None else value)
    return name, require_number(value, name, "at least 0" if name == "max_error" else "above 0")


def require_fitted(codec: S3dc, rule: str) -> bool:
    """Whether end points are fitted: by default where the size is the aim.

    Raises:
        InvalidInputError: fitted end points and a bound.
    """
    if codec.fitted is None:
        return rule in ("bits_per_voxel", "slope")
    if codec.fitted and rule == "max_error":
        raise InvalidInputError(
            "S3dc with max_error places end points for that bound; leave fitted away"
        )
    return bool(codec.fitted)


def require_scale(codec: S3dc, rule: str, fitted: bool) -> None:
    """Check that the scale of the indices is known, and goes with the rest.

    Raises:
        InvalidInputError: it does not.
    """
    if codec.scale not in SCALES:
        raise InvalidInputError(f"S3dc scale is {codec.scale!r}; give one of {SCALES}")
    if codec.scale == "trained" and (rule != "bits" or fitted):
        raise InvalidInputError(
            "S3dc scale='trained' goes with bits alone, and with end points that are not fitted"
        )


def native_rule(codec: S3dc) -> tuple[_native.WidthRule, float]:
    """How the native code chooses widths."""
    rule = _native.WidthRule
    if codec.bits is not None:
        return rule.SAME, codec.bits
    if codec.max_error is not None:
        return rule.BOUND, codec.max_error
    if codec.bits_per_voxel is not None:
        return rule.BUDGET, codec.bits_per_voxel
    assert codec.slope is not None
    return rule.SLOPE, codec.slope


def half_bound(max_error: float, array: Voxels) -> float:
    """The bound for float16 voxels before they are rounded to float16, which may cost half a step.

    A step of the greatest voxel, or of the greatest that a decoder can come to.
    """
    greatest = float(np.abs(array).max(initial=0)) + max_error
    if not math.isfinite(greatest):
        return max_error  # the encoder will refuse
    step = float(np.spacing(np.float16(min(greatest, _HALF_TOP))))
    return max(0.0, max_error - step / 2)
