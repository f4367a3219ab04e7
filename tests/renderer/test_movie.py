"""Shots of movies: where the camera is in each, without rendering any."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from octobrick.codec.errors import InvalidInputError
from octobrick.renderer import Camera, Shot, camera_path, through_time, turntable

from .array_source import ArraySource

VOLUME = ArraySource(np.zeros((20, 30, 40), np.uint8))
degrees = st.floats(-80, 80)


def vectors(camera: Camera) -> Any:
    return np.array([camera.eye_world_xyz, camera.target_world_xyz, *camera.basis_world()])


def orbit(azimuth: float, elevation: float = 20, **options: Any) -> Camera:
    return Camera.orbit(VOLUME, azimuth, elevation, **options)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_a_turntable_shows_every_azimuth_once(projection: str) -> None:
    def camera(azimuth: float) -> Camera:
        found = orbit(azimuth, 35)
        return found.orthographic() if projection == "orthographic" else found

    shots = turntable(camera(10), 8, t=3)
    assert [shot.t for shot in shots] == [3] * 8
    for index, shot in enumerate(shots):
        np.testing.assert_allclose(
            vectors(shot.camera), vectors(camera(10 + 45 * index)), atol=1e-9
        )


def test_part_of_a_turn_goes_as_far_as_it_is_told() -> None:
    shots = turntable(orbit(0), 3, degrees=-90)
    np.testing.assert_allclose(vectors(shots[2].camera), vectors(orbit(-60)), atol=1e-9)


def test_time_goes_as_it_is_told() -> None:
    camera = orbit(0)
    assert through_time(camera, (4, 2, 2)) == [Shot(camera, 4), Shot(camera, 2), Shot(camera, 2)]


@given(degrees, degrees, degrees, degrees, st.integers(2, 9))
def test_a_path_passes_through_its_keys(
    a: float, b: float, c: float, elevation: float, nbetween: int
) -> None:
    keys = [orbit(a), orbit(b, elevation, distance=300), orbit(c, 0, fov_degrees=50)]
    path = camera_path(keys, 2 * nbetween + 1)
    assert [path[0], path[nbetween], path[-1]] == keys
    for camera in path:
        assert np.isfinite(vectors(camera)).all()


def test_a_path_turns_evenly_on_the_shortest_arc() -> None:
    path = camera_path([orbit(350, 0), orbit(20, 0)], 4)
    for camera, azimuth in zip(path, (350, 360, 370, 380), strict=True):
        np.testing.assert_allclose(vectors(camera), vectors(orbit(azimuth, 0)), atol=1e-6)


def test_a_path_zooms_by_equal_factors() -> None:
    near, far = orbit(0, distance=50), orbit(0, distance=800)
    distances = [
        math.dist(camera.eye_world_xyz, camera.target_world_xyz)
        for camera in camera_path([near, far], 5)
    ]
    assert distances == pytest.approx([50, 100, 200, 400, 800])
    flat = camera_path([near.orthographic(), far.orthographic()], 3)[1]
    assert flat.height_world == pytest.approx(near.zoomed(1 / 4).orthographic().height_world)


def test_a_closed_path_is_a_loop_without_a_frame_twice() -> None:
    keys = [orbit(azimuth, 0) for azimuth in (0, 90, 180, 270)]
    path = camera_path(keys, 8, closed=True)
    for index, camera in enumerate(path):
        np.testing.assert_allclose(vectors(camera), vectors(orbit(45 * index, 0)), atol=1e-6)


@pytest.mark.parametrize(
    ("keys", "nframes", "says"),
    [
        ([orbit(0)], 5, "at least two"),
        ([orbit(0), orbit(1)], 1, "at least two"),
        ([orbit(0), orbit(1).orthographic()], 5, "make them alike"),
    ],
)
def test_paths_that_lead_nowhere_are_refused(keys: Any, nframes: int, says: str) -> None:
    with pytest.raises(InvalidInputError, match=says):
        camera_path(keys, nframes)


@pytest.mark.parametrize("options", [{"nframes": 0}, {"nframes": 2, "degrees": math.nan}])
def test_turns_of_nothing_are_refused(options: Any) -> None:
    with pytest.raises(InvalidInputError):
        turntable(orbit(0), **options)
