"""Whether a volume has what an address names: levels, time steps, channels, bricks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from octobrick.server.errors import BrickNotFoundError
from octobrick.store import Volume
from octobrick.store.brick_stream import Kind


def require_place(volume: Volume, level: int, t: int, c: int) -> None:
    """Refuse a level, time step or channel that the volume lacks.

    Raises:
        BrickNotFoundError: naming it, with the number of those that there are.
    """
    for what, index, count in (
        ("level", level, len(volume.levels)),
        ("time step", t, volume.nt),
        ("channel", c, volume.nc),
    ):
        if not 0 <= index < count:
            raise BrickNotFoundError(
                f"The volume has no {what} {index}; it has {count}, counted from 0",
                index=index,
                count=count,
            )


def require_bricks(volume: Volume, kind: Kind, places: NDArray[np.int64]) -> None:
    """Refuse a list with a brick that the volume lacks.

    Args:
        volume: whose bricks.
        kind: of the bricks; gradients are those of the levels that store any.
        places: (n, 6) level, t, c, z, y, x of each.

    Raises:
        BrickNotFoundError: naming the first such brick and its index in the list.
    """
    sizes = [(volume.nt, volume.nc, *level.grid_zyx) for level in volume.levels]
    if kind is Kind.GRADIENTS:
        levels = () if volume.gradients is None else volume.gradients.levels
        sizes = [size if i in levels else (0,) * 5 for i, size in enumerate(sizes)]
    table = np.array([*sizes, (0,) * 5], np.int64)  # the last one stands for levels beyond
    level = np.minimum(places[:, 0], len(sizes))
    lacking = (places < 0).any(axis=1) | (places[:, 1:] >= table[level]).any(axis=1)
    if lacking.any():
        index = int(lacking.argmax())
        place = [int(n) for n in places[index]]
        raise BrickNotFoundError(
            f"The volume has no {kind.name.lower()} of brick {place} (level, t, c, z, y, x), which "
            f"is number {index} of the list, counted from 0; its metadata says what it has",
            index=index,
            brick=place,
        )
