"""What makes a coarser voxel of 2×2×2, by name; and the shapes of the levels that result."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import reduce
from octobrick.store.box import Zyx

Voxels = NDArray[np.generic]
Reducer = Callable[[Voxels], Voxels]

REDUCERS: dict[str, Reducer] = {
    "mean": reduce.mean2,
    "max": reduce.max2,
    "min": reduce.min2,
    "mode": reduce.mode2,
    "nearest": reduce.nearest2,
}


def level_shapes(shape_zyx: Zyx, brick: int, nlevels: int | None = None) -> tuple[Zyx, ...]:
    """The shapes of a pyramid: each level half as fine per axis, rounded up.

    Without ``nlevels`` the last level is the first that fits into one brick.
    """
    shapes = [shape_zyx]
    while (max(shapes[-1]) > brick) if nlevels is None else (len(shapes) < nlevels):
        z, y, x = shapes[-1]
        shapes.append(((z + 1) // 2, (y + 1) // 2, (x + 1) // 2))
    return tuple(shapes)
