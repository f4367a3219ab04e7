"""A picture that someone asks for: the words that the command line and the service share.

Both make a :class:`View` and hand it to :meth:`View.render`, so the same question has the same
picture, whichever way it came.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, cast

from octobrick.codec.errors import InvalidInputError
from octobrick.server.views.own_functions import own_functions

if TYPE_CHECKING:
    from octobrick.renderer import (
        Camera,
        Isosurface,
        Light,
        RenderedImage,
        Renderer,
        Slice,
        TransferFunction,
        WorkingSet,
    )
    from octobrick.store import Volume

Rgb = tuple[float, float, float]
Xyz = tuple[float, float, float]
Window = tuple[float, float]
Projection = Literal["perspective", "orthographic"]
Fit = Literal["visible", "volume"]
ModeName = Literal["dvr", "mip", "minip", "average", "isosurface", "slice"]
GradientSource = Literal["auto", "stored", "differences"]
Sampling = Literal["nearest", "linear", "shared"]

AZIMUTH_DEGREES = 30.0
ELEVATION_DEGREES = 15.0
FOV_DEGREES = 30.0
SIZE = (768, 768)
STEP_VOXELS = 0.5


@dataclass(frozen=True, slots=True)
class View:
    """One picture of a volume; the defaults are those of the command line and of the service.

    Args:
        transfer_function: what turns values into colour and opacity, of each channel or of all;
            None for what `own_functions` finds.
        azimuth: degrees around the volume.
        elevation: degrees above its middle.
        fit: what the camera looks at: what the transfer function shows, or all of the volume.
        distance: world units from the centre of that; None where all of it is in view.
        fov: degrees across the shorter side of the picture.
        projection: of the camera.
        own_camera: where from, instead of all of these.
        oriented: angles are meant in the space of the volume's source, such as a patient's.
        size: (width, height) in pixels.
        mode: what rays make of their samples.
        iso: value of an isosurface.
        iso_opacity: of an isosurface.
        slice_normal: world direction across a slice; None for a slice that faces the camera.
        slice_point: world position on a slice; None for the middle of the volume.
        window: values at the ends of the transfer function, of each channel or of all; None for
            the volume's own.
        shading: light surfaces by the gradient.
        lights: where light comes from, instead of from the eye.
        gradients: those that the volume stores, or differences of what is shown.
        edges: magnitudes of the gradient at which opacity begins and is complete.
        deblocking: smooth what the codec's blocks left, perhaps at a strength.
        clip_box: low (x, y, z) and high (x, y, z) in world space; None for an open side.
        clip_planes: (nx, ny, nz, offset) of half-spaces, as `Clip` has them.
        background: red, green and blue, 0 to 1; None for transparent.
        step_voxels: distance of samples along a ray.
        level: resolution to render; None for the renderer's choice.
        t: time step.
        c: channel, or several.
        rgb: three channels are red, green and blue; those of c, or 0, 1 and 2.
        depth: tell how far away is what is seen.
        direct: decode what rays touch, in one of the renderer's ways, instead of slabs.
        scale_bar: draw a length on the picture.
        legend: draw the colours of its values on it.

    Raises:
        InvalidInputError: fields that do not go together.
    """

    transfer_function: TransferFunction | tuple[TransferFunction, ...] | None = None
    azimuth: float = AZIMUTH_DEGREES
    elevation: float = ELEVATION_DEGREES
    fit: Fit = "visible"
    distance: float | None = None
    fov: float = FOV_DEGREES
    projection: Projection = "perspective"
    own_camera: Camera | None = None
    oriented: bool = False
    size: tuple[int, int] = SIZE
    mode: ModeName = "dvr"
    iso: float | None = None
    iso_opacity: float = 1.0
    slice_normal: Xyz | None = None
    slice_point: Xyz | None = None
    window: Window | tuple[Window, ...] | None = None
    shading: bool = True
    lights: tuple[Light, ...] = ()
    gradients: GradientSource = "auto"
    edges: tuple[float, float] | None = None
    deblocking: bool | float = False
    clip_box: tuple[float | None, ...] | None = None
    clip_planes: tuple[tuple[float, float, float, float], ...] = ()
    background: Rgb | None = (0.0, 0.0, 0.0)
    step_voxels: float = STEP_VOXELS
    level: int | None = None
    t: int = 0
    c: int | tuple[int, ...] = 0
    rgb: bool = False
    depth: bool = False
    direct: Sampling | None = None
    scale_bar: bool = False
    legend: bool = False

    def __post_init__(self) -> None:
        is_surface, is_slice = self.mode == "isosurface", self.mode == "slice"
        unlit = not self.shading or self.mode not in ("dvr", "isosurface")
        cut = self.slice_normal is not None or self.slice_point is not None
        several = self.rgb or not isinstance(self.c, int)
        for wrong, field, message in (
            (is_surface and self.iso is None, "iso", "mode isosurface needs its value, iso"),
            (not is_surface and self.iso is not None, "iso", f"mode {self.mode} has no iso value"),
            (not is_surface and self.iso_opacity != 1, "iso_opacity", "is that of an isosurface"),
            (cut and not is_slice, "mode", f"mode {self.mode} has no plane; choose mode slice"),
            (
                self.lights and unlit,
                "lights",
                "neither slices, projections nor no shading have any",
            ),
            (several and self.legend, "legend", "is that of one channel; leave it out"),
        ):
            if wrong:
                raise InvalidInputError(f"{field}: {message}", field=field)

    @property
    def channels(self) -> int | tuple[int, ...]:
        """The channels that are shown: one, or several."""
        return (0, 1, 2) if self.rgb and self.c == 0 else self.c

    def camera(self, volume: Volume, times: Iterable[int] | None = None) -> Camera:
        """Where the picture is taken from.

        Args:
            volume: what it is of.
            times: steps of which all that is visible shall be in view; None for the view's own.

        Raises:
            InvalidInputError: a distance or an angle that no camera can have, or a volume whose
                source had no orientation where that was asked for.
        """
        from octobrick.renderer import Camera
        from octobrick.server.views.view_bounds import bounds_of

        if self.own_camera is not None:
            return self.turned(self.own_camera, volume)
        bounds = bounds_of(self, volume, (self.t,) if times is None else times)
        camera = Camera.orbit(
            volume, self.azimuth, self.elevation, self.distance, self.fov, bounds=bounds
        )
        if self.projection == "orthographic":
            camera = camera.orthographic()
        return self.turned(camera, volume)

    def turned(self, camera: Camera, volume: Volume) -> Camera:
        """A camera, turned by the orientation of the volume's source if the view asks for that."""
        if not self.oriented:
            return camera
        direction = volume.metadata()["source"].get("direction")
        if direction is None:
            raise InvalidInputError(
                f"oriented: the source of {volume.name} did not say how it is oriented; leave it "
                "out",
                field="oriented",
            )
        return camera.turned(direction)

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
        scene = self._scene(volume, camera, self.t if t is None else t)
        image = renderer.render(volume, camera, self.functions(volume), **scene)
        return self._annotated(image, camera, volume)

    def select(self, volume: Volume, budget_nbytes: int) -> WorkingSet:
        """The bricks that the picture needs, at a level whose bricks fit a budget.

        Raises:
            InvalidInputError: what makes no sense for this volume, such as a level it lacks.
        """
        from octobrick.renderer import select

        camera = self.camera(volume)
        scene = self._scene(volume, camera, self.t)
        size, functions = scene.pop("size"), self.functions(volume)
        # `select` takes one function for each channel too.
        return select(
            volume,
            camera,
            size,
            cast("TransferFunction", functions),
            budget_nbytes=budget_nbytes,
            **scene,
        )

    def level_within(self, volume: Volume, budget_nbytes: int) -> int:
        """The finest useful level whose bricks fit a budget, compressed; the coarsest if none does.

        Raises:
            PictureTooLargeError: the view names a level, whose bricks do not fit.
            InvalidInputError: what makes no sense for this volume.
        """
        from octobrick.renderer import PictureTooLargeError

        chosen = self.select(volume, budget_nbytes)
        if self.level is not None and chosen.nbytes > budget_nbytes:
            raise PictureTooLargeError(
                f"level {self.level} of this view needs {chosen.nbytes} bytes of bricks, and "
                f"{budget_nbytes} may be used; leave the level out, or raise budget_nbytes",
                level=self.level,
                nbytes=chosen.nbytes,
                budget_nbytes=budget_nbytes,
            )
        return chosen.level

    def prefetch(self, renderer: Renderer, volume: Volume, camera: Camera, t: int) -> None:
        """Read what a later `render` with this camera and time step needs, in the background."""
        scene = self._scene(volume, camera, t)
        renderer.prefetch(volume, camera, self.functions(volume), **scene)

    def functions(self, volume: Volume) -> TransferFunction | tuple[TransferFunction, ...]:
        """The transfer function of all channels, or one for each."""
        return self.transfer_function or own_functions(self, volume)

    def _scene(self, volume: Volume, camera: Camera, t: int) -> dict[str, Any]:
        """What `Renderer.render` takes by name."""
        from octobrick.renderer import Clip, Lighting

        low, high = (self.clip_box or (None,) * 6)[:3], (self.clip_box or (None,) * 6)[3:]
        clip = Clip(_corner(low, -math.inf), _corner(high, math.inf), self.clip_planes)
        return {
            "size": self.size,
            "mode": self._mode(volume, camera),
            "window": self.window,
            "shading": Lighting(lights=self.lights) if self.lights else self.shading,
            "gradients": self.gradients,
            "edges": self.edges,
            "deblocking": self.deblocking,
            "clip": clip,
            "background": self.background,
            "step_voxels": self.step_voxels,
            "level": self.level,
            "t": t,
            "c": self.channels,
            "rgb": self.rgb,
            "depth": self.depth,
            "direct": self.direct,
        }

    def _mode(self, volume: Volume, camera: Camera) -> ModeName | Isosurface | Slice:
        from octobrick.renderer import Isosurface, Slice
        from octobrick.renderer.camera import world_bounds

        if self.mode == "isosurface" and self.iso is not None:
            return Isosurface(self.iso, self.iso_opacity)
        if self.mode != "slice":
            return self.mode
        low, high = world_bounds(volume)
        middle, (_, _, forward) = (low + high) / 2, camera.basis_world()
        return Slice(self.slice_point or tuple(middle), self.slice_normal or tuple(forward))

    def _annotated(self, image: RenderedImage, camera: Camera, volume: Volume) -> RenderedImage:
        from octobrick.renderer import TransferFunction, with_legend, with_scale_bar

        if self.scale_bar:
            image = with_scale_bar(image, camera, volume.unit)
        function = self.functions(volume)
        if self.legend and isinstance(function, TransferFunction):
            image = with_legend(image, function)
        return image


def _corner(corner: tuple[float | None, ...], open_end: float) -> Xyz:
    x, y, z = (open_end if end is None else end for end in corner)
    return x, y, z


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
