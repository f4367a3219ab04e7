"""How surfaces reflect the light that stands at the eye."""

from __future__ import annotations

import math
from dataclasses import dataclass

from octobrick.codec.errors import InvalidInputError


@dataclass(frozen=True, slots=True)
class Lighting:
    """Blinn-Phong terms. A surface that faces the eye gets ambient + diffuse, plus the highlight.

    Args:
        ambient: light on every sample, also where there is no gradient.
        diffuse: light that falls with the angle to the surface.
        specular: height of the white highlight.
        shininess: exponent of the highlight; larger is smaller.
    """

    ambient: float = 0.25
    diffuse: float = 0.75
    specular: float = 0.2
    shininess: float = 40.0

    def __post_init__(self) -> None:
        for name in ("ambient", "diffuse", "specular", "shininess"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise InvalidInputError(f"lighting: {name} is {value}; use a number from 0 up")
