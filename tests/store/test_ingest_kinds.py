"""Volumes of several channels and time steps, of labels, of a region, of converted voxels."""

from __future__ import annotations

import sys
import threading
from pathlib import Path

import numpy as np
import pytest
import tifffile
import zarr

from octobrick.codec import S3dc, reduce
from octobrick.codec.errors import InvalidInputError, UnsupportedError
from octobrick.store import Box, ingest, open_volume
from octobrick.store.errors import IngestCancelledError
from octobrick.store.sources import Description, Source, open_source

from .conftest import smooth


class FilmSource(Source):
    """Two channels over three time steps, of which no two hold the same."""

    def __init__(self, voxels: np.ndarray) -> None:
        nt, nc, *shape = voxels.shape
        z, y, x = shape
        super().__init__(Path("film"), Description("film", (z, y, x), voxels.dtype, nt=nt, nc=nc))
        self.voxels = voxels

    @property
    def files(self) -> tuple[Path, ...]:
        return (Path(__file__),)

    def _read(self, box: Box, t: int, c: int) -> np.ndarray:
        return np.ascontiguousarray(self.voxels[(t, c, *box.slices)])

    def _close(self) -> None:
        pass


@pytest.fixture
def film(monkeypatch: pytest.MonkeyPatch) -> np.ndarray:
    """What a source that is opened under any name gives: (t, c, z, y, x)."""
    voxels = np.stack(
        [[smooth((30, 40, 50), "uint16") + t * 2 + c for c in range(2)] for t in range(3)]
    ).astype(np.uint16)
    module = sys.modules[ingest.__module__]
    monkeypatch.setattr(module, "open_source", lambda *_, **__: FilmSource(voxels))
    return voxels


def test_viewers_are_told_names_colours_and_window_of_the_channels(tmp_path: Path) -> None:
    voxels = np.stack([smooth((9, 20, 24), "uint8", seed) for seed in range(3)], axis=-1)
    tifffile.imwrite(tmp_path / "v.tif", voxels, photometric="rgb")
    ingest(tmp_path / "v.tif", tmp_path / "v.zarr", codec=None, brick=16)
    attributes = zarr.open_group(tmp_path / "v.zarr", mode="r").attrs.asdict()
    shown = attributes["ome"]["omero"]["channels"]
    assert [channel["color"] for channel in shown] == ["ff0000", "00ff00", "0000ff"]
    assert [channel["label"] for channel in shown] == ["red", "green", "blue"]
    low, high = attributes["octobrick"]["window"]
    assert (shown[0]["window"]["start"], shown[0]["window"]["end"]) == (low, high)
    with open_source(tmp_path / "v.zarr") as again:  # and so the volume is a source of colours
        assert again.is_rgb


def test_every_channel_of_every_time_step_is_stored(film: np.ndarray, tmp_path: Path) -> None:
    result = ingest("film", tmp_path / "v.zarr", codec=None, brick=16, shard=2)
    volume = open_volume(tmp_path / "v.zarr")
    assert (volume.nt, volume.nc) == (3, 2)
    for t, c in np.ndindex(3, 2):
        np.testing.assert_array_equal(volume.read(0, t=t, c=c), film[t, c])
        np.testing.assert_array_equal(volume.read(1, t=t, c=c), reduce.mean2(film[t, c]))
        low, high = volume.ranges(0, t, c)[..., 0].min(), volume.ranges(0, t, c)[..., 1].max()
        assert (low, high) == (film[t, c].min(), film[t, c].max())
    assert result.levels[0].nbytes == film.nbytes
    np.testing.assert_array_equal(zarr.open_array(tmp_path / "v.zarr" / "0", mode="r"), film)


def test_an_ingest_of_time_steps_goes_on_in_the_step_where_it_stopped(
    film: np.ndarray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("octobrick.store.piece_reader.READ_NBYTES", 8 * 2 * 2 * 40 * 50)
    options = {"brick": 16, "shard": 2, "checkpoint_seconds": 0.0}
    whole = ingest("film", tmp_path / "whole.zarr", **options)
    for after in (3, 7):
        cancel = threading.Event()
        done: list[int] = []

        def stop(_: object, done=done, after=after, cancel=cancel) -> None:
            done.append(1)
            if len(done) == after:
                cancel.set()

        with pytest.raises(IngestCancelledError):
            ingest("film", tmp_path / "v.zarr", progress=stop, cancel=cancel, **options)
    result = ingest("film", tmp_path / "v.zarr", **options)
    assert result.resumed_voxels > film.size // 2
    assert result.revision == whole.revision


def test_labels_are_kept_exactly_and_reduced_by_mode(tmp_path: Path) -> None:
    voxels = np.zeros((20, 20, 20), np.uint16)
    voxels[:, :, 5:] = 7000
    np.save(tmp_path / "v.npy", voxels)
    ingest(tmp_path / "v.npy", tmp_path / "v.zarr", labels=True, levels=2)
    volume = open_volume(tmp_path / "v.zarr")
    assert volume.codec is None
    np.testing.assert_array_equal(volume.read(1), reduce.mode2(voxels))
    assert set(np.unique(volume.read(1))) == {0, 7000}
    assert volume.metadata()["reducer"] == "mode"


def test_labels_by_a_lossy_code_are_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "v.npy", smooth((8, 8, 8)))
    with pytest.raises(InvalidInputError, match="labels are stored exactly"):
        ingest(tmp_path / "v.npy", tmp_path / "v.zarr", labels=True, codec=S3dc(bits=8))


@pytest.mark.parametrize("reducer", ["max", "min", "nearest"])
def test_levels_are_made_by_the_reducer_that_was_asked_for(tmp_path: Path, reducer: str) -> None:
    voxels = smooth((9, 12, 15), "int16")
    np.save(tmp_path / "v.npy", voxels)
    ingest(tmp_path / "v.npy", tmp_path / "v.zarr", codec=None, brick=8, reducer=reducer)
    volume = open_volume(tmp_path / "v.zarr")
    expected = getattr(reduce, f"{reducer}2")(voxels)
    np.testing.assert_array_equal(volume.read(1), expected)


def test_a_region_is_the_part_of_the_source(tmp_path: Path) -> None:
    voxels = smooth((20, 30, 40))
    np.save(tmp_path / "v.npy", voxels)
    region = Box((2, 3, 4), (-1, 25, 40))
    ingest(tmp_path / "v.npy", tmp_path / "v.zarr", codec=None, region=region, spacing=(3, 2, 1))
    volume = open_volume(tmp_path / "v.zarr")
    np.testing.assert_array_equal(volume.read(0), voxels[2:20, 3:25, 4:40])
    assert volume.metadata()["source"]["origin_xyz"] == [4.0, 6.0, 6.0]


def test_a_region_outside_the_source_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "v.npy", smooth((4, 4, 4)))
    with pytest.raises(InvalidInputError, match=r"region of .*v\.npy"):
        ingest(tmp_path / "v.npy", tmp_path / "v.zarr", region=Box((0, 0, 0), (5, 4, 4)))


@pytest.mark.parametrize(("given", "stored"), [("bool", "uint8"), ("float16", "float32")])
def test_types_that_fit_into_another_are_converted_by_themselves(
    tmp_path: Path, given: str, stored: str
) -> None:
    voxels = (smooth((8, 9, 10)) % 2).astype(given)
    np.save(tmp_path / "v.npy", voxels)
    ingest(tmp_path / "v.npy", tmp_path / "v.zarr", codec=None)
    assert open_volume(tmp_path / "v.zarr").dtype == stored
    np.testing.assert_array_equal(open_volume(tmp_path / "v.zarr").read(0), voxels.astype(stored))


def test_a_type_that_volumes_do_not_hold_is_refused_with_the_conversions(tmp_path: Path) -> None:
    np.save(tmp_path / "v.npy", np.zeros((4, 4, 4), np.int32))
    with pytest.raises(UnsupportedError, match="--convert uint16 --window"):
        ingest(tmp_path / "v.npy", tmp_path / "v.zarr")


def test_conversion_keeps_values_that_fit_and_refuses_others_by_position(tmp_path: Path) -> None:
    voxels = np.arange(4 * 5 * 6, dtype=np.int64).reshape(4, 5, 6)
    np.save(tmp_path / "v.npy", voxels)
    ingest(tmp_path / "v.npy", tmp_path / "v.zarr", codec=None, convert="uint16")
    np.testing.assert_array_equal(open_volume(tmp_path / "v.zarr").read(0), voxels)
    voxels[1, 2, 3] = -1
    np.save(tmp_path / "v.npy", voxels)
    with pytest.raises(InvalidInputError, match=r"\(1, 2, 3\) is -1.*uint16 \(0 to 65535\)"):
        ingest(tmp_path / "v.npy", tmp_path / "w.zarr", codec=None, convert="uint16")


def test_a_window_maps_its_ends_to_the_ends_of_the_type(tmp_path: Path) -> None:
    voxels = np.linspace(-2, 3, 4 * 5 * 6).reshape(4, 5, 6)
    np.save(tmp_path / "v.npy", voxels)
    ingest(tmp_path / "v.npy", tmp_path / "v.zarr", codec=None, convert="uint8", window=(-1.0, 1.0))
    stored = open_volume(tmp_path / "v.zarr").read(0)
    np.testing.assert_array_equal(stored, np.rint((np.clip(voxels, -1, 1) + 1) / 2 * 255))
    slope = open_volume(tmp_path / "v.zarr").metadata()["source"]["rescale"]
    np.testing.assert_allclose(
        stored * slope["slope"] + slope["intercept"], np.clip(voxels, -1, 1), atol=1 / 255
    )


@pytest.mark.parametrize("window", [(1.0, 1.0), (2.0, 1.0), (0.0, np.inf), (np.nan, 1.0)])
def test_a_window_that_maps_nothing_is_refused(tmp_path: Path, window: tuple[float, float]) -> None:
    np.save(tmp_path / "v.npy", smooth((4, 4, 4)))
    with pytest.raises(InvalidInputError, match="window"):
        ingest(tmp_path / "v.npy", tmp_path / "v.zarr", convert="uint8", window=window)


class SparseSource(FilmSource):
    """Knows without reading which planes hold one value, and counts what it reads."""

    nread = 0

    def _read(self, box: Box, t: int, c: int) -> np.ndarray:
        type(self).nread += box.shape_zyx[0]
        return super()._read(box, t, c)

    def _constant(self, box: Box, t: int, c: int) -> float | None:
        values = np.unique(self.voxels[(t, c, *box.slices)])
        return float(values[0]) if len(values) == 1 else None


def test_planes_that_a_sparse_source_knows_are_stored_without_reading_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    voxels = np.full((1, 2, 40, 20, 30), -7, np.int16)
    voxels[0, 1] = 5
    voxels[0, :, 16:24, 3:9, 5:25] = 100
    monkeypatch.setattr(sys.modules[ingest.__module__], "open_source", lambda *_, **__: sparse)
    monkeypatch.setattr("octobrick.store.piece_reader.READ_NBYTES", 8 * 2 * 2 * 20 * 30)
    sparse = SparseSource(voxels)
    ingest("sparse", tmp_path / "v.zarr", codec=None, brick=16)
    assert SparseSource.nread == 2 * 8
    for c in range(2):
        np.testing.assert_array_equal(open_volume(tmp_path / "v.zarr").read(0, c=c), voxels[0, c])
