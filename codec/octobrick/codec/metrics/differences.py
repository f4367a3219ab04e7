"""Voxel by voxel: the largest and the mean squared difference, and PSNR."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from octobrick.codec import _native
from octobrick.codec.arrays import SAMPLE_DTYPES, Voxels
from octobrick.codec.metrics.values import require_peak, require_same_shape, value_range


@dataclass(frozen=True, slots=True)
class ErrorStats:
    """What is needed to know the error of a whole from the errors of its parts: add them up.

    Args:
        count: voxels compared.
        max_abs: the greatest |a − b|.
        sum_squared: the sum of (a − b)². Whole and exact where both arrays hold integers of up to
            16 bits, so that the order of adding does not matter.
    """

    count: int = 0
    max_abs: float = 0
    sum_squared: float = 0

    def __add__(self, other: ErrorStats) -> ErrorStats:
        """The errors of both parts together."""
        # np.fmax would drop a NaN, max() might: one that came in must stay visible.
        worst = self.max_abs if math.isnan(self.max_abs) else max(other.max_abs, self.max_abs)
        return ErrorStats(self.count + other.count, worst, self.sum_squared + other.sum_squared)

    @property
    def rmse(self) -> float:
        """The root of the mean squared error; 0 where nothing was compared."""
        return math.sqrt(self.sum_squared / self.count) if self.count else 0.0

    def psnr(self, peak: float) -> float:
        """The peak signal-to-noise ratio in dB; inf where there is no error.

        Args:
            peak: the greatest possible difference of two values, at least 0.

        Raises:
            InvalidInputError: the peak is negative or NaN.
        """
        peak = require_peak(peak)
        if self.sum_squared == 0:
            return math.inf
        return 20 * math.log10(peak / self.rmse) if peak > 0 else -math.inf


def compare(a: Voxels, b: Voxels) -> ErrorStats:
    """The error statistics of two arrays of one shape, of any number of axes.

    Two arrays of one sample type of the codec are read in place, without a copy. Integers of up
    to 16 bits are compared exactly, all else in float64. NaN makes `max_abs` and `sum_squared`
    NaN.

    Raises:
        InvalidInputError: the shapes differ.
    """
    a, b = require_same_shape(a, b)
    if a.dtype == b.dtype and a.dtype in SAMPLE_DTYPES:
        return ErrorStats(*_native.compare(_three_axes(a), _three_axes(b)))
    difference = a.astype(np.float64) - b.astype(np.float64)
    worst = float(np.abs(difference).max(initial=0))
    return ErrorStats(a.size, worst, float(np.vdot(difference, difference)))


def max_error(a: Voxels, b: Voxels) -> float:
    """The greatest |a − b|.

    Raises:
        InvalidInputError: the shapes differ.
    """
    return compare(a, b).max_abs


def psnr(a: Voxels, b: Voxels, peak: float | None = None) -> float:
    """The peak signal-to-noise ratio of b against the original a, in dB; inf where equal.

    Args:
        a: the original.
        b: what became of it, of the same shape.
        peak: the greatest possible difference; None chooses as the module says.

    Raises:
        InvalidInputError: the shapes differ, or the peak is negative.
    """
    stats = compare(a, b)
    return stats.psnr(value_range(a).peak if peak is None else peak)


def _three_axes(a: Voxels) -> Voxels:
    """The array with leading axes added, or merged (which copies some strided arrays)."""
    if a.ndim <= 3:
        return a[(np.newaxis,) * (3 - a.ndim)]
    return a.reshape(-1, *a.shape[-2:])
