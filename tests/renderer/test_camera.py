from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from octobrick.codec.errors import InvalidInputError
from octobrick.renderer import Camera
from octobrick.renderer.view import make_view

from .array_source import ArraySource

SOURCE = ArraySource(np.zeros((20, 30, 40), np.uint8), brick=32, spacing_xyz=(1.0, 2.0, 0.5))
CENTRE = (19.5, 29.0, 4.75)
angles = st.floats(-720, 720, allow_subnormal=False)


def direction(camera: Camera) -> np.ndarray:
    offset = np.subtract(camera.eye_world_xyz, camera.target_world_xyz)
    return np.asarray(offset / np.linalg.norm(offset))


@pytest.mark.parametrize(
    ("azimuth", "elevation", "towards", "right", "up"),
    [
        (0, 0, (0, -1, 0), (1, 0, 0), (0, 0, 1)),  # a face in LPS: from the front
        (90, 0, (1, 0, 0), (0, 1, 0), (0, 0, 1)),
        (180, 0, (0, 1, 0), (-1, 0, 0), (0, 0, 1)),
        (-90, 0, (-1, 0, 0), (0, -1, 0), (0, 0, 1)),
        (0, 90, (0, 0, 1), (1, 0, 0), (0, 1, 0)),
        (0, -90, (0, 0, -1), (1, 0, 0), (0, -1, 0)),
    ],
)
def test_orbit_stands_where_its_angles_say(
    azimuth: float, elevation: float, towards: tuple, right: tuple, up: tuple
) -> None:
    camera = Camera.orbit(SOURCE, azimuth, elevation)
    assert camera.target_world_xyz == CENTRE
    np.testing.assert_allclose(direction(camera), towards, atol=1e-12)
    found_right, found_up, _ = camera.basis_world()
    np.testing.assert_allclose(found_right, right, atol=1e-12)
    np.testing.assert_allclose(found_up, up, atol=1e-12)


@given(angles, angles)
def test_picture_axes_are_right_handed_and_orthonormal(azimuth: float, elevation: float) -> None:
    right, up, forward = Camera.orbit(SOURCE, azimuth, elevation).basis_world()
    np.testing.assert_allclose(np.cross(right, up), -forward, atol=1e-9)
    np.testing.assert_allclose([right @ right, up @ up, right @ up], [1, 1, 0], atol=1e-9)


@given(
    angles, angles, st.floats(5, 120), st.booleans(),
    st.tuples(st.integers(1, 300), st.integers(1, 300)),
)  # fmt: skip
@settings(max_examples=60)
def test_fitted_orbit_sees_every_corner(
    azimuth: float, elevation: float, fov: float, orthographic: bool, size: tuple[int, int]
) -> None:
    camera = Camera.orbit(SOURCE, azimuth, elevation, fov_degrees=fov)
    view = make_view(camera.orthographic() if orthographic else camera, size, SOURCE.levels[0])
    low, high = np.array((-0.5, -1.0, -0.25)), np.array((39.5, 59.0, 9.75))
    corners = np.array([[(low, high)[i >> a & 1][a] for a in range(3)] for i in range(8)])
    planes = view.planes_world
    assert (corners @ planes[:, :3].T + planes[:, 3] >= -1e-9).all()


@given(
    st.tuples(*[st.floats(-1e6, 1e6)] * 3), st.tuples(*[st.floats(-1e6, 1e6)] * 3),
    st.floats(0.01, 179),
)  # fmt: skip
def test_dict_makes_an_equal_camera(eye: tuple, target: tuple, fov: float) -> None:
    try:
        camera = Camera.look_at(eye, target, (0.3, 0.5, 1.0), fov_degrees=fov)
        cameras = (camera, camera.orthographic())
    except InvalidInputError:
        return
    for each in cameras:
        assert Camera.from_dict(json.loads(json.dumps(each.to_dict()))) == each


def pixel_world(camera: Camera, size: tuple[int, int], depth: float) -> float:
    base, slope = make_view(camera, size, SOURCE.levels[0]).pixel_size
    return base + slope * depth


def test_orthographic_keeps_the_size_at_the_target() -> None:
    camera = Camera.orbit(SOURCE, 30, 20)
    parallel = camera.orthographic()
    assert parallel.fov_degrees is None
    assert parallel.orthographic() == parallel
    depth = math.dist(camera.eye_world_xyz, camera.target_world_xyz)
    size = (100, 80)
    of_each = [pixel_world(c, size, depth) for c in (camera, parallel)]
    assert of_each[0] == pytest.approx(of_each[1])


def test_zooming_doubles_what_is_at_the_target() -> None:
    camera = Camera.orbit(SOURCE, 30, 20)
    for each in (camera, camera.orthographic()):
        depth = [math.dist(c.eye_world_xyz, c.target_world_xyz) for c in (each, each.zoomed(2))]
        sizes = [
            pixel_world(c, (64, 64), d) for c, d in zip((each, each.zoomed(2)), depth, strict=True)
        ]
        assert sizes[0] == pytest.approx(2 * sizes[1])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((0, 0, 0), (0, 0, 0)), "same point"),
        (((0, 0, math.nan), (1, 0, 0)), "three finite numbers"),
        (((0, 0), (1, 0, 0)), "three finite numbers"),
        (((0, 0, 0), (1, 0, math.inf)), "three finite numbers"),
        (((0, 0, 0), (0, 0, 5)), "along the view"),
        (((0, 0, 0), (1, 0, 0), (0, 0, 0)), "no length"),
        (((0, 0, 0), (1, 0, 0), (0, 0, 1), 0.0), "between 0 and 180"),
        (((0, 0, 0), (1, 0, 0), (0, 0, 1), 180.0), "between 0 and 180"),
        (((0, 0, 0), (1, 0, 0), (0, 0, 1), math.nan), "between 0 and 180"),
        (((0, 0, 0), (1, 0, 0), (0, 0, 1), None), "height_world"),
        (((0, 0, 0), (1, 0, 0), (0, 0, 1), 30.0, 5.0), "height_world"),
        (((0, 0, 0), (1, 0, 0), (0, 0, 1), None, -1.0), "positive, finite"),
    ],
)
def test_impossible_cameras_are_refused(arguments: tuple, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message) as caught:
        Camera(*arguments)
    json.dumps(caught.value.facts, allow_nan=False)


@pytest.mark.parametrize("distance", [0, -1, math.inf, math.nan])
def test_impossible_distances_are_refused(distance: float) -> None:
    with pytest.raises(InvalidInputError, match="positive, finite"):
        Camera.orbit(SOURCE, distance=distance)


def test_unknown_fields_of_a_camera_are_refused() -> None:
    data = Camera.orbit(SOURCE).to_dict()
    with pytest.raises(InvalidInputError, match=r"unknown fields \['roll'\]"):
        Camera.from_dict(data | {"roll": 3})
    del data["eye_world_xyz"]
    with pytest.raises(InvalidInputError, match=r"missing fields \['eye_world_xyz'\]"):
        Camera.from_dict(data)


def test_turned_cameras_show_the_same_side_of_a_source_however_its_axes_lie() -> None:
    front = Camera((0.0, -10.0, 2.0), (0.0, 0.0, 2.0))
    # The volume's x is the source's y, its y is -x, its z stays.
    direction = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    turned = front.turned(direction)
    assert turned.eye_world_xyz == pytest.approx((-10.0, 0.0, 2.0))
    assert turned.target_world_xyz == front.target_world_xyz
    for mine, theirs in zip(turned.basis_world(), front.basis_world(), strict=True):
        np.testing.assert_allclose(np.array(direction) @ mine, theirs, atol=1e-12)
    for wrong in (((1.0, 0.0),), np.zeros((3, 3)).tolist(), [[np.nan] * 3] * 3):
        with pytest.raises(InvalidInputError, match="direction"):
            front.turned(wrong)
