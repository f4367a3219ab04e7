"""Where two pictures differ, in the S3Dc paper's colours."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

SMALL, MIDDLE, LARGE = 0.05, 0.10, 0.15  # parts of the peak
COLOURS = ("blue", "green", "yellow", "red")


def difference_picture(a_rgb: NDArray[np.uint8], b_rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Blue below 5 %, green below 10 %, yellow from there, red from 15 %; equal pixels are black.

    The paper gives no colour to 10 … 15 %, and leaves the measure open: this is the greatest
    difference of a channel.

    Args:
        a_rgb: (h, w, 3).
        b_rgb: of the same shape.
    """
    away = share(a_rgb, b_rgb)[..., np.newaxis]
    blue = 90 + 165 * np.minimum(away / SMALL, 1)
    shown = np.where(away > 0, blue * [0.2, 0.2, 1.0], 0)
    shown = np.where(away >= SMALL, (0, 190, 60), shown)
    shown = np.where(away >= MIDDLE, (255, 225, 0), shown)
    shown = np.where(away >= LARGE, (230, 30, 20), shown)
    return shown.astype(np.uint8)


def share(a_rgb: NDArray[np.uint8], b_rgb: NDArray[np.uint8]) -> NDArray[Any]:
    """The greatest difference of a channel, of each pixel, as a part of the peak."""
    away: NDArray[Any] = np.abs(a_rgb.astype(int) - b_rgb).max(axis=-1) / 255
    return away


def classes(a_rgb: NDArray[np.uint8], b_rgb: NDArray[np.uint8]) -> dict[str, float]:
    """Per cent of the pixels that are not black in both, by colour."""
    seen = (a_rgb.any(axis=-1)) | (b_rgb.any(axis=-1))
    away = share(a_rgb, b_rgb)[seen]
    limits = (0.0, SMALL, MIDDLE, LARGE, np.inf)
    parts = [((away >= low) & (away < high)).mean() for low, high in pairwise(limits)]
    return dict(zip(COLOURS, (100 * float(part) for part in parts), strict=True))
