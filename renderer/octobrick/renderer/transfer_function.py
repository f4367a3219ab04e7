"""Transfer functions: which colour and opacity a value has, as piecewise-linear curves.

Opacity is that of a reference length d0: light that crosses d0 of the material loses that share.
A ray step of length d then has 1 - (1 - opacity)^(d/d0), so a picture does not depend on the step.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any, Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import InvalidInputError, NotFoundError

Domain = Literal["relative", "value"]
OpacityUnit = Literal["voxel", "extent"]
Rgb = tuple[float, float, float]
ColorPoint = tuple[float, Rgb]
OpacityPoint = tuple[float, float]

FORMAT_VERSION: Final = 1
LARGEST: Final = float(np.finfo(np.float32).max)
"""No voxel is larger."""
POINTS_MAX: Final = 4096
"""More points than the renderer's table has entries cannot be shown."""
EXTENT_PARTS: Final = 256
"""With the opacity unit "extent", d0 is the longest edge of the volume over this many parts."""
_VERSION_FIELD: Final = "octobrick_transfer_function"
_DEFAULTS: Final[dict[str, Any]] = {
    _VERSION_FIELD: FORMAT_VERSION,
    "domain": "relative",
    "opacity_unit": "voxel",
}
_REQUIRED: Final = frozenset({"colors", "opacities"})


@dataclass(frozen=True, slots=True)
class TransferFunction:
    """Colour and opacity by value, each linear between its points and constant beyond them.

    Two points at one position make a step: below it the first counts, from it on the last. A peak
    narrower than the table's resolution is kept, at the nearest entry.

    Args:
        colors: (position, (red, green, blue)), components 0..1, positions ascending.
        opacities: (position, opacity), 0..1, positions ascending.
        domain: "relative": positions are 0..1 over the window; "value": voxel values.
        opacity_unit: d0 is one voxel of level 0 ("voxel", the smallest spacing), or 1/256 of the
            volume's longest edge ("extent"), which looks alike at any resolution.

    Raises:
        InvalidInputError: for no points, too many, unsorted ones, or numbers out of range.
    """

    colors: tuple[ColorPoint, ...]
    opacities: tuple[OpacityPoint, ...]
    domain: Domain = "relative"
    opacity_unit: OpacityUnit = "voxel"

    def __post_init__(self) -> None:
        _require_choice("domain", self.domain, get_args(Domain))
        _require_choice("opacity_unit", self.opacity_unit, get_args(OpacityUnit))
        colors = _numbers("colors", [(at, *rgb) for at, rgb in self.colors], 4)
        opacities = _numbers("opacities", list(self.opacities), 2)
        object.__setattr__(self, "colors", tuple((at, (r, g, b)) for at, r, g, b in colors))
        object.__setattr__(self, "opacities", tuple((at, a) for at, a in opacities))
        if self.domain == "relative":
            _require_unit("position", [row[0] for row in (*colors, *opacities)])

    @classmethod
    def from_points(
        cls,
        points: Sequence[tuple[float, Rgb, float]],
        *,
        domain: Domain = "relative",
        opacity_unit: OpacityUnit = "voxel",
    ) -> TransferFunction:
        """A function whose colour and opacity have the same points: (position, rgb, opacity)."""
        return cls(
            tuple((at, rgb) for at, rgb, _ in points),
            tuple((at, opacity) for at, _, opacity in points),
            domain,
            opacity_unit,
        )

    @classmethod
    def preset(cls, name: str) -> TransferFunction:
        """One of the functions that come with octobrick; see `preset_names`."""
        if name not in cls.preset_names():
            raise NotFoundError(
                f"no transfer function is called {name!r}; there are {cls.preset_names()}",
                name=name,
                known=cls.preset_names(),
            )
        return cls.from_json(_presets().joinpath(f"{name}.json").read_text("utf-8"))

    @staticmethod
    def preset_names() -> list[str]:
        """Names that `preset` knows, sorted."""
        names = (entry.name for entry in _presets().iterdir())
        return sorted(name.removesuffix(".json") for name in names if name.endswith(".json"))

    @classmethod
    def from_json(cls, text: str | bytes) -> TransferFunction:
        """The function that `to_json` wrote.

        Strict: unknown fields are refused, and so is a text without colors or opacities; the
        other fields may be left out.
        """
        try:
            data = json.loads(text, parse_constant=_refuse_constant)
        except (ValueError, RecursionError) as error:
            raise InvalidInputError(f"transfer function: not JSON: {error}") from error
        known = _REQUIRED | set(_DEFAULTS)
        if not isinstance(data, dict) or not _REQUIRED <= set(data) <= known:
            found = sorted(data) if isinstance(data, dict) else type(data).__name__
            raise InvalidInputError(
                f"transfer function: fields are {found}; there must be {sorted(_REQUIRED)}, and "
                f"there may be {sorted(_DEFAULTS)}"
            )
        data = _DEFAULTS | data
        if data[_VERSION_FIELD] != FORMAT_VERSION:
            raise InvalidInputError(
                f"transfer function: version {data[_VERSION_FIELD]!r}, this program reads version "
                f"{FORMAT_VERSION}",
            )
        colors = _numbers("colors", data["colors"], 4)
        opacities = _numbers("opacities", data["opacities"], 2)
        return cls(
            tuple((at, (r, g, b)) for at, r, g, b in colors),
            tuple((at, a) for at, a in opacities),
            data["domain"],
            data["opacity_unit"],
        )

    def to_json(self) -> str:
        """The function as JSON: one [position, red, green, blue] or [position, opacity] a point."""
        data = {
            _VERSION_FIELD: FORMAT_VERSION,
            "domain": self.domain,
            "opacity_unit": self.opacity_unit,
            "colors": [[at, *rgb] for at, rgb in self.colors],
            "opacities": [[at, opacity] for at, opacity in self.opacities],
        }
        return json.dumps(data)

    def value_domain(self, window: tuple[float, float]) -> tuple[float, float]:
        """The values that the first and the last entry of the table stand for.

        Args:
            window: the values at relative positions 0 and 1; not used where domain is "value".
        """
        if self.domain == "relative":
            return window
        positions = [row[0] for row in (*self.colors, *self.opacities)]
        low, high = min(positions), max(positions)
        # All points at one value: any interval around it shows the step.
        return (low, high) if low < high else (low - 0.5, high + 0.5)

    def reference_length_world(
        self, spacing_xyz: Sequence[float], shape_zyx: Sequence[int]
    ) -> float:
        """d0 in world units, for a volume whose level 0 has this spacing and shape."""
        if self.opacity_unit == "voxel":
            return min(spacing_xyz)
        edges = (s * n for s, n in zip(spacing_xyz, reversed(shape_zyx), strict=True))
        return max(edges) / EXTENT_PARTS

    def table(
        self, n: int, step_ratio: float = 1.0, *, opacity: float | None = None
    ) -> NDArray[np.float32]:
        """Premultiplied RGBA of one ray step at n positions, evenly spaced over the domain.

        Args:
            n: entries, at least 2; the first and the last are the ends of the domain.
            step_ratio: d/d0, the length of a step in reference lengths, positive.
            opacity: of all entries instead of the function's own.

        Returns:
            (n, 4) float32; opacity is 1 - (1 - a)^(d/d0), exact for small a.
        """
        low, high = self.value_domain((0.0, 1.0))
        at = np.linspace(low, high, n)
        color = _interpolate(at, [p for p, _ in self.colors], [rgb for _, rgb in self.colors])
        alpha = np.full((n, 1), opacity, np.float64)
        if opacity is None:
            values = [[a] for _, a in self.opacities]
            alpha = _interpolate(at, [p for p, _ in self.opacities], values)
            _keep_peaks(alpha[:, 0], self.opacities, low, high)
            with np.errstate(divide="ignore"):  # log1p(-1) = -inf is right: opaque stays opaque
                alpha = -np.expm1(step_ratio * np.log1p(-alpha))
        return np.concatenate([color * alpha, alpha], axis=1).astype(np.float32)


def _interpolate(
    at: NDArray[np.float64], positions: list[float], values: Sequence[Sequence[float]]
) -> NDArray[np.float64]:
    """Linear between points, constant beyond; at a step the last of the points counts."""
    x, y = np.array(positions), np.array(values, dtype=np.float64)
    right = np.searchsorted(x, at, side="right")
    left, right = np.maximum(right - 1, 0), np.minimum(right, len(x) - 1)
    gap = x[right] - x[left]
    weight = np.where(gap > 0, (at - x[left]) / np.where(gap > 0, gap, 1), 0.0)[:, None]
    return np.asarray(y[left] * (1 - weight) + y[right] * weight)


def _keep_peaks(
    opacity: NDArray[np.float64], points: Sequence[OpacityPoint], low: float, high: float
) -> None:
    """Raise the entry nearest to each point to at least the point's opacity.

    Else a peak between two entries would vanish, and what is visible at one value only with it.
    """
    position = np.array([at for at, _ in points])
    nearest = np.rint((position - low) / (high - low) * (len(opacity) - 1)).astype(np.intp)
    np.maximum.at(opacity, nearest, np.array([value for _, value in points]))


def _presets() -> Any:
    return resources.files("octobrick.renderer").joinpath("presets")


def _numbers(name: str, rows: Any, width: int) -> list[tuple[float, ...]]:
    """Rows of finite numbers with ascending first and 0..1 other columns, or an error."""
    shaped = isinstance(rows, (list, tuple)) and all(
        isinstance(row, (list, tuple))
        and len(row) == width
        and all(isinstance(v, (int, float, np.number)) and not isinstance(v, bool) for v in row)
        for row in rows
    )
    if not shaped or not 1 <= len(rows) <= POINTS_MAX:
        raise InvalidInputError(
            f"transfer function: {name} must be 1 to {POINTS_MAX} points of {width} numbers each"
        )
    numbers = [tuple(float(value) for value in row) for row in rows]
    if not all(abs(value) <= LARGEST for row in numbers for value in row):  # NaN is not
        raise InvalidInputError(
            f"transfer function: {name} hold NaN, infinity or more than {LARGEST:g}; use numbers "
            "that float32 has"
        )
    positions = [row[0] for row in numbers]
    if positions != sorted(positions):
        raise InvalidInputError(
            f"transfer function: {name} have positions {positions}; sort them ascending"
        )
    _require_unit(name, [value for row in numbers for value in row[1:]])
    return numbers


def _require_unit(name: str, values: Sequence[float]) -> None:
    outside = [value for value in values if not 0 <= value <= 1]
    if outside:
        raise InvalidInputError(
            f"transfer function: {name} {outside[0]} is outside 0..1", value=outside[0]
        )


def _require_choice(name: str, value: object, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise InvalidInputError(
            f"transfer function: {name} is {value!r}; choose one of {list(choices)}"
        )


def _refuse_constant(text: str) -> None:
    raise ValueError(f"{text} is no number in JSON")
