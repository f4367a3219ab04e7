"""Transfer functions of a view that nobody gave one: what suits its mode and its channels."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from octobrick.renderer import TransferFunction
    from octobrick.server.views.view import View
    from octobrick.store import Volume

PRESET: Final = "ct-bone"
FALLBACK: Final = ("00ff00", "ff00ff", "00ffff", "ffff00")
"""Of channels whose source named no colours: each two differ for most people's eyes."""
IVORY: Final = (0.93, 0.89, 0.82)
"""Of an isosurface: all of it has one value, so a colour tells nothing, but light on it does."""
CLEAR: Final = 0.1
"""Share of the window up to which a ramp is transparent: noise and glow stay out of the way."""
DENSE: Final = 0.3
"""Opacity of the greatest value: what lies behind it still shows."""


def own_functions(view: View, volume: Volume) -> TransferFunction | tuple[TransferFunction, ...]:
    """A function for all of the view's channels, or one for each.

    Of several channels, a ramp from clear to its colour for each; of colours, one for their
    luminance. Of one channel, ivory for an isosurface, greys for projections and slices, and a
    preset where rays gather light.
    """
    from octobrick.renderer import TransferFunction

    if view.rgb:
        return _ramp("ffffff")
    channels = view.channels
    if not isinstance(channels, int):
        return tuple(_ramp(color) for color in _colors(volume, channels))
    if view.mode == "dvr":
        return TransferFunction.preset(PRESET)
    if view.mode == "isosurface":
        return TransferFunction(((0.0, IVORY),), ((0.0, 1.0),))
    return TransferFunction(((0.0, (0.0, 0.0, 0.0)), (1.0, (1.0, 1.0, 1.0))), ((0.0, 1.0),))


def _colors(volume: Volume, channels: Iterable[int]) -> list[str]:
    """As the volume's source said them, or others."""
    said = volume.metadata()["source"].get("channel_colors") or []
    colors = []
    for place, c in enumerate(channels):
        own = str(said[c]) if c < len(said) else ""
        known = re.fullmatch("[0-9a-fA-F]{6}", own) is not None
        colors.append(own if known else FALLBACK[place % len(FALLBACK)])
    return colors


def _ramp(color: str) -> TransferFunction:
    """A function of one colour, `rrggbb`: the greater the value, the brighter and denser."""
    from octobrick.renderer import TransferFunction

    red, green, blue = (int(color[i : i + 2], 16) / 255 for i in (0, 2, 4))
    return TransferFunction.from_points(
        [
            (CLEAR, (red * CLEAR, green * CLEAR, blue * CLEAR), 0.0),
            (1.0, (red, green, blue), DENSE),
        ],
        opacity_unit="extent",
    )
