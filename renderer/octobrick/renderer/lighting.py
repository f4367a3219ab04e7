"""How surfaces reflect light, and where it comes from."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from octobrick.codec.errors import InvalidInputError
from octobrick.renderer.brick_source import Xyz

LIGHTS_MAX: Final = 4


@dataclass(frozen=True, slots=True)
class Light:
    """White or coloured light from the eye, or from a direction in the world.

    Args:
        toward_world_xyz: the direction towards the light, of any length; None stands at the eye.
        color: (red, green, blue), from 0 up; sums over lights beyond 1 are clipped.
    """

    toward_world_xyz: Xyz | None = None
    color: tuple[float, float, float] = (1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        for name, values in (("toward_world_xyz", self.toward_world_xyz), ("color", self.color)):
            if values is None:
                continue
            if len(values) != 3 or not all(math.isfinite(n) for n in values):
                raise InvalidInputError(f"light: {name} is {values!r}; give three finite numbers")
        if min(self.color) < 0:
            raise InvalidInputError(f"light: color is {self.color}; use numbers from 0 up")
        if self.toward_world_xyz is not None and not any(self.toward_world_xyz):
            raise InvalidInputError("light: toward_world_xyz has no length; give a direction")

    def unit_world(self) -> Xyz:
        """The direction with unit length; (0, 0, 0) for a light at the eye."""
        if self.toward_world_xyz is None:
            return (0.0, 0.0, 0.0)
        vector = np.array(self.toward_world_xyz, np.float64)
        vector = vector / np.abs(vector).max()  # so that no square leaves float64's range
        x, y, z = (float(n) for n in vector / np.linalg.norm(vector))
        return (x, y, z)


AT_EYE: Final = (Light(),)


@dataclass(frozen=True, slots=True)
class Lighting:
    """Blinn-Phong terms. A surface that faces a light gets ambient + diffuse, plus the highlight.

    Surfaces are lit from both sides.

    Args:
        ambient: light on every sample, also where there is no gradient.
        diffuse: light that falls with the angle to the surface.
        specular: height of the highlight, which has the light's colour.
        shininess: exponent of the highlight; larger is smaller.
        lights: one to four; by default one at the eye.
    """

    ambient: float = 0.25
    diffuse: float = 0.75
    specular: float = 0.2
    shininess: float = 40.0
    lights: tuple[Light, ...] = AT_EYE

    def __post_init__(self) -> None:
        for name in ("ambient", "diffuse", "specular", "shininess"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise InvalidInputError(f"lighting: {name} is {value}; use a number from 0 up")
        if not 1 <= len(self.lights) <= LIGHTS_MAX:
            raise InvalidInputError(
                f"lighting: {len(self.lights)} lights; give 1 to {LIGHTS_MAX}, or shading=False"
            )
