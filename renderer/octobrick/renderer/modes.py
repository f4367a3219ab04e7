"""What a ray makes of its samples: light through a cloud, the greatest value, a surface, a cut."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import InvalidInputError
from octobrick.renderer.brick_source import Xyz

Statistic = Literal["max", "min", "mean"]


@dataclass(frozen=True, slots=True)
class Compositing:
    """Direct volume rendering: each sample emits and absorbs, front to back."""

    name = "dvr"


@dataclass(frozen=True, slots=True)
class Projection:
    """A statistic of each ray's samples, then coloured by the transfer function.

    Its opacity is that of the transfer function's reference length, as if it were one long.

    Args:
        statistic: "max" (MIP), "min" (minIP) or "mean" of the values along the ray.
    """

    statistic: Statistic = "max"

    def __post_init__(self) -> None:
        if self.statistic not in ("max", "min", "mean"):
            raise InvalidInputError(
                f"projection: statistic is {self.statistic!r}; choose 'max', 'min' or 'mean'"
            )

    @property
    def name(self) -> str:
        """As the command line has it."""
        return {"max": "mip", "min": "minip", "mean": "average"}[self.statistic]


@dataclass(frozen=True, slots=True)
class Isosurface:
    """The surface on which the interpolated voxels have one value, coloured as that value.

    Crossings lie between two samples, so no step may be longer than a voxel.

    Args:
        value: of the surface.
        opacity: 1 shows the first crossing only; less lets further ones shine through.
    """

    value: float
    opacity: float = 1.0
    name = "isosurface"

    def __post_init__(self) -> None:
        if not math.isfinite(self.value) or not 0 < self.opacity <= 1:
            raise InvalidInputError(
                f"isosurface: value {self.value}, opacity {self.opacity}; give a finite value and "
                "an opacity above 0 and at most 1"
            )


@dataclass(frozen=True, slots=True)
class Slice:
    """A plane through the volume, in any direction: opaque, coloured by the transfer function.

    Args:
        point_world_xyz: a point on the plane.
        normal_world_xyz: across the plane; of any length.
    """

    point_world_xyz: Xyz
    normal_world_xyz: Xyz
    name = "slice"

    def __post_init__(self) -> None:
        for name in ("point_world_xyz", "normal_world_xyz"):
            try:
                x, y, z = (float(n) for n in getattr(self, name))
            except (TypeError, ValueError):
                x = y = z = math.nan
            if not all(map(math.isfinite, (x, y, z))):
                raise InvalidInputError(
                    f"slice: {name} is {getattr(self, name)!r}; give three finite numbers (x, y, z)"
                )
            object.__setattr__(self, name, (x, y, z))
        if not any(self.normal_world_xyz):
            raise InvalidInputError("slice: normal_world_xyz has no length; give a direction")

    def plane_world(self) -> NDArray[np.float64]:
        """(nx, ny, nz, offset), n of unit length: n·p + offset is 0 on the plane."""
        normal = np.array(self.normal_world_xyz)
        normal = normal / np.abs(normal).max()
        normal /= np.linalg.norm(normal)
        return np.array([*normal, -float(normal @ np.array(self.point_world_xyz))])


Mode = Compositing | Projection | Isosurface | Slice

COMPOSITING: Final = Compositing()

MODES: Final[dict[str, Compositing | Projection]] = {
    "dvr": COMPOSITING,
    "mip": Projection("max"),
    "minip": Projection("min"),
    "average": Projection("mean"),
}
"""Modes that need nothing but their name."""


def checked_mode(mode: Mode | str) -> Mode:
    """A mode, or that of a name.

    Raises:
        InvalidInputError: no mode has this name.
    """
    if isinstance(mode, str):
        if mode not in MODES:
            raise InvalidInputError(
                f"mode {mode!r}: choose one of {list(MODES)}, or give an Isosurface or a Slice",
                option="mode",
            )
        return MODES[mode]
    if not isinstance(mode, Mode):
        raise InvalidInputError(
            f"mode {mode!r} is no rendering mode; choose one of {list(MODES)}, or give a "
            "Compositing, a Projection, an Isosurface or a Slice"
        )
    return mode
