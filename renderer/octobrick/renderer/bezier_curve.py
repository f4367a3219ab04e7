"""The rational Bézier curve across a border of blocks, as numbers that a shader is given."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

STRENGTH_MAX: Final = 16.0
"""Up to this, weights are at least e⁻²⁸, as a gradient is at most √3."""
LOG_LEAST: Final = -52.0
LOG_GREATEST: Final = 74.0
"""Between these a sum of a curve's terms keeps within float32, times such a weight and 2¹⁶."""


@dataclass(frozen=True, slots=True)
class BezierCurve:
    """The curve through the voxels of two neighbouring blocks on a line.

    docs/spec/deblocking.md, "The curve".

    Attributes:
        before: voxels of the first block.
        after: voxels of the second, at least one.
    """

    before: int
    after: int

    @property
    def count(self) -> int:
        """Control points."""
        return self.before + self.after

    @property
    def first(self) -> int:
        """The first voxel that moves onto the curve."""
        return self.before - self.before // 2

    @property
    def noutputs(self) -> int:
        """How many do."""
        return self.before // 2 + self.after // 2

    def is_direct(self, strength: float) -> bool:
        """Whether weights can be multiplied in float32; else their logarithms are added."""
        sums = (self.count - 1) * -np.log(3 * (1 - self._positions()))
        within = (sums > LOG_LEAST).all() and (sums < LOG_GREATEST).all()
        return 0 <= strength <= STRENGTH_MAX and bool(within)

    def direct_terms(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Binomials of the control points, and (t / (1 − t), 0) of the outputs.

        A common factor of the weights cancels, so Bᵢ may be (n−1 over i)·(t / (1−t))ⁱ; the sum of
        these is (1 / (1−t))ⁿ⁻¹. As t lies between ¼ and ¾ where blocks are alike, that over 3ⁿ⁻¹ is
        never far from 1.
        """
        binomials = np.exp(self._log_binomials() - (self.count - 1) * math.log(3))
        t = self._positions()
        return binomials, np.stack([t / (1 - t), np.zeros_like(t)], -1)

    def logarithmic_terms(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Logarithms of the binomials, and (log t, log(1 − t)) of the outputs."""
        t = self._positions()
        return self._log_binomials(), np.stack([np.log(t), np.log1p(-t)], -1)

    def _positions(self) -> NDArray[np.float64]:
        """Of the outputs: never 0 or 1, as a block's outer half is at least one voxel."""
        s = np.arange(self.first, self.first + self.noutputs, dtype=np.float64)
        return s / (self.count - 1)

    def _log_binomials(self) -> NDArray[np.float64]:
        n = self.count
        terms = [math.lgamma(n) - math.lgamma(i + 1) - math.lgamma(n - i) for i in range(n)]
        return np.array(terms)
