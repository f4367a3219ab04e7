"""What of a volume can be seen at all, so that a camera need not frame the air around it."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable
from threading import Lock
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from octobrick.renderer.brick_source import BrickSource
from octobrick.renderer.camera import Bounds, world_bounds
from octobrick.renderer.classifier import Classifier, ValueScale, checked_window
from octobrick.renderer.transfer_function import TransferFunction

_KEPT = 64  # bounds of a view's functions, for the next pictures of it: bricks never change
_kept: OrderedDict[tuple[Hashable, ...], Bounds] = OrderedDict()
_lock = Lock()

_SIDE_MAX = 128  # voxels: 2 Mi at most are looked at, which takes a few milliseconds


class ReadableSource(BrickSource, Protocol):
    """A source that can also decode a level by itself, as `octobrick.store.Volume` can."""

    def read(self, level: int, *, t: int = 0, c: int = 0) -> NDArray[Any]:
        """All decoded voxels of a level: (z, y, x)."""


def visible_bounds(
    volume: ReadableSource,
    transfer_function: TransferFunction,
    window: tuple[float, float] | None = None,
    *,
    t: int = 0,
    c: int = 0,
) -> Bounds:
    """Lowest and highest world corner of what is not transparent; of all where nothing is visible.

    Looks at a coarse level, so what is thinner than its voxels may reach out of the bounds: right
    for framing a picture, wrong for leaving anything out of it.

    Args:
        volume: what to look at.
        transfer_function: which values are visible.
        window: values at relative positions 0 and 1; None takes the volume's.
        t: time step.
        c: channel.
    """
    sizes = [max(level.shape_zyx) for level in volume.levels]
    index = next((i for i, size in enumerate(sizes) if size <= _SIDE_MAX), len(sizes) - 1)
    window = checked_window(window, volume.window)
    key = (volume.revision, index, t, c, transfer_function, window)
    with _lock:
        bounds = _kept.get(key)
    if bounds is None:
        bounds = _bounds_in(volume, index, transfer_function, window, t=t, c=c)
        with _lock:
            _kept[key] = bounds
            while len(_kept) > _KEPT:
                _kept.popitem(last=False)
    low, high = bounds
    return low.copy(), high.copy()


def _bounds_in(
    volume: ReadableSource,
    index: int,
    transfer_function: TransferFunction,
    window: tuple[float, float],
    *,
    t: int,
    c: int,
) -> Bounds:
    level = volume.levels[index]
    voxels = volume.read(index, t=t, c=c)
    scale = ValueScale.of(volume.dtype, volume.value_range)
    classifier = Classifier(transfer_function, scale, window, step_ratio=1.0)
    visible = classifier.visible(voxels, voxels)
    if not visible.any():
        return world_bounds(volume)
    low, high = [], []
    for axis_xyz, spacing in enumerate(level.spacing_xyz):
        others = tuple(axis for axis in range(3) if axis != 2 - axis_xyz)
        at = np.flatnonzero(visible.any(axis=others))
        origin = level.origin_xyz[axis_xyz]
        low.append(origin + (at[0] - 0.5) * spacing)
        high.append(origin + (at[-1] + 0.5) * spacing)
    return np.array(low), np.array(high)
