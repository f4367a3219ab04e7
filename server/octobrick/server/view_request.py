"""A view, from a query or from JSON: checked fields, and the `View` that they mean.

Requests for pictures and for bricks say what they look at in the same words.
"""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from octobrick.server import view
from octobrick.server.errors import LimitError
from octobrick.server.settings import Settings
from octobrick.server.view import (
    Fit,
    GradientSource,
    Projection,
    Rgb,
    View,
    Xyz,
    parse_background,
    parse_window,
    preset_function,
)

if TYPE_CHECKING:
    from octobrick.renderer import Camera, TransferFunction


PlainMode = Literal["dvr", "mip", "minip", "average"]
"""Modes that need nothing but their name."""

_BACKGROUND = "rrggbb, or r,g,b from 0 to 1, or transparent."


def _checked_background(text: str) -> str:
    parse_background(text)
    return text


def _checked_window(text: str) -> str:
    parse_window(text)
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
    preset: str | None = Field(
        None,
        max_length=64,
        description="Transfer function: ct-bone, ct-soft-tissue, mr or microscopy. Without, "
        "ct-bone; greys for projections.",
        examples=["ct-bone"],
    )
    width: int = Field(view.SIZE[0], ge=1, description="Pixels.", examples=[96])
    height: int = Field(view.SIZE[1], ge=1, description="Pixels.", examples=[64])
    mode: PlainMode = Field("dvr", description="What rays make of their samples.")
    shading: bool = Field(True, description="Light surfaces by the gradient.")
    gradients: GradientSource = Field(
        "auto", description="What surfaces are lit by: the volume's gradients, or differences."
    )
    deblocking: bool = Field(False, description="Smooth what the codec's blocks left.")
    step_voxels: float = Field(
        view.STEP_VOXELS, ge=0.1, le=16, description="Distance of samples along a ray, in voxels."
    )
    level: int | None = Field(
        None, ge=0, description="Resolution to render; the renderer chooses without."
    )
    t: int = Field(0, ge=0, description="Time step.")
    c: int = Field(0, ge=0, description="Channel.")
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

    def _view(
        self,
        window: tuple[float, float] | None,
        background: Rgb | None,
        own_function: TransferFunction | None = None,
    ) -> View:
        preset = None if self.preset is None else preset_function(self.preset)
        return View(
            transfer_function=own_function or preset,
            azimuth=self.azimuth,
            elevation=self.elevation,
            fit=self.fit,
            distance=self.distance,
            fov=self.fov,
            projection=self.projection,
            size=(self.width, self.height),
            mode=self.mode,
            window=window,
            shading=self.shading,
            gradients=self.gradients,
            deblocking=self.deblocking,
            background=background,
            step_voxels=self.step_voxels,
            level=self.level,
            t=self.t,
            c=self.c,
        )


class ViewQuery(_ViewFields):
    """A view, all in the query of an address."""

    window: Annotated[str | None, AfterValidator(lambda w: w and _checked_window(w))] = Field(
        None,
        max_length=80,
        description="LO,HI: values at the ends of the transfer function; the volume's without.",
        examples=["0,1500"],
    )
    background: Annotated[str, AfterValidator(_checked_background)] = Field(
        "000000",
        max_length=80,
        description=_BACKGROUND,
        examples=["202020"],
    )

    def to_view(self) -> View:
        """The view that the fields mean."""
        window = None if self.window is None else parse_window(self.window)
        return self._view(window, parse_background(self.background))


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


class ViewBody(_ViewFields):
    """A view, as JSON, with a transfer function and a camera of one's own if wanted."""

    model_config = ConfigDict(
        json_schema_extra={"examples": [{"azimuth": 45, "preset": "mr", "width": 96, "height": 64}]}
    )

    window: tuple[float, float] | None = Field(
        None, description="Values at the ends of the transfer function; the volume's without."
    )
    background: Annotated[str, AfterValidator(_checked_background)] = Field(
        "000000", max_length=80, description=_BACKGROUND
    )
    transfer_function: dict[str, Any] | None = Field(
        None, description="Instead of a preset: as TransferFunction.to_json writes it."
    )
    camera: CameraBody | None = Field(
        None, description="Instead of azimuth, elevation, fit, distance, fov and projection."
    )

    def to_view(self) -> View:
        """The view that the fields mean."""
        from octobrick.renderer import TransferFunction

        window = self.window and parse_window(",".join(map(repr, self.window)))
        given = self.transfer_function
        own = None if given is None else TransferFunction.from_json(json.dumps(given))
        view = self._view(window, parse_background(self.background), own)
        return view if self.camera is None else replace(view, own_camera=self.camera.to_camera())
