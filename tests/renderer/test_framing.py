from __future__ import annotations

import numpy as np
import pytest

from octobrick.codec.errors import InvalidInputError
from octobrick.renderer import Camera, TransferFunction, visible_bounds
from octobrick.renderer.camera import world_bounds
from octobrick.store import Volume, ingest, open_volume

BRIGHT = TransferFunction(colors=((0, (1, 1, 1)),), opacities=((99.5, 0), (100, 1)), domain="value")


@pytest.fixture
def volume(tmp_path_factory: pytest.TempPathFactory) -> Volume:
    voxels = np.zeros((40, 60, 50), np.uint8)
    voxels[10:20, 5:9, 30:50] = 200
    folder = tmp_path_factory.mktemp("framing")
    np.save(folder / "v.npy", voxels)
    ingest(folder / "v.npy", folder / "v.zarr", codec=None, spacing=(2.0, 1.0, 0.5))
    return open_volume(folder / "v.zarr")


def test_the_bounds_hold_just_what_is_visible_in_world_units(volume: Volume) -> None:
    low, high = visible_bounds(volume, BRIGHT)
    assert low.tolist() == [29.5 * 0.5, 4.5, 9.5 * 2]
    assert high.tolist() == [49.5 * 0.5, 8.5, 19.5 * 2]


def test_where_nothing_is_visible_the_bounds_are_those_of_the_volume(volume: Volume) -> None:
    nothing = TransferFunction(colors=((0, (1, 1, 1)),), opacities=((0, 0),), domain="value")
    found, whole = visible_bounds(volume, nothing), world_bounds(volume)
    np.testing.assert_array_equal(found, whole)


def test_a_camera_looks_at_the_middle_of_the_bounds_from_where_they_fit(volume: Volume) -> None:
    bounds = visible_bounds(volume, BRIGHT)
    camera = Camera.orbit(volume, 30, 20, bounds=bounds)
    assert camera.target_world_xyz == pytest.approx(tuple((bounds[0] + bounds[1]) / 2))
    far = Camera.orbit(volume, 30, 20)
    distance = np.subtract(camera.eye_world_xyz, camera.target_world_xyz)
    assert np.linalg.norm(distance) < np.linalg.norm(
        np.subtract(far.eye_world_xyz, far.target_world_xyz)
    )


def test_a_window_that_is_none_is_refused(volume: Volume) -> None:
    with pytest.raises(InvalidInputError, match="window"):
        visible_bounds(volume, BRIGHT, window=(5.0, 5.0))


def test_bounds_of_one_function_are_found_once_and_are_the_callers_own(
    volume: Volume, monkeypatch: pytest.MonkeyPatch
) -> None:
    low, _ = visible_bounds(volume, BRIGHT)
    wanted = low.tolist()
    low += 100
    monkeypatch.setattr(Volume, "read", lambda *_, **__: pytest.fail("read again"))
    assert visible_bounds(volume, BRIGHT)[0].tolist() == wanted
