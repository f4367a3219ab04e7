"""Where pictures are taken from, so that no side of a volume is left out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final


@dataclass(frozen=True, slots=True)
class ViewChoice:
    """A camera around what is visible of a volume.

    Attributes:
        azimuth: degrees around it, as `octobrick render` takes them.
        elevation: degrees above its middle.
        zoom: how many times as large as where all of it is in view.
    """

    azimuth: float
    elevation: float
    zoom: float = 1.0

    @property
    def name(self) -> str:
        """For people: "azimuth 30°, elevation 15°, 2.5 times as near"."""
        near = "" if self.zoom == 1 else f", {self.zoom:g} times as near"
        return f"azimuth {self.azimuth:g}°, elevation {self.elevation:g}°{near}"

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready fields."""
        return {"azimuth": self.azimuth, "elevation": self.elevation, "zoom": self.zoom}


DEFAULT_VIEWS: Final = (
    ViewChoice(30, 15),
    ViewChoice(150, -25),
    ViewChoice(270, 60),
    ViewChoice(30, 15, zoom=2.5),
)
"""Three orbits, in each of which another axis is the main one, and the first from close by."""
