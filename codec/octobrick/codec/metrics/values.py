"""The range of values, and what every metric asks of its arguments."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from octobrick.codec.arrays import Voxels
from octobrick.codec.errors import InvalidInputError


@dataclass(frozen=True, slots=True)
class ValueRange:
    """The least and the greatest value of a whole, added up from its parts; of none at first.

    Args:
        least: ∞ where there are no values; NaN where one of them is.
        greatest: −∞ where there are no values; NaN where one of them is.
    """

    least: float = math.inf
    greatest: float = -math.inf

    def __add__(self, other: ValueRange) -> ValueRange:
        """The range of both parts together."""
        if math.isnan(self.least) or math.isnan(other.least):
            return ValueRange(math.nan, math.nan)
        return ValueRange(min(self.least, other.least), max(self.greatest, other.greatest))

    @property
    def peak(self) -> float:
        """The greatest possible difference of two values; 0 where there are none."""
        return self.greatest - self.least if self.least != math.inf else 0.0


def value_range(a: Voxels) -> ValueRange:
    """The range of an array's values, of any real type and number of axes."""
    a = np.asarray(a)
    return ValueRange(float(a.min()), float(a.max())) if a.size else ValueRange()


def require_peak(peak: float) -> float:
    """The peak.

    Raises:
        InvalidInputError: it is negative or NaN.
    """
    if peak < 0 or math.isnan(peak):
        raise InvalidInputError(f"peak is {peak}; give the data's value range", peak=str(peak))
    return peak


def require_same_shape(a: Voxels, b: Voxels) -> tuple[Voxels, Voxels]:
    """Both as arrays.

    Raises:
        InvalidInputError: the shapes differ.
    """
    a, b = np.asarray(a), np.asarray(b)
    if a.shape != b.shape:
        raise InvalidInputError(
            f"arrays of {a.shape} and {b.shape} voxels cannot be compared; give one shape",
            first_shape=list(a.shape),
            second_shape=list(b.shape),
        )
    return a, b
