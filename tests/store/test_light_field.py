"""Grids of pictures become volumes that say which slice is which view; bad grids are refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from octobrick.codec import S3dc, Zerobit
from octobrick.codec.errors import InvalidInputError, OctobrickError
from octobrick.store import (
    Box,
    CameraGrid,
    CameraStep,
    LocalVolume,
    Volume,
    ingest,
    open_volume,
)
from octobrick.store.attributes import VolumeAttributes
from octobrick.store.errors import (
    SourceError,
    SourceMismatchError,
    SourceNotFoundError,
    TruncatedSourceError,
    UnsupportedSourceError,
    VolumeFormatError,
)
from octobrick.store.sources import Source, open_source
from octobrick.store.verify import verify
from octobrick.store.verify_source import verify_against

SHAPE = (12, 16, 3)


def pixels(row: int, column: int, shape: tuple[int, ...] = SHAPE) -> np.ndarray:
    """Those of a view, which differ everywhere from every other view's."""
    return np.random.default_rng([row, column]).integers(0, 255, shape, np.uint8)


def write_views(folder: Path, nu: int, nv: int, shape: tuple[int, ...] = SHAPE) -> Path:
    folder.mkdir(exist_ok=True)
    for row in range(nv):
        for column in range(nu):
            view = Image.fromarray(pixels(row, column, shape))
            view.save(folder / f"view_{row:02}_{column:02}.png")
    return folder


def opened(path: Path) -> Source:
    return open_source(path, cameras=CameraStep())


@given(st.integers(1, 9), st.integers(1, 9))
def test_every_view_has_a_slice_and_every_slice_a_view(nu: int, nv: int) -> None:
    if nu * nv == 1:
        return
    grid = CameraGrid(nu, nv)
    views = [(u, v) for v in range(nv) for u in range(nu)]
    slices = [grid.slice_of(*view) for view in views]
    assert [grid.view_of(z) for z in slices] == views
    assert grid.nslices % 4 == 0
    assert {grid.view_of(z) for z in range(grid.nslices)} == set(views)
    assert CameraGrid.from_json(json.loads(json.dumps(grid.to_json()))) == grid


def test_the_order_is_that_of_the_paper() -> None:
    group = [(0, 0), (1, 0), (0, 1), (1, 1)]
    views = [CameraGrid(4, 4).view_of(z) for z in range(16)]
    for start, (i, j) in zip(range(0, 16, 4), group, strict=True):
        assert views[start : start + 4] == [(u + 2 * i, v + 2 * j) for u, v in group]


@pytest.mark.parametrize(("nu", "nv"), [(4, 4), (3, 5), (5, 1), (1, 2)])
def test_every_slice_is_its_view(tmp_path: Path, nu: int, nv: int) -> None:
    with opened(write_views(tmp_path / "views", nu, nv)) as source:
        assert source.light_field == CameraGrid(nu, nv)
        volume = source.read_channels(Box.of_shape(source.shape_zyx))
        for z in range(source.shape_zyx[0]):
            u, v = CameraGrid(nu, nv).view_of(z)
            np.testing.assert_array_equal(np.moveaxis(volume[:, z], 0, -1), pixels(v, u))


def test_a_volume_tells_its_cameras(tmp_path: Path) -> None:
    write_views(tmp_path / "views", 4, 3)
    step = CameraStep((30.77, 15), "millimeter")
    result = ingest(tmp_path / "views", tmp_path / "lf.zarr", brick=8, cameras=step)
    assert len(result.levels) == 1
    with open_volume(tmp_path / "lf.zarr") as volume:
        assert volume.light_field == CameraGrid(4, 3, step)
        assert volume.codec == Zerobit()
        assert volume.nc == 3
        assert verify(volume.path).sound
        with opened(tmp_path / "views") as source:
            assert verify_against(volume.path, source).sound
        with open_source(tmp_path / "views") as slices, pytest.raises(SourceMismatchError):
            verify_against(volume.path, slices)


def test_gray_views_and_other_codecs_are_kept_as_asked(tmp_path: Path) -> None:
    write_views(tmp_path / "views", 2, 2, (12, 16))
    codec = S3dc(block=(4, 4, 4), bits=8)
    ingest(tmp_path / "views", tmp_path / "lf.zarr", codec=codec, brick=8, cameras=CameraStep())
    with open_volume(tmp_path / "lf.zarr") as volume:
        assert (volume.nc, volume.codec) == (1, codec)
        np.testing.assert_array_equal(volume.read(0)[1], pixels(0, 1, (12, 16)))


def test_a_volume_of_anything_else_says_nothing_of_cameras(
    ingested: Callable[..., Volume],
) -> None:
    volume = ingested(np.zeros((4, 4, 4), np.uint8), brick=8)
    assert volume.light_field is None
    assert "light_field" not in volume.attributes()


def test_every_other_view_is_a_grid(tmp_path: Path) -> None:
    write_views(tmp_path / "views", 4, 4)
    with opened(tmp_path / "views" / "view_0[02]_0[13].png") as source:
        assert source.light_field == CameraGrid(2, 2)
        plane = source.read_channels(Box((3, 0, 0), (4, *SHAPE[:2])))[:, 0]
    np.testing.assert_array_equal(np.moveaxis(plane, 0, -1), pixels(2, 3))


def remove(name: str) -> Callable[[Path], object]:
    return lambda folder: (folder / name).unlink()


def save(name: str, shape: tuple[int, ...]) -> Callable[[Path], object]:
    return lambda folder: Image.fromarray(pixels(9, 9, shape)).save(folder / name)


BAD_GRIDS: dict[str, tuple[Callable[[Path], object], type[OctobrickError], str]] = {
    "a view is missing": (remove("view_01_02.png"), SourceError, r"1 are missing.*\(1, 2\)"),
    "another size": (save("view_01_01.png", (12, 15, 3)), SourceError, "15 x 12.*16 x 12"),
    "another type": (save("view_01_01.png", (12, 16)), SourceError, "view_01_01.png"),
    "a name without numbers": (save("front.png", SHAPE), UnsupportedSourceError, "ROW_COLUMN"),
    "one number": (save("view_7.png", SHAPE), UnsupportedSourceError, "ROW_COLUMN"),
    "twice": (save("view_1_1.png", SHAPE), SourceError, "row 1, column 1"),
    "far away": (save(f"view_{10**60}_0.png", SHAPE), SourceError, "missing"),
}


@pytest.mark.parametrize(("spoil", "error", "message"), BAD_GRIDS.values(), ids=BAD_GRIDS.keys())
def test_a_bad_grid_is_refused_before_anything_is_written(
    tmp_path: Path, spoil: Callable[[Path], object], error: type[OctobrickError], message: str
) -> None:
    folder = write_views(tmp_path / "views", 3, 2)
    spoil(folder)
    with pytest.raises(error, match=message):
        ingest(folder, tmp_path / "lf.zarr", cameras=CameraStep())
    assert not list(tmp_path.glob("lf.zarr*"))


def test_one_view_an_empty_folder_and_a_file_are_no_light_field(tmp_path: Path) -> None:
    folder = write_views(tmp_path / "views", 2, 1)
    with pytest.raises(SourceError, match="one view"):
        opened(folder / "view_00_0[0].png")
    with pytest.raises(UnsupportedSourceError, match="folder"):
        opened(folder / "view_00_00.png")
    (tmp_path / "empty").mkdir()
    with pytest.raises(SourceNotFoundError):
        opened(tmp_path / "empty")


def test_views_with_alpha_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UnsupportedSourceError, match="alpha"):
        opened(write_views(tmp_path / "views", 2, 2, (12, 16, 4)))


def test_a_truncated_jpeg_is_named_when_it_is_read(tmp_path: Path) -> None:
    for row in range(2):
        for column in range(2):
            Image.fromarray(pixels(row, column)).save(tmp_path / f"v_{row}_{column}.jpg")
    cut = tmp_path / "v_1_0.jpg"
    cut.write_bytes(cut.read_bytes()[:-60])
    with pytest.raises(TruncatedSourceError, match="v_1_0"):
        ingest(tmp_path, tmp_path / "lf.zarr", cameras=CameraStep())


@pytest.mark.parametrize(
    "options", [{"levels": 2}, {"region": Box((0, 0, 0), (4, 4, 4))}, {"axes": "zyx"}], ids=str
)
def test_options_that_would_mix_views_are_refused(tmp_path: Path, options: Any) -> None:
    folder = write_views(tmp_path / "views", 2, 2)
    with pytest.raises(InvalidInputError):
        ingest(folder, tmp_path / "lf.zarr", cameras=CameraStep(), **options)


@pytest.mark.parametrize("uv", [(0, 1), (1, -1), (float("nan"), 1), (1, float("inf"))])
def test_a_camera_step_that_is_none_is_refused(uv: tuple[float, float]) -> None:
    with pytest.raises(InvalidInputError, match="camera step"):
        CameraStep(uv)


@pytest.fixture(scope="module")
def light_field(tmp_path_factory: pytest.TempPathFactory) -> LocalVolume:
    folder = tmp_path_factory.mktemp("light_field")
    write_views(folder / "views", 4, 3)
    ingest(folder / "views", folder / "lf.zarr", brick=8, cameras=CameraStep())
    return open_volume(folder / "lf.zarr")


LIES = {
    "fewer views": {"nu": 2},
    "more views": {"nv": 5},
    "no view": {"nu": 0, "nv": 0},
    "one view": {"nu": 1, "nv": 1},
    "a truth value": {"nu": True},
    "text": {"nv": "3"},
    "endless": {"nu": 2**70},
    "another version": {"version": 2},
    "another order": {"order": "rows"},
    "a step of nothing": {"camera_step": [0, 1]},
    "a step beyond floats": {"camera_step": [10**400, 1]},
    "an infinite step": {"camera_step": [float("inf"), 1]},
    "three steps": {"camera_step": [1, 1, 1]},
    "a long unit": {"unit": "m" * 1000},
    "another field": {"more": 1},
}


@pytest.mark.parametrize("lie", LIES.values(), ids=LIES.keys())
def test_cameras_that_lie_are_refused_by_name(
    light_field: LocalVolume, lie: dict[str, object]
) -> None:
    """Whatever the revision says: it can be made for any attributes."""
    fields = light_field.attributes()
    VolumeAttributes.from_json(fields, "here")
    fields["light_field"] |= lie
    with pytest.raises(VolumeFormatError, match="light_field"):
        VolumeAttributes.from_json(fields, "here")


def test_a_light_field_of_several_levels_is_refused(light_field: LocalVolume) -> None:
    fields = light_field.attributes()
    nz, ny, nx = fields["levels"][0]["shape"]
    half = {"shape": [nz // 2, ny // 2, nx // 2]}
    fields["levels"].append(fields["levels"][0] | half)
    with pytest.raises(VolumeFormatError, match="one level"):
        VolumeAttributes.from_json(fields, "here")


@given(st.recursive(st.none() | st.integers() | st.floats() | st.text(), st.lists, max_leaves=4))
def test_no_value_of_the_attribute_crashes(light_field: LocalVolume, value: object) -> None:
    fields = light_field.attributes() | {"light_field": value}
    if value is None:
        assert VolumeAttributes.from_json(fields, "here").light_field is None
        return
    with pytest.raises(VolumeFormatError, match="light_field"):
        VolumeAttributes.from_json(fields, "here")
