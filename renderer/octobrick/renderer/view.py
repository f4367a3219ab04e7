"""A camera over a picture and one level of a volume: the rays, and what they can meet.

Two spaces. *World*: the volume's units. *Voxel*: the level's texture space, in which voxel i
spans [i, i + 1], its centre at i + 0.5; (x, y, z) order, as in shaders.

A ray starts on the start plane: across the view, just in front of the volume, or at the eye if
that is nearer. Measuring from there instead of from the eye keeps float32 exact to a small part of
a voxel however far away the camera stands.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import InvalidInputError
from octobrick.renderer.brick_source import SourceLevel
from octobrick.renderer.camera import Camera, cross
from octobrick.store.box import Box

FARTHEST: Final = 1e9
"""Volume diagonals: at that distance float64 still tells a millionth of a diagonal apart."""

PLANE_SLACK: Final = 1e-3
"""Of half a box's diagonal, kept beyond each plane: more than float32 rays can stray."""

Vector = NDArray[np.float64]
Size = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Affine:
    """A vector that depends linearly on the pixel: `at00 + column * by_column + row * by_row`.

    Column 0, row 0 is the outer corner of the top left pixel; a pixel's centre is at +0.5.
    """

    at00: Vector
    by_column: Vector
    by_row: Vector

    def at(self, column: float, row: float) -> Vector:
        """The vector at a place in the picture."""
        return np.asarray(self.at00 + column * self.by_column + row * self.by_row)


@dataclass(frozen=True, slots=True)
class View:
    """The rays of a picture through one level.

    Attributes:
        size: columns and rows of the picture.
        eye_world: where perspective rays come from; on the start plane of orthographic ones.
        forward_world: unit vector into the middle of the picture.
        start_voxel: where a pixel's ray starts.
        toward_world: the ray's direction, not of unit length.
        planes_world: (n, 4) rows (normal, offset); a point p is in view if normal·p + offset >= 0
            for all.
        pixel_size: size of a pixel in world units, as `base + slope * depth`.
        right_world: unit vector to the right in the picture.
        up_world: unit vector upwards in the picture.
        start_depth_world: distance of the start plane in front of the eye.
    """

    size: Size
    eye_world: Vector
    forward_world: Vector
    start_voxel: Affine
    toward_world: Affine
    planes_world: NDArray[np.float64]
    pixel_size: tuple[float, float]
    right_world: Vector
    up_world: Vector
    start_depth_world: float

    @property
    def main_axis(self) -> int:
        """The world axis (0 = x) most along the view; on a tie the lowest."""
        return int(np.argmax(np.abs(self.forward_world) - np.array([0.0, 1e-9, 2e-9])))

    def depth_world(self, points_world: Vector) -> Vector:
        """Distance of points (n, 3) from the eye's plane, negative behind it."""
        return np.asarray((points_world - self.eye_world) @ self.forward_world)

    def pixels_of(self, points_world: Vector) -> tuple[Vector, NDArray[np.bool_]]:
        """Where points (..., 3) lie in the picture: (..., 2) column and row; in front of the eye?

        Those that are not have no place in a perspective picture; theirs has no meaning.
        """
        offset = points_world - self.eye_world
        depth = offset @ self.forward_world
        base, slope = self.pixel_size
        size = base + slope * depth
        in_front = size > 0
        size = np.where(in_front, size, 1.0)
        middle = np.array(self.size) / 2
        across = np.stack([offset @ self.right_world, -(offset @ self.up_world)], axis=-1)
        return middle + across / size[..., np.newaxis], in_front

    @property
    def eye_world_is_point(self) -> bool:
        """True where rays come from the eye (perspective), False where they are parallel."""
        return self.pixel_size[0] == 0

    def meets(self, low_world: Vector, high_world: Vector) -> NDArray[np.bool_]:
        """Which boxes (..., 3) may be in view; conservative: never False for one that is."""
        return boxes_meet(self.planes_world, low_world, high_world)


def boxes_meet(planes: Vector, low: Vector, high: Vector) -> NDArray[np.bool_]:
    """Which boxes (..., 3) may reach into all half-spaces (n, 4); never False for one that does."""
    centre, half = (low + high) / 2, (high - low) / 2
    normal, offset = planes[:, :3], planes[:, 3]
    reach = centre @ normal.T + half @ np.abs(normal).T + offset
    slack = PLANE_SLACK * np.linalg.norm(half, axis=-1, keepdims=True)
    return np.asarray((reach >= -slack).all(axis=-1))


def checked_size(size: tuple[int, int], limit: int | None = None) -> Size:
    """(width, height) of a picture.

    Raises:
        InvalidInputError: no two whole numbers, an empty picture, or a side beyond the limit.
    """
    sides = list(size) if isinstance(size, (tuple, list)) else []
    whole = all(isinstance(n, (int, np.integer)) and not isinstance(n, bool) for n in sides)
    if len(sides) != 2 or not whole or min(sides) < 1:
        raise InvalidInputError(
            f"picture size {size!r} must be (width, height) in pixels, both at least 1"
        )
    if limit is not None and max(sides) > limit:
        raise InvalidInputError(
            f"picture size {sides[0]}x{sides[1]} exceeds {limit} pixels a side, the limit of this "
            "OpenGL driver; render a smaller picture",
            size=[int(n) for n in sides],
            limit=limit,
        )
    return int(sides[0]), int(sides[1])


def make_view(camera: Camera, size: Size, level: SourceLevel) -> View:
    """The rays of a camera's picture through a level.

    Raises:
        InvalidInputError: the camera is so far away, or its picture so wide, that positions in
            the volume have no meaning any more.
    """
    right, up, forward = camera.basis_world()
    eye = np.array(camera.eye_world_xyz)
    low_world, high_world = box_world(Box.of_shape(level.shape_zyx), level)
    spacing = np.array(level.spacing_xyz)
    _require_near(camera, low_world, high_world)
    start_depth = max(0.0, float(((_corners(low_world, high_world) - eye) @ forward).min()))

    base, slope = pixel_size = _pixel_size(camera, size)
    if camera.fov_degrees is not None:
        toward = _pixel_grid(forward, slope * right, -slope * up, size)
        start_world = Affine(
            eye + start_depth * toward.at00,
            start_depth * toward.by_column,
            start_depth * toward.by_row,
        )
    else:
        toward = Affine(forward, np.zeros(3), np.zeros(3))
        start_world = _pixel_grid(eye + start_depth * forward, base * right, -base * up, size)
    return View(
        size=size,
        eye_world=eye,
        forward_world=forward,
        start_voxel=Affine(
            (start_world.at00 - low_world) / spacing,
            start_world.by_column / spacing,
            start_world.by_row / spacing,
        ),
        toward_world=toward,
        planes_world=_side_planes(start_world, toward, eye, forward, size),
        pixel_size=pixel_size,
        right_world=right,
        up_world=up,
        start_depth_world=start_depth,
    )


def nearest_pixel_world(camera: Camera, size: Size, level: SourceLevel) -> float:
    """World units across a pixel where a level is nearest to the eye; less than a view costs.

    Raises:
        InvalidInputError: as `make_view`.
    """
    low_world, high_world = box_world(Box.of_shape(level.shape_zyx), level)
    _require_near(camera, low_world, high_world)
    _, _, forward = camera.basis_world()
    depths = (_corners(low_world, high_world) - np.array(camera.eye_world_xyz)) @ forward
    base, slope = _pixel_size(camera, size)
    return base + slope * max(float(depths.min()), 0.0)


def _pixel_size(camera: Camera, size: Size) -> tuple[float, float]:
    """As `View.pixel_size`: either number is 0."""
    if camera.fov_degrees is not None:
        return 0.0, 2 * math.tan(math.radians(camera.fov_degrees) / 2) / min(size)
    assert camera.height_world is not None
    return camera.height_world / min(size), 0.0


def _require_near(camera: Camera, low_world: Vector, high_world: Vector) -> None:
    diagonal = float(np.linalg.norm(high_world - low_world))
    offset = np.abs(np.array(camera.eye_world_xyz) - (low_world + high_world) / 2).max()
    reach = max(float(offset), camera.height_world or 0.0)
    if reach > FARTHEST * diagonal:
        raise InvalidInputError(
            f"camera: the eye or the picture reaches {reach:g} world units from the volume, whose "
            f"diagonal is {diagonal:g}; stay within {FARTHEST:g} diagonals",
            reach_world=reach,
            diagonal_world=diagonal,
        )


def box_world(box: Box, level: SourceLevel) -> tuple[Vector, Vector]:
    """Lowest and highest corner (x, y, z) of a box of a level's voxels."""
    spacing = np.array(level.spacing_xyz)
    low = np.array(level.origin_xyz) - spacing / 2
    start, stop = np.array(box.start_zyx[::-1]), np.array(box.stop_zyx[::-1])
    return low + spacing * start, low + spacing * stop


def _pixel_grid(middle: Vector, by_column: Vector, by_row: Vector, size: Size) -> Affine:
    width, height = size
    return Affine(middle - by_column * (width / 2) - by_row * (height / 2), by_column, by_row)


def _corners(low: Vector, high: Vector) -> Vector:
    pick = np.array([[(i >> axis) & 1 for axis in range(3)] for i in range(8)], dtype=bool)
    return np.where(pick, high, low)


def _side_planes(
    start_world: Affine, toward_world: Affine, eye: Vector, forward: Vector, size: Size
) -> NDArray[np.float64]:
    """Planes through the picture's four edges and the eye, all facing inwards."""
    width, height = size
    corners = [(0, 0), (width, 0), (width, height), (0, height)]
    planes = [(forward, -float(forward @ eye))]
    inside = start_world.at(width / 2, height / 2) + toward_world.at(width / 2, height / 2)
    for i, (a, b) in enumerate(zip(corners, corners[1:] + corners[:1], strict=True)):
        along_edge = start_world.by_column if i % 2 == 0 else start_world.by_row
        if not along_edge.any():  # the eye is inside: all rays start in one point
            along_edge = toward_world.by_column if i % 2 == 0 else toward_world.by_row
        normal = cross(toward_world.at(*a), along_edge)
        normal /= math.sqrt(normal @ normal)
        through = start_world.at(*b)
        if normal @ (inside - through) < 0:
            normal = -normal
        planes.append((normal, -float(normal @ through)))
    return np.array([[*normal, offset] for normal, offset in planes])
