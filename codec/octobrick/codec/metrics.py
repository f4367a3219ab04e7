"""How far decoded data are from the original: max error, RMSE, PSNR, SSIM, angles.

All functions are pure and thread-safe. Where a `peak` is wanted and none is given, it is the value
range of the first array (its maximum − minimum), whatever its type: the range of the type says
nothing about data that use a part of it. For 8-bit pictures the literature takes 255: say so.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import _native
from octobrick.codec.arrays import SAMPLE_DTYPES, Voxels
from octobrick.codec.errors import InvalidInputError

# Wang, Bovik, Sheikh, Simoncelli, "Image Quality Assessment: From Error Visibility to Structural
# Similarity", 2004: an 11-tap Gaussian window, and the constants of its section III.B.
_SSIM_TAPS = 11
_SSIM_SIGMA = 1.5
_SSIM_K1, _SSIM_K2 = 0.01, 0.03
_MOST_CHANNELS = 4  # RGBA


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
        """
        if peak < 0 or math.isnan(peak):
            raise InvalidInputError(f"peak is {peak}; give the data's value range", peak=str(peak))
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
    a, b = _same_shape(a, b)
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
    return stats.psnr(_peak_of(np.asarray(a)) if peak is None else peak)


def ssim(a: Voxels, b: Voxels, peak: float | None = None) -> float:
    """The mean structural similarity of two images or volumes; 1 where they are equal.

    After Wang et al. 2004 with an 11-tap Gaussian window per axis, σ 1.5, K1 0.01, K2 0.03; only
    windows that lie wholly inside count. In volumes the window is 11³. Channels are averaged.

    Args:
        a: (y, x), (y, x, channels) with up to four channels, or (z, y, x). Three axes of which
            the last is 4 or less can only be an image: no volume so thin holds a window.
        b: of the same shape.
        peak: the greatest possible difference; None chooses as the module says.

    Raises:
        InvalidInputError: the shapes differ, or an axis is shorter than the window.
    """
    a, b = _same_shape(a, b)
    if peak is None:
        peak = _peak_of(a)
    if a.ndim == 3 and a.shape[-1] <= _MOST_CHANNELS:
        channels = range(a.shape[-1])
        return float(np.mean([ssim(a[..., c], b[..., c], peak) for c in channels]))
    if a.ndim not in (2, 3) or min(a.shape) < _SSIM_TAPS:
        raise InvalidInputError(
            f"SSIM compares images and volumes of at least {_SSIM_TAPS} voxels on each axis, "
            f"not {a.shape}; use psnr, or crop differently",
            shape=list(a.shape),
        )
    return _mean_ssim(a.astype(np.float64), b.astype(np.float64), peak)


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
    a, b = _same_shape(a, b)
    if a.ndim == 0 or a.shape[-1] != 3:
        raise InvalidInputError(
            f"vectors of shape {a.shape} have no angle; the last axis must hold (x, y, z)",
            shape=list(a.shape),
        )
    a, b = _longest_component_one(a), _longest_component_one(b)
    sine = np.linalg.norm(np.cross(a, b), axis=-1)
    degrees: NDArray[np.float64] = np.degrees(np.arctan2(sine, (a * b).sum(axis=-1)))
    return np.where(a.any(axis=-1) == b.any(axis=-1), degrees, 90.0)


def _longest_component_one(vectors: Voxels) -> NDArray[np.float64]:
    wide = vectors.astype(np.float64)
    greatest = np.abs(wide).max(axis=-1, keepdims=True)
    with np.errstate(invalid="ignore"):  # inf / inf is the NaN that the caller shall see
        scaled: NDArray[np.float64] = wide / np.where(greatest == 0, 1, greatest)
    return scaled


def _mean_ssim(a: NDArray[np.float64], b: NDArray[np.float64], peak: float) -> float:
    mean_a, mean_b = _smooth(a), _smooth(b)
    variance_a = _smooth(a * a) - mean_a**2
    variance_b = _smooth(b * b) - mean_b**2
    covariance = _smooth(a * b) - mean_a * mean_b
    c1, c2 = (_SSIM_K1 * peak) ** 2, (_SSIM_K2 * peak) ** 2
    above = (2 * mean_a * mean_b + c1) * (2 * covariance + c2)
    below = (mean_a**2 + mean_b**2 + c1) * (variance_a + variance_b + c2)
    # 0/0: both are zero throughout a window, and the peak is 0. They are equal there.
    return float(np.divide(above, below, out=np.ones_like(above), where=below != 0).mean())


def _smooth(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """The Gaussian-weighted means of all windows that lie inside."""
    at = np.arange(_SSIM_TAPS) - _SSIM_TAPS // 2
    taps = np.exp(-(at**2) / (2 * _SSIM_SIGMA**2))
    taps /= taps.sum()
    for axis in range(values.ndim):
        windows = np.lib.stride_tricks.sliding_window_view(values, _SSIM_TAPS, axis)
        values = windows @ taps
    return values


def _peak_of(a: Voxels) -> float:
    return float(a.max()) - float(a.min()) if a.size else 0.0


def _same_shape(a: Voxels, b: Voxels) -> tuple[Voxels, Voxels]:
    a, b = np.asarray(a), np.asarray(b)
    if a.shape != b.shape:
        raise InvalidInputError(
            f"arrays of {a.shape} and {b.shape} voxels cannot be compared; give one shape",
            first_shape=list(a.shape),
            second_shape=list(b.shape),
        )
    return a, b


def _three_axes(a: Voxels) -> Voxels:
    """The array with leading axes added, or merged (which copies some strided arrays)."""
    if a.ndim <= 3:
        return a[(np.newaxis,) * (3 - a.ndim)]
    return a.reshape(-1, *a.shape[-2:])
