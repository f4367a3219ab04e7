"""What of a volume a view's camera looks at: what its transfer functions, surface or cut show."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from octobrick.renderer import TransferFunction
    from octobrick.renderer.camera import Bounds
    from octobrick.server.views.view import View
    from octobrick.store import Volume


def bounds_of(view: View, volume: Volume, times: Iterable[int]) -> Bounds | None:
    """Lowest and highest world corner of what is visible at these steps; None for all of it.

    A slice shows all that it meets, so it has the whole volume's. What a box clips away counts as
    invisible, unless it is all.

    Raises:
        InvalidInputError: the view's channels, functions and windows do not fit the volume.
    """
    from octobrick.renderer import visible_bounds
    from octobrick.renderer.render_request import checked_channels

    if view.fit == "volume":
        return None
    channels = checked_channels(volume, view.channels, view.functions(volume), view.window)
    if view.mode == "slice":
        return None
    boxes = [
        visible_bounds(volume, _shown(view, volume, one.function), one.window, t=t, c=one.c)
        for t in times
        for one in channels
    ]
    lows, highs = zip(*boxes, strict=True)
    return _clipped(view, (np.min(lows, axis=0), np.max(highs, axis=0)))


def _shown(view: View, volume: Volume, function: TransferFunction) -> TransferFunction:
    """A function that shows what the view does: an isosurface lies around the values above it."""
    from octobrick.renderer import TransferFunction

    if view.iso is None:
        return function
    low, high = min(float(volume.value_range[0]), view.iso - 1), view.iso
    return TransferFunction(
        ((low, (1.0, 1.0, 1.0)),), ((low, 0.0), (high, 0.0), (high, 1.0)), "value"
    )


def _clipped(view: View, bounds: Bounds) -> Bounds:
    if view.clip_box is None:
        return bounds
    ends = np.array([np.nan if end is None else end for end in view.clip_box], np.float64)
    low, high = np.fmax(bounds[0], ends[:3]), np.fmin(bounds[1], ends[3:])
    return (low, high) if (low < high).all() else bounds
