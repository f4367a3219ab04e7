"""Structural similarity: SSIM of images and volumes, whole or in parts.

Wang, Bovik, Sheikh, Simoncelli, "Image Quality Assessment: From Error Visibility to Structural
Similarity", 2004: an 11-tap Gaussian window, and the constants of its section III.B.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.arrays import Voxels
from octobrick.codec.errors import InvalidInputError
from octobrick.codec.metrics.values import require_peak, require_same_shape, value_range

_TAPS = 11
_HALO = _TAPS // 2
_SIGMA = 1.5
_K1, _K2 = 0.01, 0.03
_MOST_CHANNELS = 4  # RGBA

# Voxels smoothed at once, by number of axes. With halo that is 2 MiB of float64, some eight times:
# small enough for a cache, large enough that the halo does not cost as much again.
_TILES = {2: (256, 1024), 3: (32, 48, 96)}


@dataclass(frozen=True, slots=True)
class SsimStats:
    """What is needed to know the SSIM of a whole from that of its parts: add them up.

    Args:
        count: windows looked at; one in each channel.
        total: the sum of their similarities.
    """

    count: int = 0
    total: float = 0

    def __add__(self, other: SsimStats) -> SsimStats:
        """The windows of both parts together."""
        return SsimStats(self.count + other.count, self.total + other.total)

    @property
    def mean(self) -> float:
        """The mean structural similarity: what `ssim` returns of the whole.

        Raises:
            InvalidInputError: there was no window.
        """
        if not self.count:
            raise InvalidInputError(
                f"no window of {_TAPS} voxels on each axis lay inside of a part; cut the volume "
                "with ssim_parts, which gives each part its halo"
            )
        return self.total / self.count


def ssim(a: Voxels, b: Voxels, peak: float | None = None) -> float:
    """The mean structural similarity of two images or volumes; 1 where they are equal.

    After Wang et al. 2004 with an 11-tap Gaussian window per axis, σ 1.5, K1 0.01, K2 0.03; only
    windows that lie wholly inside count. In volumes the window is 11³. Channels are averaged.
    Computed in float64, tile by tile: some 20 MiB are used beside the arrays. Variances are
    differences of squares: on an offset of 10 000 peaks the result is 1e-8 off, on one of a
    million 1e-4, so subtract such an offset from both. NaN gives NaN; in `a` it needs a given peak.

    Args:
        a: (y, x), (y, x, channels) with up to four channels, or (z, y, x). Three axes of which
            the last is 4 or less can only be an image: no volume so thin holds a window.
        b: of the same shape.
        peak: the greatest possible difference; None chooses as the module says.

    Raises:
        InvalidInputError: the shapes differ, an axis is shorter than the window, or the peak is
            negative or NaN.
    """
    a, b = require_same_shape(a, b)
    axes = a.ndim - _has_channels(a)
    if axes not in (2, 3) or min(a.shape[:axes]) < _TAPS:
        raise InvalidInputError(
            f"SSIM compares images and volumes of at least {_TAPS} voxels on each axis, "
            f"not {a.shape}; use psnr, or crop differently",
            shape=list(a.shape),
        )
    return ssim_stats(a, b, value_range(a).peak if peak is None else peak).mean


def ssim_stats(a: Voxels, b: Voxels, peak: float) -> SsimStats:
    """The similarity of all windows that lie wholly inside two parts of images or volumes.

    A window belongs to its centre. So a part that has a halo of 5 voxels on each side, less where
    the whole ends, holds the windows of its own voxels and no others, and the parts of a whole add
    up to its windows, each counted once; `ssim_parts` cuts so. With a wider halo windows would be
    counted twice, with a narrower one left out. A part without a window has a count of 0.

    Args:
        a: (y, x), (y, x, channels) or (z, y, x), as for `ssim`; axes may be shorter than a window.
        b: of the same shape.
        peak: the greatest possible difference in the whole, at least 0; the same for all parts.

    Raises:
        InvalidInputError: the shapes differ, there are other axes, or the peak is negative or NaN.
    """
    a, b = require_same_shape(a, b)
    peak = require_peak(peak)
    if _has_channels(a):
        channels = (ssim_stats(a[..., c], b[..., c], peak) for c in range(a.shape[-1]))
        return sum(channels, SsimStats())
    if a.ndim not in _TILES:
        raise InvalidInputError(
            f"SSIM compares images (y, x), (y, x, channels) and volumes (z, y, x), not {a.shape}",
            shape=list(a.shape),
        )
    total = SsimStats()
    for tile in ssim_parts(a.shape, _TILES[a.ndim]):
        if min(s.stop - s.start for s in tile) >= _TAPS:
            similarity = _similarities(a[tile], b[tile], peak)
            total += SsimStats(similarity.size, float(similarity.sum()))
    return total


def ssim_parts(shape: Sequence[int], part: Sequence[int]) -> Iterator[tuple[slice, ...]]:
    """The slices that cut an image or volume into parts for `ssim_stats`, halo included.

    They overlap by 10 voxels, and serve as index of anything that takes slices: numpy arrays,
    memory maps, Zarr arrays. No more than two parts need to be in memory at a time.

    Args:
        shape: of the whole; axes beyond those of `part`, such as channels, are not cut.
        part: voxels of a part along each axis, without halo.

    Raises:
        InvalidInputError: there are more axes in `part` than in `shape`, or one is below 1.
    """
    if len(part) > len(shape) or any(n < 1 for n in part):
        raise InvalidInputError(
            f"parts of {tuple(part)} voxels cannot cut {tuple(shape)}; give at least 1 voxel for "
            "each axis to cut",
            part=list(part),
            shape=list(shape),
        )
    along = [
        [slice(max(0, at - _HALO), min(n, at + step + _HALO)) for at in range(0, n, step)]
        for n, step in zip(shape[: len(part)], part, strict=True)
    ]
    return itertools.product(*along)


def _has_channels(a: Voxels) -> bool:
    return a.ndim == 3 and a.shape[-1] <= _MOST_CHANNELS


def _similarities(a: Voxels, b: Voxels, peak: float) -> NDArray[np.float64]:
    """The similarity of each window: of arrays of n voxels along an axis, n − 10."""
    a, b = a.astype(np.float64), b.astype(np.float64)
    mean_a, mean_b = _smooth(a), _smooth(b)
    square_a, square_b, product = mean_a**2, mean_b**2, mean_a * mean_b
    covariance = _smooth(a * b) - product
    variances = _smooth(a * a + b * b) - square_a - square_b
    c1, c2 = (_K1 * peak) ** 2, (_K2 * peak) ** 2
    above = (2 * product + c1) * (2 * covariance + c2)
    below = (square_a + square_b + c1) * (variances + c2)
    # 0/0: both are zero throughout a window, and the peak is 0. They are equal there.
    return np.divide(above, below, out=np.ones_like(above), where=below != 0)


def _smooth(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """The Gaussian-weighted means of all windows that lie inside.

    Sums are taken in the same order wherever a window lies, so that it does not depend on how a
    volume is cut.
    """
    at = np.arange(_TAPS) - _HALO
    taps = np.exp(-(at**2) / (2 * _SIGMA**2))
    taps /= taps.sum()
    for axis in range(values.ndim):
        values = _smooth_axis(values, axis, taps)
    return values


def _smooth_axis(
    values: NDArray[np.float64], axis: int, taps: NDArray[np.float64]
) -> NDArray[np.float64]:
    count = values.shape[axis] - 2 * _HALO
    before: tuple[slice, ...] = (slice(None),) * axis

    def shifted(by: int) -> NDArray[np.float64]:
        return values[(*before, slice(by, by + count))]

    means: NDArray[np.float64] = shifted(_HALO) * taps[_HALO]
    pair = np.empty_like(means)
    for tap in range(_HALO):  # the window is symmetric
        np.add(shifted(tap), shifted(_TAPS - 1 - tap), out=pair)
        pair *= taps[tap]
        means += pair
    return means
