"""Histograms that add up exactly, whatever a volume is cut into, its range not known before."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import _native
from octobrick.codec.arrays import Voxels, require_volume, widened
from octobrick.codec.errors import InvalidInputError, NotFiniteError

BINS_MAX = 1024
"""More bins than that are merged in pairs."""

_EXPONENT_MIN, _EXPONENT_MAX = -512, 512


def _no_counts() -> NDArray[np.uint64]:
    return np.zeros(0, np.uint64)


@dataclass(frozen=True, slots=True, eq=False)
class Histogram:
    """How often values occur, in at most `BINS_MAX` bins whose width is a power of two.

    Bin ``i`` holds the values from ``(first + i) * 2**exponent`` up to, and without, the next
    bin's. Bins of a width begin at the same values in every histogram, so two of them add up
    exactly: the finer one's bins are merged first. Of whole numbers none is narrower than 1.

    Attributes:
        exponent: of the bins' width.
        first: the number of the first bin.
        counts: uint64, of each bin; none where nothing was counted.
    """

    exponent: int = 0
    first: int = 0
    counts: NDArray[np.uint64] = field(default_factory=_no_counts)

    @property
    def total(self) -> int:
        """How many values were counted."""
        return int(self.counts.sum())

    @property
    def width(self) -> float:
        """Of each bin."""
        return math.ldexp(1.0, self.exponent)

    @property
    def low(self) -> float:
        """Where the first bin begins."""
        return self.first * self.width

    def __add__(self, other: Histogram) -> Histogram:
        """Both together."""
        return Histogram.total_of([self, other])

    @classmethod
    def total_of(cls, parts: Iterable[Histogram]) -> Histogram:
        """All of them together: the same as adding one after the other, and faster."""
        counted = [part for part in parts if part.counts.size]
        if len(counted) < 2:
            return counted[0] if counted else cls()
        exponent = max(part.exponent for part in counted)
        first = min(part.first >> (exponent - part.exponent) for part in counted)
        end = max(part._last >> (exponent - part.exponent) for part in counted) + 1
        while end - first > BINS_MAX:
            exponent, first, end = exponent + 1, first >> 1, ((end - 1) >> 1) + 1
        counts = np.zeros(end - first, np.uint64)
        for part in counted:
            at, own = part._coarser(exponent)
            counts[at - first : at - first + own.size] += own
        return cls(exponent, first, counts)

    def quantile(self, share: float) -> float:
        """The value below which this share of all lies, taken as spread evenly within a bin.

        Args:
            share: 0 to 1.

        Raises:
            InvalidInputError: nothing was counted, or the share is out of its range.
        """
        if not self.counts.size or not 0 <= share <= 1:
            raise InvalidInputError(
                f"there is no {share} quantile of {self.total} values; give a share of 0 to 1 and "
                "count something first",
                share=str(share),
            )
        ends = np.cumsum(self.counts)
        wanted = share * float(ends[-1])
        bin_ = min(int(np.searchsorted(ends, wanted)), self.counts.size - 1)
        count = int(self.counts[bin_])
        before = float(ends[bin_]) - count
        inside = (wanted - before) / count if count else 0.0
        return (self.first + bin_ + inside) * self.width

    @property
    def _last(self) -> int:
        """The number of the last bin."""
        return self.first + self.counts.size - 1

    def _coarser(self, exponent: int) -> tuple[int, NDArray[np.uint64]]:
        """First bin and counts with bins of another width, not below ours."""
        steps = exponent - self.exponent
        if steps == 0:
            return self.first, self.counts
        first, size = self.first >> steps, self.counts.size
        # Where the coarser bins begin among ours, the first perhaps in the middle of one.
        begin = ((first + 1) << steps) - self.first
        starts = [0, *range(begin, size, 1 << steps)] if begin < size else [0]
        return first, np.add.reduceat(self.counts, starts)


def histogram(volume: Voxels, low: float, high: float) -> Histogram:
    """How often each value occurs in a volume.

    Args:
        volume: (z, y, x), of uint8, int8, uint16, int16, float16 or float32, with any strides.
        low: at or below its least voxel.
        high: at or above its greatest. The narrower both bound it, the finer the bins.

    Raises:
        InvalidInputError: a voxel is not between them, or they are no finite numbers.
        NotFiniteError: a voxel is NaN.
        UnsupportedError: another sample type.
    """
    volume = require_volume(widened(volume))
    low, high = float(low), float(high)
    if not (math.isfinite(low) and math.isfinite(high)):
        raise InvalidInputError(f"values from {low} to {high} cannot be counted; give finite ones")
    exponent = _exponent(low, high, whole=volume.dtype.kind != "f")
    first = math.floor(math.ldexp(low, -exponent))
    count = math.floor(math.ldexp(high, -exponent)) - first + 1
    counts = np.zeros(max(count, 1), np.uint64)
    if not _native.count_values_into(volume, exponent, first, counts):
        if np.isnan(volume).any():
            raise NotFiniteError("NaN has no place in a histogram; replace it first")
        raise InvalidInputError(
            f"a volume with voxels from {volume.min()} to {volume.max()} was said to have them "
            f"from {low} to {high}; give bounds that hold",
            low=low,
            high=high,
        )
    return Histogram(exponent, first, counts)


def _exponent(low: float, high: float, *, whole: bool) -> int:
    """The least with which the values from low to high take at most `BINS_MAX` bins."""
    least = 0 if whole else _EXPONENT_MIN
    # By halves, which do not overflow. One bin fewer, as both ends cut into bins.
    half_span = high / 2 - low / 2
    exponent = max(least, math.frexp(half_span / (BINS_MAX / 2 - 1))[1] if half_span > 0 else least)
    if not whole:
        # Bins must not be finer than what a double can number.
        most = max(abs(low), abs(high))
        exponent = max(exponent, math.frexp(most)[1] - 50 if most > 0 else 0)
    return min(exponent, _EXPONENT_MAX)
