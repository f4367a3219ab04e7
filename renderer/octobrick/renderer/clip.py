"""What of a volume is cut away: a box and planes, in world space."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import InvalidInputError
from octobrick.renderer.brick_source import SourceLevel, Xyz

HalfSpace = tuple[float, float, float, float]
"""(nx, ny, nz, offset): a point p (x, y, z) is kept if n·p + offset >= 0."""

PLANES_MAX: Final = 12
"""Half-spaces that a picture can have: a box takes six."""


@dataclass(frozen=True, slots=True)
class Clip:
    """The part of space in which a volume is shown. Immutable.

    Args:
        low_world_xyz: lowest corner of a box that is kept; None does not limit it. Single
            components may be -inf.
        high_world_xyz: highest corner; components may be inf.
        half_spaces: (nx, ny, nz, offset) each; kept is where n·p + offset >= 0.

    Raises:
        InvalidInputError: NaN, a box that holds no point, a normal without length, or more than
            `PLANES_MAX` planes, of which a box takes one for each finite side.
    """

    low_world_xyz: Xyz | None = None
    high_world_xyz: Xyz | None = None
    half_spaces: tuple[HalfSpace, ...] = ()

    def __post_init__(self) -> None:
        for name, end in (("low_world_xyz", -math.inf), ("high_world_xyz", math.inf)):
            corner = _numbers(name, getattr(self, name) or (end,) * 3, 3)
            object.__setattr__(self, name, corner)
        planes = tuple(_numbers("half_spaces", plane, 4) for plane in self.half_spaces)
        object.__setattr__(self, "half_spaces", planes)
        if any(a > b for a, b in zip(self._low, self._high, strict=True)):
            raise InvalidInputError(
                f"clip: the box from {self.low_world_xyz} to {self.high_world_xyz} holds no point; "
                "give the lower corner first"
            )
        if any(not any(plane[:3]) or not all(map(math.isfinite, plane)) for plane in planes):
            raise InvalidInputError(
                f"clip: half_spaces {planes} must be finite, each with a normal that has a length"
            )
        if len(self.planes_world()) > PLANES_MAX:
            raise InvalidInputError(
                f"clip: {len(self.planes_world())} planes, of which the box has up to six; at most "
                f"{PLANES_MAX} can be used"
            )

    @property
    def _low(self) -> Xyz:
        assert self.low_world_xyz is not None
        return self.low_world_xyz

    @property
    def _high(self) -> Xyz:
        assert self.high_world_xyz is not None
        return self.high_world_xyz

    def planes_world(self) -> NDArray[np.float64]:
        """All half-spaces (n, 4), with normals of unit length: p is kept if n·p + offset >= 0."""
        rows: list[Sequence[float]] = []
        for axis in range(3):
            unit = [float(axis == i) for i in range(3)]
            if math.isfinite(self._low[axis]):
                rows.append([*unit, -self._low[axis]])
            if math.isfinite(self._high[axis]):
                rows.append([*(-n for n in unit), self._high[axis]])
        rows += self.half_spaces
        planes = np.array(rows, np.float64).reshape(-1, 4)
        lengths = np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
        return np.asarray(planes / lengths)


def planes_in_voxels(planes_world: NDArray[np.float64], level: SourceLevel) -> NDArray[np.float64]:
    """Half-spaces (n, 4) of world space as those of a level's voxel space, the same points kept."""
    spacing, origin = np.array(level.spacing_xyz), np.array(level.origin_xyz)
    normals = planes_world[:, :3] * spacing
    corner = origin - spacing / 2  # voxel position 0
    offsets = planes_world[:, :3] @ corner + planes_world[:, 3]
    return np.concatenate([normals, offsets[:, np.newaxis]], axis=1)


def _numbers(name: str, values: Iterable[Any], count: int) -> Any:
    try:
        numbers = tuple(float(value) for value in values)
    except (TypeError, ValueError):
        numbers = ()
    if len(numbers) != count or any(map(math.isnan, numbers)):
        raise InvalidInputError(f"clip: {name} holds {values!r}; give {count} numbers")
    return numbers
