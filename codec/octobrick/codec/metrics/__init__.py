"""How far decoded data are from the original: max error, RMSE, PSNR, SSIM, angles; histograms.

All functions are pure and thread-safe. Where a `peak` is wanted and none is given, it is the value
range of the first array (its maximum − minimum), whatever its type: the range of the type says
nothing about data that use a part of it. For 8-bit pictures the literature takes 255: say so.

Data that do not fit into memory are compared part by part. Every measure has a value that adds up
with `+`, and what is added up over the parts is that of the whole:

    errors, values = ErrorStats(), ValueRange()
    for part in parts:
        errors += compare(original[part], decoded[part])
        values += value_range(original[part])
    errors.psnr(values.peak)

    windows = SsimStats()  # these need a halo, and the peak beforehand
    for part in ssim_parts(original.shape, (64, 64, 64)):
        windows += ssim_stats(original[part], decoded[part], values.peak)
    windows.mean

    angles = AngularStats()
    for part in parts:
        angles += angular_stats(original_gradients[part], decoded_gradients[part])
    angles.percentile(99)

    counts = Histogram()
    for part in parts:
        counts += histogram(original[part], original[part].min(), original[part].max())
    counts.quantile(0.99)
"""

from __future__ import annotations

from octobrick.codec.metrics.angles import AngularStats, angular_error, angular_stats
from octobrick.codec.metrics.differences import ErrorStats, compare, max_error, psnr
from octobrick.codec.metrics.histogram import BINS_MAX, Histogram, histogram
from octobrick.codec.metrics.similarity import SsimStats, ssim, ssim_parts, ssim_stats
from octobrick.codec.metrics.values import ValueRange, value_range

__all__ = [
    "BINS_MAX",
    "AngularStats",
    "ErrorStats",
    "Histogram",
    "SsimStats",
    "ValueRange",
    "angular_error",
    "angular_stats",
    "compare",
    "histogram",
    "max_error",
    "psnr",
    "ssim",
    "ssim_parts",
    "ssim_stats",
    "value_range",
]
