"""How alike pictures are: the codec's metrics, over one view or several."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from octobrick.codec.metrics import ErrorStats, SsimStats, compare, ssim_stats
from octobrick.measure.pictures.difference_picture import Pixels

PEAK = 255
"""Colours are compared against what 8 bits can hold, as usual for pictures."""


@dataclass(frozen=True, slots=True)
class Likeness:
    """Errors of colours and similarity of greys; adds up over views with `+`."""

    errors: ErrorStats = field(default_factory=ErrorStats)
    windows: SsimStats = field(default_factory=SsimStats)

    @classmethod
    def of(cls, wanted_rgb: Pixels, found_rgb: Pixels) -> Likeness:
        """Of two pictures (h, w, 3), at least 11 pixels on each side."""
        greys = wanted_rgb.mean(axis=2), found_rgb.mean(axis=2)
        return cls(compare(wanted_rgb, found_rgb), ssim_stats(*greys, PEAK))

    def __add__(self, other: Likeness) -> Likeness:
        """Of both views together."""
        return Likeness(self.errors + other.errors, self.windows + other.windows)

    @property
    def psnr_db(self) -> float | None:
        """None where all pixels are equal."""
        psnr = self.errors.psnr(PEAK)
        return psnr if math.isfinite(psnr) else None

    @property
    def ssim(self) -> float:
        """Mean over all windows; 1 where all pixels are equal."""
        return self.windows.mean
