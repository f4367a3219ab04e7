"""Where the cameras of a light field stand, and which slice of a volume holds which view.

Bajaj, Ihm, Park, *3D RGB Image Compression for Interactive Applications*, 2001, section 4.2: groups
of 2×2 neighbouring views lie one behind the other, so that cells of 4³ voxels hold the same 4×4
pixels of four views.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from octobrick.codec.errors import InvalidInputError

VERSION = 1
ORDER = "groups-2x2"
VIEWS_MAX = 4096  # along one axis; a hundred thousand times more than anybody has taken
_GROUP = 4  # slices
_UNIT_CHARACTERS_MAX = 64
_FIELDS = {"version", "nu", "nv", "order", "camera_step", "unit"}


@dataclass(frozen=True, slots=True)
class CameraStep:
    """What the user knows of the cameras and the pictures do not say.

    Attributes:
        uv: from one camera to the next along u (columns) and v (rows), in `unit`.
        unit: UDUNITS name of the unit, or None.

    Raises:
        InvalidInputError: a step that is not finite and positive, or no name of a unit.
    """

    uv: tuple[float, float] = (1.0, 1.0)
    unit: str | None = None

    def __post_init__(self) -> None:
        uv = tuple(_finite(step) for step in self.uv)
        object.__setattr__(self, "uv", uv)  # one text in JSON, whole number or not
        if len(uv) != 2 or not all(math.isfinite(step) and step > 0 for step in uv):
            raise InvalidInputError(
                f"camera step {self.uv}: give two positive numbers, along u and v"
            )
        if self.unit is not None and not 0 < len(self.unit) <= _UNIT_CHARACTERS_MAX:
            raise InvalidInputError(
                f"unit of the camera step {self.unit!r:.80}: give 1 to {_UNIT_CHARACTERS_MAX} "
                "characters, such as millimeter"
            )


@dataclass(frozen=True, slots=True)
class CameraGrid:
    """A grid of cameras in the uv plane, whose views are the slices of a volume.

    View (u, v) is the picture of column u and row v, both counted from 0. Group
    ``(v // 2) · ceil(nu / 2) + u // 2`` has the four slices of views (2i, 2j), (2i + 1, 2j),
    (2i, 2j + 1), (2i + 1, 2j + 1). Where nu or nv is odd, the last view stands in for the one
    that is missing.

    Attributes:
        nu: cameras along u.
        nv: cameras along v.
        step: distance of cameras.

    Raises:
        InvalidInputError: fewer than two views, or more than can be.
    """

    nu: int
    nv: int
    step: CameraStep = field(default_factory=CameraStep)

    def __post_init__(self) -> None:
        if not (1 <= self.nu <= VIEWS_MAX and 1 <= self.nv <= VIEWS_MAX and self.nviews > 1):
            raise InvalidInputError(
                f"a light field of {self.nu} × {self.nv} views (u × v): needs two or more, at most "
                f"{VIEWS_MAX} along an axis",
                nu=self.nu,
                nv=self.nv,
            )

    @property
    def nviews(self) -> int:
        """Views, without those that stand in for missing ones."""
        return self.nu * self.nv

    @property
    def nslices(self) -> int:
        """Slices of the volume."""
        return _GROUP * self._groups_per_row * -(-self.nv // 2)

    def slice_of(self, u: int, v: int) -> int:
        """The slice that holds a view.

        Raises:
            InvalidInputError: there is no such view.
        """
        if not (0 <= u < self.nu and 0 <= v < self.nv):
            raise InvalidInputError(
                f"no view (u, v) = ({u}, {v}); there are {self.nu} × {self.nv}, counted from 0",
                u=u,
                v=v,
            )
        return _GROUP * ((v // 2) * self._groups_per_row + u // 2) + 2 * (v % 2) + u % 2

    def view_of(self, z: int) -> tuple[int, int]:
        """The view (u, v) in slice `z`; of one that stands in, the view that it repeats."""
        group, place = divmod(z, _GROUP)
        j, i = divmod(group, self._groups_per_row)
        return min(2 * i + place % 2, self.nu - 1), min(2 * j + place // 2, self.nv - 1)

    def to_json(self) -> dict[str, Any]:
        """The attribute ``light_field`` of a volume."""
        return {
            "version": VERSION,
            "nu": self.nu,
            "nv": self.nv,
            "order": ORDER,
            "camera_step": list(self.step.uv),
            "unit": self.step.unit,
        }

    @classmethod
    def from_json(cls, value: object) -> CameraGrid:
        """What `to_json` gave, if it is that.

        Raises:
            InvalidInputError: a field that is missing, unknown or makes no sense.
        """
        if not isinstance(value, dict) or set(value) != _FIELDS:
            raise InvalidInputError(f"{value!r:.120} needs {sorted(_FIELDS)}")
        if value["version"] != VERSION or value["order"] != ORDER:
            raise InvalidInputError(
                f"version {value['version']!r:.20} with order {value['order']!r:.40} "
                f"is not version {VERSION} with {ORDER!r}, which this octobrick reads"
            )
        match value:
            case {"nu": int(nu), "nv": int(nv), "camera_step": [u, v], "unit": unit} if (
                type(nu) is int
                and type(nv) is int
                and type(u) in (int, float)
                and type(v) in (int, float)
                and (unit is None or type(unit) is str)
            ):
                return cls(nu, nv, CameraStep((u, v), unit))
        raise InvalidInputError(
            f"{value!r:.200}: nu and nv are whole numbers, camera_step two numbers, "
            "unit a name or null"
        )

    @property
    def _groups_per_row(self) -> int:
        return -(-self.nu // 2)


def _finite(number: float) -> float:
    """The number as a float; what is beyond all floats is infinite, which is refused later."""
    try:
        return float(number)
    except OverflowError:
        return math.inf
