"""A picture that someone asks for: the words that the command line and the service share.

Both make a :class:`View` and hand it to :meth:`View.render`, so the same question has the same
picture, whichever way it came.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from octobrick.codec.errors import InvalidInputError

if TYPE_CHECKING:
    from octobrick.renderer import Camera, RenderedImage, Renderer, TransferFunction
    from octobrick.renderer.camera import Bounds
    from octobrick.store import Volume

Rgb = tuple[float, float, float]
Projection = Literal["perspective", "orthographic"]
Fit = Literal["visible", "volume"]

AZIMUTH_DEGREES = 30.0
ELEVATION_DEGREES = 15.0
FOV_DEGREES = 30.0
SIZE = (768, 768)
STEP_VOXELS = 0.5
PRESET = "ct-bone"


@dataclass(frozen=True, slots=True)
class View:
    """One picture of a volume; the defaults are those of the command line and of the service.

    Args:
        transfer_function: what turns values into colour and opacity.
        azimuth: degrees around the volume.
        elevation: degrees above its middle.
        fit: what the camera looks at: what the transfer function shows, or all of the volume.
        distance: world units from the centre of that; None where all of it is in view.
        fov: degrees across the shorter side of the picture.
        projection: of the camera.
        size: (width, height) in pixels.
        window: values at the ends of the transfer function; None for the volume's own.
        shading: light surfaces by the gradient.
        background: red, green and blue, 0 to 1; None for transparent.
        step_voxels: distance of samples along a ray.
        level: resolution to render; None for the renderer's choice.
        t: time step.
        c: channel.
        scale_bar: draw a length on the picture.
        legend: draw the colours of its values on it.
    """

    transfer_function: TransferFunction
    azimuth: float = AZIMUTH_DEGREES
    elevation: float = ELEVATION_DEGREES
    fit: Fit = "visible"
    distance: float | None = None
    fov: float = FOV_DEGREES
    projection: Projection = "perspective"
    size: tuple[int, int] = SIZE
    window: tuple[float, float] | None = None
    shading: bool = True
    background: Rgb | None = (0.0, 0.0, 0.0)
    step_voxels: float = STEP_VOXELS
    level: int | None = None
    t: int = 0
    c: int = 0
    scale_bar: bool = False
    legend: bool = False

    def camera(self, volume: Volume, times: Iterable[int] | None = None) -> Camera:
        """Where the picture is taken from.

        Args:
            volume: what it is of.
            times: steps of which all that is visible shall be in view; None for the view's own.

        Raises:
            InvalidInputError: a distance or an angle that no camera can have.
        """
        from octobrick.renderer import Camera

        bounds = self._visible_bounds(volume, times) if self.fit == "visible" else None
        camera = Camera.orbit(
            volume, self.azimuth, self.elevation, self.distance, self.fov, bounds=bounds
        )
        return camera.orthographic() if self.projection == "orthographic" else camera

    def render(
        self,
        renderer: Renderer,
        volume: Volume,
        *,
        camera: Camera | None = None,
        t: int | None = None,
    ) -> RenderedImage:
        """The picture. Only for the thread that made the renderer.

        Args:
            renderer: that makes it.
            volume: what it is of.
            camera: another than the view's own, such as the next of a movie.
            t: another time step than the view's own.

        Raises:
            InvalidInputError: what makes no sense for this volume, such as a level it lacks.
            OctobrickError: of the store or the renderer.
        """
        camera = camera or self.camera(volume)
        image = renderer.render(
            volume,
            camera,
            self.transfer_function,
            size=self.size,
            window=self.window,
            shading=self.shading,
            background=self.background,
            step_voxels=self.step_voxels,
            level=self.level,
            t=self.t if t is None else t,
            c=self.c,
        )
        return self._annotated(image, camera, volume)

    def _annotated(self, image: RenderedImage, camera: Camera, volume: Volume) -> RenderedImage:
        from octobrick.renderer import with_legend, with_scale_bar

        if self.scale_bar:
            image = with_scale_bar(image, camera, volume.unit)
        return with_legend(image, self.transfer_function) if self.legend else image

    def _visible_bounds(self, volume: Volume, times: Iterable[int] | None) -> Bounds:
        import numpy as np

        from octobrick.renderer import visible_bounds

        function, window = self.transfer_function, self.window
        boxes = [
            visible_bounds(volume, function, window, t=t, c=self.c)
            for t in ((self.t,) if times is None else times)
        ]
        lows, highs = zip(*boxes, strict=True)
        return np.min(lows, axis=0), np.max(highs, axis=0)


def preset_function(name: str) -> TransferFunction:
    """The transfer function of a preset.

    Raises:
        InvalidInputError: there is no such preset; the message names those that there are.
    """
    from octobrick.renderer import TransferFunction

    names = TransferFunction.preset_names()
    if name not in names:
        raise InvalidInputError(
            f"preset {name!r:.40} does not exist; choose one of {', '.join(names)}", field="preset"
        )
    return TransferFunction.preset(name)


def parse_background(text: str) -> Rgb | None:
    """A colour from ``#rrggbb`` (the # may be missing) or ``r,g,b``; None of ``transparent``.

    Raises:
        InvalidInputError: the text is none of them.
    """
    if text == "transparent":
        return None
    if match := re.fullmatch(r"#?([0-9a-fA-F]{2})([0-9a-fA-F]{2})([0-9a-fA-F]{2})", text):
        red, green, blue = (int(part, 16) / 255 for part in match.groups())
        return red, green, blue
    try:
        red, green, blue = (float(part) for part in text.split(","))
    except ValueError:
        red = green = blue = math.nan
    if not (0 <= red <= 1 and 0 <= green <= 1 and 0 <= blue <= 1):
        raise InvalidInputError(
            f"background {text!r:.40} is no colour; write it as #rrggbb, as three numbers from 0 "
            "to 1 with commas between them, or transparent",
            field="background",
        )
    return red, green, blue


def parse_window(text: str) -> tuple[float, float]:
    """The two values of ``LO,HI``.

    Raises:
        InvalidInputError: the text is not two finite numbers, the first one smaller.
    """
    try:
        low, high = (float(part) for part in text.split(","))
    except ValueError:
        low = high = math.nan
    if not (low < high and math.isfinite(high - low)):
        raise InvalidInputError(
            f"window {text!r:.40} is not two numbers LO,HI with LO < HI", field="window"
        )
    return low, high
