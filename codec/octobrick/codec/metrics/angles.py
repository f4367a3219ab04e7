"""The angle between two fields of vectors, place by place and in the whole."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.arrays import Voxels
from octobrick.codec.errors import InvalidInputError
from octobrick.codec.metrics.values import require_same_shape

# Bin i holds angles from 2^(i / 1024) − 1 degrees on: 0.0007° wide at 0, and 0.07 % wider with
# every degree, as errors of 0.03° and of 30° are both wanted to three digits. 60 KiB.
_BINS_PER_DOUBLING = 1024
_BINS = math.floor(_BINS_PER_DOUBLING * math.log2(1 + 180)) + 1
_VECTORS_AT_ONCE = 2**16  # 1.5 MiB of float64, of which some ten copies are made
_GREATEST_DEGREES = 180.0


@dataclass(frozen=True, slots=True)
class AngularStats:
    """What is needed to know the angles of a whole from the angles of its parts: add them up.

    Counts, the maximum and percentiles of a sum are those of the whole, whatever the parts;
    sums are so up to rounding. A NaN stays visible in `max_degrees`, the sums and percentiles.

    Args:
        count: places compared.
        max_degrees: the greatest angle, 0 to 180.
        sum_degrees: the sum of the angles.
        sum_squared: the sum of their squares.
        vanished: places where one of the two vectors is zero and the other is not; 90° each.
        empty: places where both are zero; 0° each.
        histogram: how many angles each of 7680 bins holds, as the bytes of native uint64; see
            `percentile`. Empty bytes where nothing was compared.
    """

    count: int = 0
    max_degrees: float = 0
    sum_degrees: float = 0
    sum_squared: float = 0
    vanished: int = 0
    empty: int = 0
    histogram: bytes = field(default=b"", repr=False)

    def __add__(self, other: AngularStats) -> AngularStats:
        """The angles of both parts together."""
        worst = self.max_degrees
        if not math.isnan(worst):
            worst = max(other.max_degrees, worst)
        return AngularStats(
            self.count + other.count,
            worst,
            self.sum_degrees + other.sum_degrees,
            self.sum_squared + other.sum_squared,
            self.vanished + other.vanished,
            self.empty + other.empty,
            _histogram_of_both(self.histogram, other.histogram),
        )

    @property
    def mean(self) -> float:
        """The mean angle in degrees; 0 where nothing was compared."""
        return self.sum_degrees / self.count if self.count else 0.0

    @property
    def rms(self) -> float:
        """The root of the mean squared angle in degrees; 0 where nothing was compared."""
        return math.sqrt(self.sum_squared / self.count) if self.count else 0.0

    def percentile(self, percent: float) -> float:
        """The least angle in degrees that `percent` of all places do not exceed, from above.

        But for rounding not below the true one, and above it by no more than 0.0007 · (it + 1°):
        that is the width of a bin. 100 gives the exact maximum, nothing compared gives 0.

        Args:
            percent: 0 to 100.

        Raises:
            InvalidInputError: it is none of these.
        """
        if not 0 <= percent <= 100:
            raise InvalidInputError(
                f"percent is {percent}; give 0 to 100, such as 99", percent=str(percent)
            )
        if math.isnan(self.max_degrees) or not self.count:
            return self.max_degrees
        wanted = max(1, math.ceil(self.count * percent / 100))
        cumulated = np.frombuffer(self.histogram, np.uint64).cumsum()
        last = int(np.searchsorted(cumulated, wanted))
        return min(math.exp2((last + 1) / _BINS_PER_DOUBLING) - 1, self.max_degrees)


def angular_stats(a: Voxels, b: Voxels) -> AngularStats:
    """The statistics of the angles between two fields of vectors, as `angular_error` has them.

    Some 20 MiB are used beside the arrays, whatever their size; strided ones are copied.

    Args:
        a: vectors (…, 3), of any numeric type.
        b: of the same shape.

    Raises:
        InvalidInputError: the shapes differ, or the last axis is not 3 long.
    """
    a, b = _vectors(a, b)
    a, b = a.reshape(-1, 3), b.reshape(-1, 3)
    total = AngularStats()
    for start in range(0, len(a), _VECTORS_AT_ONCE):
        some = slice(start, start + _VECTORS_AT_ONCE)
        total += _stats_of(a[some], b[some])
    return total


def angular_error(a: Voxels, b: Voxels) -> NDArray[np.float64]:
    """The angle between two fields of vectors, in degrees, at every place.

    Lengths do not matter, and may be anything from 5e-324 to 1e308; differences down to 1e-8
    degrees are told. Where both vectors are zero the angle is 0; where one is, and so says nothing
    of its direction, it is 90. NaN and ±Inf give NaN.

    Args:
        a: vectors (…, 3), of any numeric type.
        b: of the same shape.

    Returns:
        float64 of the shape without the last axis, 0 to 180.

    Raises:
        InvalidInputError: the shapes differ, or the last axis is not 3 long.
    """
    a, b = _vectors(a, b)
    some_a, some_b = a.any(axis=-1), b.any(axis=-1)
    a, b = _longest_component_one(a), _longest_component_one(b)
    sine = np.linalg.norm(np.cross(a, b), axis=-1)
    degrees: NDArray[np.float64] = np.degrees(np.arctan2(sine, (a * b).sum(axis=-1)))
    return np.where(some_a == some_b, degrees, 90.0)


def _stats_of(a: Voxels, b: Voxels) -> AngularStats:
    degrees = angular_error(a, b)
    some_a, some_b = a.any(axis=-1), b.any(axis=-1)
    known = degrees[~np.isnan(degrees)]
    bins = np.floor(_BINS_PER_DOUBLING * np.log2(1 + known)).astype(np.int64)
    return AngularStats(
        count=degrees.size,
        max_degrees=float(degrees.max()),
        sum_degrees=float(degrees.sum()),
        sum_squared=float(np.vdot(degrees, degrees)),
        vanished=int(np.count_nonzero(some_a != some_b)),
        empty=int(np.count_nonzero(~some_a & ~some_b)),
        histogram=np.bincount(bins, minlength=_BINS).astype(np.uint64).tobytes(),
    )


def _histogram_of_both(first: bytes, second: bytes) -> bytes:
    if not first or not second:
        return first or second
    return (np.frombuffer(first, np.uint64) + np.frombuffer(second, np.uint64)).tobytes()


def _vectors(a: Voxels, b: Voxels) -> tuple[Voxels, Voxels]:
    a, b = require_same_shape(a, b)
    if a.ndim == 0 or a.shape[-1] != 3:
        raise InvalidInputError(
            f"vectors of shape {a.shape} have no angle; the last axis must hold (x, y, z)",
            shape=list(a.shape),
        )
    return a, b


def _longest_component_one(vectors: Voxels) -> NDArray[np.float64]:
    wide = vectors.astype(np.float64)
    greatest = np.abs(wide).max(axis=-1, keepdims=True)
    with np.errstate(invalid="ignore"):  # inf / inf is the NaN that the caller shall see
        scaled: NDArray[np.float64] = wide / np.where(greatest == 0, 1, greatest)
    return scaled
