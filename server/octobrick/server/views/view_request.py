"""A view, from a query or from JSON: checked fields, and the `View` that they mean.

Requests for pictures and for bricks say what they look at in the same words. A query has them as
text, and becomes the body that means the same.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StrictBool, ValidationError

from octobrick.codec.errors import InvalidInputError
from octobrick.server.errors import LimitError
from octobrick.server.settings import Settings
from octobrick.server.views import view, view_text
from octobrick.server.views.view import (
    Fit,
    GradientSource,
    ModeName,
    Projection,
    View,
    Xyz,
    parse_background,
    parse_window,
    preset_function,
)

if TYPE_CHECKING:
    from octobrick.renderer import Camera, Light, TransferFunction

CHANNELS_MAX = 4
"""Channels of a picture, and so transfer functions and windows."""
LIGHTS_MAX = 4
PLANES_MAX = 12

Pair = tuple[float, float]
Index = Annotated[int, Field(ge=0)]

_WINDOW = (
    "Values at the ends of the transfer function; the volume's without. One for all channels, "
)
_WINDOW += "or one for each."
_PRESET = "Transfer function: ct-bone, ct-soft-tissue, mr or microscopy; one for all channels, or "
_PRESET += "one for each. Without: ct-bone; greys, ivory or the channels' colours, as fits."


def _checked_background(text: str) -> str:
    parse_background(text)
    return text


class _ViewFields(BaseModel):
    """What a query and a body have in common."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    azimuth: float = Field(view.AZIMUTH_DEGREES, description="Degrees around the volume.")
    elevation: float = Field(
        view.ELEVATION_DEGREES, ge=-90, le=90, description="Degrees above its middle."
    )
    fit: Fit = Field(
        "visible", description="Look at what the transfer function shows, or at all of the volume."
    )
    distance: float | None = Field(
        None, gt=0, description="World units from its centre; all of it is in view without."
    )
    fov: float = Field(
        view.FOV_DEGREES, gt=0, lt=180, description="Degrees across the picture's shorter side."
    )
    projection: Projection = Field("perspective", description="Of the camera.")
    oriented: bool = Field(
        False, description="Mean angles in the space of the source, such as a patient's."
    )
    width: int = Field(view.SIZE[0], ge=1, description="Pixels.", examples=[96])
    height: int = Field(view.SIZE[1], ge=1, description="Pixels.", examples=[64])
    mode: ModeName = Field("dvr", description="What rays make of their samples.")
    iso: float | None = Field(None, description="Value of an isosurface.")
    iso_opacity: float = Field(
        1.0, gt=0, le=1, description="Less lets further surfaces shine through."
    )
    rgb: bool = Field(False, description="Channels 0, 1 and 2, or those of c, are colours.")
    shading: bool = Field(True, description="Light surfaces by the gradient.")
    gradients: GradientSource = Field(
        "auto", description="What surfaces are lit by: the volume's gradients, or differences."
    )
    background: Annotated[str, AfterValidator(_checked_background)] = Field(
        "000000",
        max_length=80,
        description="rrggbb, or r,g,b from 0 to 1, or transparent.",
        examples=["202020"],
    )
    step_voxels: float = Field(
        view.STEP_VOXELS, ge=0.1, le=16, description="Distance of samples along a ray, in voxels."
    )
    level: int | None = Field(
        None, ge=0, description="Resolution to render; the renderer chooses without."
    )
    t: int = Field(0, ge=0, description="Time step.")
    scale_bar: bool = Field(False, description="Draw a round length on the picture.")
    legend: bool = Field(False, description="Draw the colours of the values on it.")
    revision: str | None = Field(
        None,
        max_length=128,
        description="Refuse any other revision with 410; the answer can then be kept for ever.",
    )

    def require_within(self, settings: Settings) -> None:
        """Refuse a picture that is larger than the settings allow.

        Raises:
            LimitError: with the name of the limit and both values.
        """
        for what, value, limit_name in (
            ("longer side", max(self.width, self.height), "max_image_side"),
            ("number of pixels", self.width * self.height, "max_image_pixels"),
        ):
            limit = getattr(settings, limit_name)
            if value > limit:
                raise LimitError(
                    f"The picture's {what} is {value}; this server renders at most {limit}",
                    limit_name=limit_name,
                    limit=limit,
                    value=value,
                )


class CameraBody(BaseModel):
    """A camera of one's own, as `octobrick.renderer.Camera` has it."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    eye_world_xyz: Xyz = Field(description="Where rays start.")
    target_world_xyz: Xyz = Field(description="What is in the middle of the picture.")
    up_world_xyz: Xyz = Field((0.0, 0.0, 1.0), description="What points up in the picture.")
    fov_degrees: float | None = Field(
        None, gt=0, lt=180, description="Angle across the shorter side, in perspective."
    )
    height_world: float | None = Field(
        None, gt=0, description="World units across the shorter side, for parallel rays."
    )

    def to_camera(self) -> Camera:
        """The camera that the fields mean.

        Raises:
            InvalidInputError: fields that do not go together.
        """
        from octobrick.renderer import Camera

        return Camera(**self.model_dump())


class LightBody(BaseModel):
    """Light from a direction, or from the eye."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    toward_world_xyz: Xyz | None = Field(None, description="Towards the light; null at the eye.")
    color: str = Field("ffffff", pattern="^#?[0-9a-fA-F]{6}$", description="rrggbb.")

    def to_light(self) -> Light:
        """The light that the fields mean.

        Raises:
            InvalidInputError: a direction without length.
        """
        from octobrick.renderer import Light

        color = parse_background(self.color)
        assert color is not None
        return Light(self.toward_world_xyz, color)


def _checked_windows(windows: Any) -> Any:
    for low, high in _listed(windows, pair=True):
        parse_window(f"{low!r},{high!r}")
    return windows


class ViewBody(_ViewFields):
    """A view, as JSON, with a transfer function and a camera of one's own if wanted."""

    model_config = ConfigDict(
        json_schema_extra={"examples": [{"azimuth": 45, "preset": "mr", "width": 96, "height": 64}]}
    )

    preset: str | Annotated[list[str], Field(max_length=CHANNELS_MAX)] | None = Field(
        None, description=_PRESET
    )
    transfer_function: (
        dict[str, Any] | Annotated[list[dict[str, Any]], Field(max_length=CHANNELS_MAX)] | None
    ) = Field(None, description="Instead of a preset: as TransferFunction.to_json writes it.")
    window: Annotated[
        Pair | Annotated[list[Pair], Field(max_length=CHANNELS_MAX)] | None,
        AfterValidator(_checked_windows),
    ] = Field(None, description=_WINDOW)
    camera: CameraBody | None = Field(
        None, description="Instead of azimuth, elevation, fit, distance, fov and projection."
    )
    c: Index | Annotated[list[Index], Field(min_length=1, max_length=CHANNELS_MAX)] = Field(
        0, description="Channel, or up to four."
    )
    slice_normal: Xyz | None = Field(
        None, description="World direction across a slice; that of the view without."
    )
    slice_point: Xyz | None = Field(
        None, description="World position on a slice; the middle of the volume without."
    )
    clip_box: Annotated[list[float | None], Field(min_length=6, max_length=6)] | None = Field(
        None, description="Show only this box of world space, x0 y0 z0 x1 y1 z1; null is open."
    )
    clip_plane: list[tuple[float, float, float, float]] = Field(
        [], max_length=PLANES_MAX, description="nx ny nz offset: show only where n·p + offset >= 0."
    )
    light: list[LightBody] = Field(
        [], max_length=LIGHTS_MAX, description="Where light comes from; from the eye without."
    )
    edges: Pair | None = Field(
        None, description="Opacity grows between these magnitudes of the gradient."
    )
    deblocking: StrictBool | float = Field(
        False, description="Smooth what the codec's blocks left, perhaps at another strength."
    )

    def as_body(self) -> Self:
        """This body: a query has a function of that name too."""
        return self

    def to_view(self) -> View:
        """The view that the fields mean.

        Raises:
            InvalidInputError: fields that do not go together.
        """
        return View(
            transfer_function=_one_or_all(self._functions()),
            own_camera=None if self.camera is None else self.camera.to_camera(),
            size=(self.width, self.height),
            window=_one_or_all(_listed(self.window, pair=True)),
            c=_one_or_all(_listed(self.c)),
            lights=tuple(light.to_light() for light in self.light),
            clip_box=None if self.clip_box is None else tuple(self.clip_box),
            clip_planes=tuple(self.clip_plane),
            background=parse_background(self.background),
            **{name: getattr(self, name) for name in _SAME_IN_VIEW},
        )

    def _functions(self) -> list[TransferFunction]:
        from octobrick.renderer import TransferFunction

        own, presets = _listed(self.transfer_function), _listed(self.preset)
        if own:
            return [TransferFunction.from_json(json.dumps(function)) for function in own]
        return [preset_function(name) for name in presets]


_SAME_IN_VIEW = (
    *("azimuth", "elevation", "fit", "distance", "fov", "projection", "oriented", "mode", "iso"),
    *("iso_opacity", "slice_normal", "slice_point", "shading", "gradients", "edges", "deblocking"),
    *("step_voxels", "level", "t", "rgb", "scale_bar", "legend"),
)


def _text(description: str, examples: list[str] | None = None) -> Any:
    return Field(None, max_length=200, description=description, examples=examples)


Texts = Annotated[list[Annotated[str, Field(max_length=200)]], Field(max_length=PLANES_MAX)]


class ViewQuery(_ViewFields):
    """A view, all in the query of an address."""

    body_type: ClassVar[type[ViewBody]] = ViewBody

    preset: Texts = Field([], description=_PRESET, examples=[["ct-bone"]])
    window: Texts = Field([], description=f"LO,HI. {_WINDOW}", examples=[["0,1500"]])
    c: str | None = _text("Channel, or up to four with commas between them; 0 without.")
    slice_normal: str | None = _text("X,Y,Z: world direction across a slice.")
    slice_point: str | None = _text("X,Y,Z: world position on a slice.")
    clip_box: str | None = _text("X0,Y0,Z0,X1,Y1,Z1: show only this box; a part may be empty.")
    clip_plane: Texts = Field([], description="NX,NY,NZ,OFFSET: show only where n·p + offset >= 0.")
    light: Texts = Field([], description="X,Y,Z or eye, perhaps with :rrggbb. May be repeated.")
    edges: str | None = _text("LO,HI: opacity grows between these magnitudes of the gradient.")
    deblocking: str | None = _text("true, or a strength: smooth what the codec's blocks left.")

    def as_body(self) -> ViewBody:
        """The same view as JSON has it.

        Raises:
            InvalidInputError: a text that is not what it should be; the field is named.
        """
        given = self.model_dump(exclude=set(_PARSERS), exclude_unset=True)
        for name, parse in _PARSERS.items():
            text = getattr(self, name)
            if isinstance(text, list):
                parsed = [parse(name, one) for one in text]
                alone = len(parsed) == 1 and name in ("preset", "window")
                given |= {name: parsed[0] if alone else parsed} if parsed else {}
            elif text is not None:
                given[name] = parse(name, text)
        try:
            return self.body_type.model_validate(given)
        except ValidationError as error:
            raise _refused(error) from error

    def to_view(self) -> View:
        """The view that the fields mean.

        Raises:
            InvalidInputError: a text that is not what it should be, or fields that do not go
                together.
        """
        return self.as_body().to_view()


def _numbers(example: str) -> Callable[[str, str], list[float]]:
    return lambda field, text: view_text.numbers(field, text, example)


_PARSERS: dict[str, Callable[[str, str], Any]] = {
    "preset": lambda _field, text: text,
    "window": lambda _field, text: list(parse_window(text)),
    "c": view_text.channels,
    "slice_normal": _numbers("1,0,0"),
    "slice_point": _numbers("1,0,0"),
    "clip_box": view_text.corners,
    "clip_plane": _numbers("0,0,1,-20"),
    "light": view_text.light,
    "edges": _numbers("0.01,0.1"),
    "deblocking": view_text.switch_or_number,
}


def _refused(error: ValidationError) -> InvalidInputError:
    first = error.errors()[0]
    field = str(first["loc"][0]) if first["loc"] else "query"
    return InvalidInputError(
        f"{field}: {first['msg']}", field=field, where="query", rule=first["type"]
    )


def _listed(value: Any, *, pair: bool = False) -> list[Any]:
    """What may be one or several, as a list; a pair of numbers is one."""
    if value is None or value == []:
        return []
    several = isinstance(value, list) and not (pair and not isinstance(value[0], list | tuple))
    return list(value) if several else [value]


def _one_or_all(values: list[Any]) -> Any:
    """None of no values; of one, that for all channels."""
    return tuple(values) if len(values) > 1 else next(iter(values), None)
