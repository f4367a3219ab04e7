"""Pictures between cameras: views as they are stored, blends as a slow reference has them."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image

from octobrick.codec.errors import InvalidInputError, UnsupportedError
from octobrick.renderer.light_field import Eye, Interpolation, LightField, eye_path
from octobrick.renderer.light_field.view_cache import ViewCache
from octobrick.store import Box, CameraStep, Volume, ingest, open_volume

NU, NV, NY, NX = 5, 4, 12, 16
GRID16 = Path(__file__).resolve().parents[3] / "shared/data/lightfield_grid16"
INTERPOLATIONS = get_args(Interpolation)


def made(folder: Path, nc: int = 3, **options: Any) -> Volume:
    """A light field of noise, in bricks so small that its views lie in several layers."""
    rng = np.random.default_rng(7)
    (folder / "views").mkdir()
    for row in range(NV):
        for column in range(NU):
            pixels = rng.integers(0, 256, (NY, NX, 3)[: 3 if nc == 3 else 2], np.uint8)
            Image.fromarray(pixels).save(folder / "views" / f"v_{row}_{column}.png")
    ingest(folder / "views", folder / "lf.zarr", brick=8, cameras=CameraStep(), **options)
    return open_volume(folder / "lf.zarr")


@pytest.fixture(scope="module")
def volume(tmp_path_factory: pytest.TempPathFactory) -> Volume:
    return made(tmp_path_factory.mktemp("light_field"))


@pytest.fixture(scope="module")
def scene(volume: Volume) -> LightField:
    return LightField(volume)


def stored(volume: Volume, u: int, v: int) -> NDArray[Any]:
    """A view (y, x, 3), read from the volume by its slice."""
    assert volume.light_field is not None
    z = volume.light_field.slice_of(u, v)
    box = Box((z, 0, 0), (z + 1, NY, NX))
    return np.stack([volume.read(0, box, 0, c)[0] for c in range(3)], axis=-1)


def pixel(view: NDArray[Any], y: float, x: float, how: str) -> NDArray[Any] | None:
    """One sample of a view; None beyond its pixels."""
    if not (-0.5 <= y < NY - 0.5 and -0.5 <= x < NX - 0.5):
        return None
    if how == "nearest":
        return view[int(np.floor(y + 0.5)), int(np.floor(x + 0.5))].astype(float)
    y, x = min(max(y, 0), NY - 1), min(max(x, 0), NX - 1)
    total = np.zeros(3)
    for j in {int(y), min(int(y) + 1, NY - 1)}:
        for i in {int(x), min(int(x) + 1, NX - 1)}:
            share = max(0.0, 1 - abs(y - j)) * max(0.0, 1 - abs(x - i))
            total += share * view[j, i]
    return total


@pytest.fixture(scope="module")
def views(volume: Volume) -> dict[tuple[int, int], NDArray[Any]]:
    return {(u, v): stored(volume, u, v) for u in range(NU) for v in range(NV)}


def reference(views: dict[tuple[int, int], NDArray[Any]], eye: Eye, how: str) -> NDArray[Any]:
    """Premultiplied RGBA, pixel by pixel and view by view."""
    out = np.zeros((NY, NX, 4))
    for y in range(NY):
        for x in range(NX):
            u = eye.u + eye.spread * (x - (NX - 1) / 2) / NX
            v = eye.v + eye.spread * (y - (NY - 1) / 2) / NX
            if not (0 <= u <= NU - 1 and 0 <= v <= NV - 1):
                continue
            total, weights = np.zeros(3), 0.0
            for (i, j), view in views.items():
                if how == "uvst":
                    weight = max(0.0, 1 - abs(u - i)) * max(0.0, 1 - abs(v - j))
                else:
                    weight = float(np.floor(u + 0.5) == i and np.floor(v + 0.5) == j)
                at = (y + eye.focus * (j - v), x + eye.focus * (i - u))
                sample = pixel(view, *at, how) if weight > 0 else None
                if sample is not None:
                    total, weights = total + weight * sample, weights + weight
            if weights > 0:
                out[y, x] = (*(total / weights / 255), 1)
    return out


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
@pytest.mark.parametrize("focus", [0.0, -3.7])
def test_at_a_camera_its_view_is_seen_exactly(
    volume: Volume, scene: LightField, interpolation: Interpolation, focus: float
) -> None:
    for u, v in ((0, 0), (NU - 1, NV - 1), (2, 1)):
        image = scene.render(Eye(u, v, focus), interpolation)
        np.testing.assert_array_equal(image.rgba[..., :3], stored(volume, u, v))
        np.testing.assert_array_equal(scene.view(u, v), stored(volume, u, v))
        assert (image.rgba[..., 3] == 255).all()


@settings(max_examples=15)
@given(
    # Eighths, so that no rounding decides which pixel or view is the nearest.
    st.integers(0, 8 * (NU - 1)),
    st.integers(0, 8 * (NV - 1)),
    st.integers(-20, 20),
    st.sampled_from([0, 0, 1, 4]),
    st.sampled_from(INTERPOLATIONS),
)
def test_every_picture_is_that_of_the_reference(
    views: dict[tuple[int, int], NDArray[Any]],
    scene: LightField,
    u: int,
    v: int,
    focus: int,
    spread: int,
    interpolation: Interpolation,
) -> None:
    eye = Eye(u / 8, v / 8, focus / 8, float(spread))
    image = scene.render(eye, interpolation, None)
    expected = reference(views, eye, interpolation)
    np.testing.assert_allclose(image.premultiplied, expected, atol=2e-6)


def test_halfway_in_the_plane_of_the_pictures_is_the_mean_of_four_views(
    volume: Volume, scene: LightField
) -> None:
    image = scene.render(Eye(1.5, 2.5), "uvst")
    views = [stored(volume, u, v).astype(float) for u in (1, 2) for v in (2, 3)]
    np.testing.assert_allclose(image.premultiplied[..., :3] * 255, np.mean(views, 0), atol=1e-3)


def test_where_no_view_reaches_is_background(scene: LightField) -> None:
    eye = Eye(0.5, 0, focus=NX)
    assert (scene.render(eye, "st").premultiplied[..., 3] == 0).any()
    rgba = scene.render(eye, "st", (0, 1, 0)).rgba
    assert (rgba == [0, 255, 0, 255]).all(-1).any()
    assert (rgba[..., 3] == 255).all()


def test_gray_views_are_shown_gray(tmp_path: Path) -> None:
    rgba = LightField(made(tmp_path, nc=1)).render(Eye(1.5, 1.5)).rgba
    assert np.ptp(rgba[..., :3], axis=-1).max() == 0
    assert np.ptp(rgba[..., 0]) > 0


class Counted:
    """A volume that notes which slices are read."""

    def __init__(self, volume: Volume) -> None:
        self._volume = volume
        self.slices: list[tuple[int, int]] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._volume, name)

    def read(self, level: int, box: Box, t: int = 0, c: int = 0) -> Any:
        self.slices.append((box.start_zyx[0], box.stop_zyx[0]))
        return self._volume.read(level, box, t, c)


def test_only_bricks_of_views_in_use_are_read_and_once(volume: Volume) -> None:
    counted = Counted(volume)
    scene = LightField(counted)
    image = scene.render(Eye(0.5, 0.5))
    assert all(start >= 0 and stop <= 8 for start, stop in counted.slices)  # layer 0 of 3
    assert image.stats.bricks["decoded"] == 3 * 2 * 2  # channels, rows and columns of bricks
    counted.slices.clear()
    assert scene.render(Eye(2.5, 0.5)).stats.bricks["decoded"] == 0  # in the same bricks
    assert counted.slices == []
    assert scene.render(Eye(4, 3)).stats.bricks["decoded"] == 3 * 2 * 2


@pytest.mark.parametrize("nviews", [0, 1, 3, 7])
def test_kept_views_stay_within_the_budget_and_are_right(volume: Volume, nviews: int) -> None:
    view_nbytes = NX * NY * 3
    cache = ViewCache(volume, nviews * view_nbytes)
    for wanted in ([(0, 0)], [(1, 1), (1, 2)], [(4, 3), (0, 0)], [(3, 2)]):
        for view, pixels in cache.get(wanted).items():
            np.testing.assert_array_equal(pixels, stored(volume, *view))
        assert cache.nbytes <= max(nviews, len(wanted)) * view_nbytes


def test_the_worst_error_is_that_of_the_bricks_in_use(volume: Volume, scene: LightField) -> None:
    tables = np.stack([volume.fidelity(0, 0, c)[..., 0] for c in range(3)])
    assert scene.render(Eye(4, 3), "nearest").fidelity.max_error == tables[:, 2].max()
    assert tables[:, 2].max() != tables[:, 0].max()


@pytest.mark.parametrize("u", [-0.001, NU - 0.999, 1e9])
def test_an_eye_beside_the_cameras_is_refused_naming_the_range(scene: LightField, u: float) -> None:
    with pytest.raises(InvalidInputError, match="0 to 4 along u and 0 to 3 along v"):
        scene.render(Eye(u, 0))


@pytest.mark.parametrize("field", ["u", "v", "focus", "spread"])
@pytest.mark.parametrize("value", [float("nan"), float("inf"), -1e300])
def test_an_eye_of_no_numbers_is_refused(field: str, value: float) -> None:
    if field in ("u", "v") and np.isfinite(value):
        return  # refused by the light field, which knows the range
    with pytest.raises(InvalidInputError, match=field):
        dataclasses.replace(Eye(0, 0), **{field: value})


def test_other_words_and_volumes_are_refused(scene: LightField, tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="nearest, st, uvst"):
        scene.render(Eye(0, 0), "cubic")  # type: ignore[arg-type]
    with pytest.raises(InvalidInputError, match="spread"):
        scene.render(Eye(0, 0, spread=9))
    with pytest.raises(InvalidInputError, match="no view"):
        scene.view(NU, 0)
    np.save(tmp_path / "v.npy", np.zeros((8, 8, 8), np.uint8))
    ingest(tmp_path / "v.npy", tmp_path / "v.zarr", brick=8)
    with (
        open_volume(tmp_path / "v.zarr") as other,
        pytest.raises(UnsupportedError, match="--light"),
    ):
        LightField(other)


def test_views_of_a_type_without_colours_are_refused(tmp_path: Path) -> None:
    floats = made(tmp_path, convert="float32", codec=None)
    with floats, pytest.raises(UnsupportedError, match="float32"):
        LightField(floats)


def test_a_path_meets_its_eyes_and_is_even() -> None:
    eyes = [Eye(0, 0), Eye(4, 2, 1.0, 2.0), Eye(4, 0)]
    path = eye_path(eyes, 9)
    assert path[::4] == eyes
    assert path[1] == Eye(1, 0.5, 0.25, 0.5)
    with pytest.raises(InvalidInputError, match="two or more"):
        eye_path(eyes, 1)


@pytest.mark.shared
@pytest.mark.skipif(not GRID16.is_dir(), reason="no real volumes beside the checkout")
def test_focus_brings_the_view_between_real_cameras_nearer_to_the_truth(tmp_path: Path) -> None:
    """Of every other view a light field, and one of the others beside it."""
    ingest(GRID16 / "view_0[68]_0[68].jpg", tmp_path / "lf", codec=None, cameras=CameraStep())
    truth = np.asarray(Image.open(GRID16 / "view_07_07.jpg")).astype(float)
    with open_volume(tmp_path / "lf") as volume:
        scene = LightField(volume)
        error = {
            focus: np.square(scene.render(Eye(0.5, 0.5, focus)).rgba[..., :3] - truth).mean()
            for focus in (0.0, 2.6)
        }
    assert error[2.6] < error[0.0] / 2
