"""Which bricks lie behind what is already opaque: feedback from the slabs in front of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from octobrick.renderer.brick_source import SourceLevel
from octobrick.renderer.selection import brick_bounds
from octobrick.renderer.view import View
from octobrick.store.box import Zyx

SLACK_PIXELS = 1.0
"""More than float32 rays stray from where float64 sees a brick."""


def unoccluded(
    bricks: NDArray[np.bool_],
    geometry: SourceLevel,
    brick_zyx: Zyx,
    view: View,
    tiles_unfinished: NDArray[np.bool_],
    tile: int,
) -> NDArray[np.bool_]:
    """The bricks of a mask that rays can still meet. Dropping the others changes no pixel.

    Args:
        bricks: (nz, ny, nx) of a level.
        geometry: of the level.
        brick_zyx: voxels of a brick.
        view: the rays.
        tiles_unfinished: (rows, columns) of tiles, whether any of its rays needs more samples.
        tile: pixels along each side of a tile.
    """
    found = np.argwhere(bricks)
    if not len(found) or tiles_unfinished.all():
        return bricks
    low, high = brick_bounds(found, 0, geometry, brick_zyx)
    picks = np.array([[(i >> axis) & 1 for axis in range(3)] for i in range(8)], dtype=bool)
    corners = np.where(picks, high[:, np.newaxis], low[:, np.newaxis])
    pixels, in_front = view.pixels_of(corners)
    rows, columns = tiles_unfinished.shape
    limits = np.array([columns, rows])
    first = np.floor((pixels.min(axis=1) - SLACK_PIXELS) / tile)
    beyond = np.floor((pixels.max(axis=1) + SLACK_PIXELS) / tile) + 1
    reaches_behind = ~in_front.all(axis=1, keepdims=True)  # of the eye: anywhere in the picture
    first = np.where(reaches_behind, 0, np.clip(first, 0, limits)).astype(np.intp)
    beyond = np.where(reaches_behind, limits, np.clip(beyond, 0, limits)).astype(np.intp)
    sums = np.zeros((rows + 1, columns + 1), np.intp)
    sums[1:, 1:] = tiles_unfinished.cumsum(axis=0).cumsum(axis=1)
    (x0, y0), (x1, y1) = first.T, beyond.T
    unfinished = sums[y1, x1] - sums[y0, x1] - sums[y1, x0] + sums[y0, x0]
    kept = np.zeros_like(bricks)
    kept[tuple(found[unfinished > 0].T)] = True
    return kept
