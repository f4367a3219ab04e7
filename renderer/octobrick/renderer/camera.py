"""Where the picture is taken from: positions in world space, angles in degrees.

World axes are the volume's (x, y, z), right-handed, with +z up unless told otherwise. For data in
LPS order, azimuth 0 and elevation 0 look along +y: a patient's face, from the front.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import InvalidInputError
from octobrick.renderer.brick_source import BrickSource, Xyz

Bounds = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Lowest and highest corner (x, y, z) of a box in world space."""

FIT_MARGIN = 1.02
"""How much farther than "just fits" a fitted camera stands, so that no edge touches the frame."""


@dataclass(frozen=True, slots=True)
class Camera:
    """An eye, a point that it looks at, and a projection. Immutable; safe to share.

    Args:
        eye_world_xyz: where rays start (perspective) or the plane that they start on.
        target_world_xyz: the point in the middle of the picture.
        up_world_xyz: the direction that points up in the picture; need not be orthogonal.
        fov_degrees: angle of view across the shorter side of the picture; None = orthographic.
        height_world: world units across the shorter side; only for an orthographic camera.

    Raises:
        InvalidInputError: for values that are not finite, an eye on its target, an up vector along
            the view, an angle outside (0, 180), or a height that is not positive.
    """

    eye_world_xyz: Xyz
    target_world_xyz: Xyz
    up_world_xyz: Xyz = (0.0, 0.0, 1.0)
    fov_degrees: float | None = 30.0
    height_world: float | None = None

    def __post_init__(self) -> None:
        for name in ("eye_world_xyz", "target_world_xyz", "up_world_xyz"):
            object.__setattr__(self, name, _point(name, getattr(self, name)))
        self._require_projection()
        forward = _vector(self.target_world_xyz) - _vector(self.eye_world_xyz)
        if not forward.any():
            raise InvalidInputError(
                f"camera: eye and target are the same point {self.eye_world_xyz}; move one of them",
                eye_world_xyz=list(self.eye_world_xyz),
            )
        up = _vector(self.up_world_xyz)
        if not up.any() or np.linalg.norm(np.cross(_unit(forward), _unit(up))) < 1e-9:
            raise InvalidInputError(
                f"camera: up {self.up_world_xyz} points along the view or has no length; "
                "choose an up vector across it",
                up_world_xyz=list(self.up_world_xyz),
            )

    def _require_projection(self) -> None:
        fov, height = self.fov_degrees, self.height_world
        if (fov is None) == (height is None):
            raise InvalidInputError(
                f"camera: fov_degrees is {fov} and height_world is {height}; give fov_degrees for "
                "a perspective camera, or fov_degrees=None and height_world for an orthographic one"
            )
        if fov is not None and not 0 < fov < 180:
            raise InvalidInputError(
                f"camera: fov_degrees is {fov}; choose an angle between 0 and 180, such as 30",
                fov_degrees=_fact(fov),
            )
        if height is not None and not 0 < height < math.inf:
            raise InvalidInputError(
                f"camera: height_world is {height}; choose a positive, finite size",
                height_world=_fact(height),
            )

    @classmethod
    def look_at(
        cls,
        eye_world_xyz: Xyz,
        target_world_xyz: Xyz,
        up_world_xyz: Xyz = (0.0, 0.0, 1.0),
        *,
        fov_degrees: float = 30.0,
    ) -> Camera:
        """A perspective camera at a point, looking at another."""
        return cls(eye_world_xyz, target_world_xyz, up_world_xyz, fov_degrees)

    @classmethod
    def orbit(
        cls,
        volume: BrickSource,
        azimuth: float = 0.0,
        elevation: float = 0.0,
        distance: float | None = None,
        fov_degrees: float = 30.0,
        *,
        bounds: Bounds | None = None,
    ) -> Camera:
        """A camera on a sphere around the volume's centre, looking at the centre.

        Args:
            volume: whose centre and size to use.
            azimuth: degrees; 0 stands on the -y side, positive moves towards +x.
            elevation: degrees; positive moves up, 90 looks straight down.
            distance: world units from the centre; None stands where all of it fits.
            fov_degrees: angle of view across the shorter side of the picture.
            bounds: frame this box instead of the whole volume, such as what `visible_bounds` finds.
        """
        low_xyz, high_xyz = world_bounds(volume) if bounds is None else bounds
        centre = (low_xyz + high_xyz) / 2
        if distance is None:
            radius = float(np.linalg.norm(high_xyz - low_xyz)) / 2
            distance = FIT_MARGIN * radius / math.sin(math.radians(_angle(fov_degrees)) / 2)
        if not 0 < distance < math.inf:
            raise InvalidInputError(
                f"camera: distance is {distance}; choose a positive, finite number of world units",
                distance=_fact(distance),
            )
        a, e = math.radians(azimuth), math.radians(elevation)
        # The eye's direction, and its derivative by elevation: up stays across the view at 90°.
        outward = np.array((math.sin(a) * math.cos(e), -math.cos(a) * math.cos(e), math.sin(e)))
        up = np.array((-math.sin(a) * math.sin(e), math.cos(a) * math.sin(e), math.cos(e)))
        eye = centre + distance * outward
        return cls(_xyz(eye), _xyz(centre), _xyz(up), fov_degrees)

    def orthographic(self) -> Camera:
        """The same view in parallel projection: what lies at the target keeps its size."""
        if self.fov_degrees is None:
            return self
        distance = math.dist(self.eye_world_xyz, self.target_world_xyz)
        height = 2 * distance * math.tan(math.radians(self.fov_degrees) / 2)
        return replace(self, fov_degrees=None, height_world=height)

    def zoomed(self, factor: float) -> Camera:
        """The same view with what lies at the target `factor` times as large.

        A perspective camera moves towards the target; its angle of view stays.
        """
        if not 0 < factor < math.inf:
            raise InvalidInputError(
                f"camera: zoom factor is {factor}; choose a positive, finite number",
                factor=_fact(factor),
            )
        if self.height_world is not None:
            return replace(self, height_world=self.height_world / factor)
        target = _vector(self.target_world_xyz)
        offset = _vector(self.eye_world_xyz) - target
        return replace(self, eye_world_xyz=_xyz(target + offset / factor))

    def turned(self, direction: Sequence[Sequence[float]]) -> Camera:
        """This view, meant in the space of a source such as a patient's, in the volume's own axes.

        A volume's world axes are those of its array, however the source was oriented. Turned around
        the target, a camera that shows a patient's face does so however the scanner's slices lay.
        Of a mirrored direction, the picture is mirrored.

        Args:
            direction: 3x3, rows (x, y, z) of the source's space; column i is where the volume's
                axis i (x, y, z) points, as ingest keeps it in ``source.direction``.

        Raises:
            InvalidInputError: no such matrix, or axes that do not span space.
        """
        matrix = np.array(direction, dtype=np.float64)
        if (
            matrix.shape != (3, 3)
            or not np.isfinite(matrix).all()
            or abs(np.linalg.det(matrix)) < 1e-6
        ):
            raise InvalidInputError(
                f"camera: direction {direction!r} must be 3x3 finite numbers whose columns span "
                "space"
            )
        target = _vector(self.target_world_xyz)
        into_volume = np.linalg.inv(matrix).astype(np.float64)
        offset = into_volume @ (_vector(self.eye_world_xyz) - target)
        up = into_volume @ _vector(self.up_world_xyz)
        return replace(self, eye_world_xyz=_xyz(target + offset), up_world_xyz=_xyz(up))

    def basis_world(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Unit vectors (right, up, forward) of the picture in world space."""
        forward = _unit(_vector(self.target_world_xyz) - _vector(self.eye_world_xyz))
        right = _unit(cross(forward, _unit(_vector(self.up_world_xyz))))
        return right, cross(right, forward), forward

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready fields, of which `from_dict` makes an equal camera."""
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in asdict(self).items()
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Camera:
        """A camera from the fields that `to_dict` gives; unknown fields are refused."""
        known = [field.name for field in fields(cls)]
        unknown = sorted(set(data) - set(known))
        missing = sorted({"eye_world_xyz", "target_world_xyz"} - set(data))
        if unknown or missing:
            raise InvalidInputError(
                f"camera: unknown fields {unknown}, missing fields {missing}; known are {known}",
                unknown=unknown,
                missing=missing,
            )
        return cls(**data)


def world_bounds(volume: BrickSource) -> Bounds:
    """Lowest and highest corner (x, y, z) of level 0's voxels, out to their faces."""
    level = volume.levels[0]
    shape_xyz = np.array(level.shape_zyx[::-1], dtype=np.float64)
    spacing, origin = _vector(level.spacing_xyz), _vector(level.origin_xyz)
    return origin - spacing / 2, origin + spacing * (shape_xyz - 0.5)


def _point(name: str, value: Any) -> Xyz:
    try:
        x, y, z = (float(component) for component in value)
    except (TypeError, ValueError):
        x = y = z = math.nan
    if not all(map(math.isfinite, (x, y, z))):
        raise InvalidInputError(f"camera: {name} is {value!r}; give three finite numbers (x, y, z)")
    return (x, y, z)


def _angle(fov_degrees: float) -> float:
    if not 0 < fov_degrees < 180:
        raise InvalidInputError(
            f"camera: fov_degrees is {fov_degrees}; choose an angle between 0 and 180, such as 30",
            fov_degrees=_fact(fov_degrees),
        )
    return fov_degrees


def _fact(value: float) -> float | str:
    """Errors travel as JSON, which has no NaN or infinity."""
    return value if math.isfinite(value) else str(value)


def _vector(xyz: Xyz) -> NDArray[np.float64]:
    return np.array(xyz, dtype=np.float64)


def _unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    # Scaled first, so that neither huge nor tiny components leave float64's range when squared.
    scaled = vector / np.abs(vector).max()
    return np.asarray(scaled / math.sqrt(scaled @ scaled))


def cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """np.cross takes ten times as long for two vectors."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def _xyz(vector: NDArray[np.float64]) -> Xyz:
    x, y, z = (float(component) for component in vector)
    return (x, y, z)
