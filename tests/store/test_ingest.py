from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from octobrick.codec import S3dc, metrics, reference
from octobrick.codec.errors import InvalidInputError, NotFiniteError
from octobrick.store import Box, Progress, Volume, ingest, open_volume
from octobrick.store.errors import IncompleteVolumeError

from .conftest import smooth

Ingested = Callable[..., Volume]
DTYPES = ["uint8", "int8", "uint16", "int16", "float32"]


def files_of(folder: Path) -> dict[str, str]:
    return {
        str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest()
        for p in folder.rglob("*")
        if p.is_file()
    }


@pytest.mark.parametrize("dtype", DTYPES)
def test_a_lossless_volume_holds_every_voxel_of_every_level(ingested: Ingested, dtype: str) -> None:
    voxels = smooth((37, 50, 41), dtype)
    volume = ingested(voxels, codec=None, brick=16, shard=2)
    expected = voxels
    for level in volume.levels:
        np.testing.assert_array_equal(volume.read(level.index), expected, strict=True)
        assert level.max_error == 0
        assert level.psnr_db is None
        expected = reference.mean2(expected)
    assert volume.levels[-1].shape_zyx == (10, 13, 11)


@pytest.mark.parametrize("dtype", DTYPES)
def test_an_s3dc_volume_decodes_each_brick_as_the_reference_does(
    ingested: Ingested, dtype: str
) -> None:
    voxels = smooth((20, 33, 17), dtype)
    volume = ingested(voxels, codec=S3dc(block=(4, 8, 4), bits=3), brick=16)
    padded = np.pad(voxels, ((0, 12), (0, 15), (0, 15)), mode="edge")
    for z, y, x in np.ndindex(*volume.level(0).grid_zyx):
        brick = padded[16 * z : 16 * z + 16, 16 * y : 16 * y + 16, 16 * x : 16 * x + 16]
        code = reference.encode(brick, (4, 8, 4), 3)
        expected = reference.decode(code, brick.shape, brick.dtype, (4, 8, 4), 3)
        np.testing.assert_array_equal(volume.brick(0, (z, y, x)), expected, strict=True)
        assert volume.brick_code(0, (z, y, x)) == code


def test_ranges_bound_each_brick_and_the_voxels_around_it(ingested: Ingested) -> None:
    voxels = smooth((37, 50, 41), "int16")
    volume = ingested(voxels, brick=16)
    ranges = volume.ranges(0)
    assert ranges.dtype == np.int16
    for z, y, x in np.ndindex(*volume.level(0).grid_zyx):
        box = Box((16 * z, 16 * y, 16 * x), (16 * z + 16, 16 * y + 16, 16 * x + 16))
        around = voxels[box.grow(1).intersect(Box.of_shape(voxels.shape)).slices]
        assert ranges[z, y, x].tolist() == [around.min(), around.max()]
    assert volume.value_range == (voxels.min(), voxels.max())


@pytest.mark.parametrize("dtype", ["uint8", "float32"])
def test_fidelity_is_the_measured_error_of_each_brick_and_level(
    ingested: Ingested, dtype: str
) -> None:
    voxels = smooth((37, 50, 41), dtype)
    volume = ingested(voxels, codec=S3dc(bits=2), brick=16)
    for level in volume.levels:
        decoded = volume.read(level.index)
        errors = metrics.compare(voxels, decoded)
        assert level.max_error == errors.max_abs > 0
        assert level.psnr_db == pytest.approx(errors.psnr(float(np.ptp(voxels))))
        fidelity = volume.fidelity(level.index)
        assert fidelity[..., 0].max() >= errors.max_abs
        first = metrics.compare(voxels[:16, :16, :16], decoded[:16, :16, :16])
        assert fidelity[0, 0, 0] == pytest.approx([first.max_abs, first.rmse])
        voxels = reference.mean2(voxels)


def test_bricks_of_fill_are_absent_and_shards_of_absent_bricks_are_not_stored(
    ingested: Ingested,
) -> None:
    voxels = np.zeros((64, 16, 16), np.uint8)
    voxels[3, 3, 3] = 7
    volume = ingested(voxels, brick=16, shard=1, levels=1)
    assert volume.brick_code(0, (0, 0, 0)) is not None
    assert volume.brick_code(0, (1, 0, 0)) is None
    assert not volume.brick(0, (3, 0, 0)).any()
    assert len(list((volume.path / "0").rglob("c/*/*/*/*/*"))) == 1


def test_minus_zero_is_not_lost_as_fill(ingested: Ingested) -> None:
    volume = ingested(np.full((8, 8, 8), -0.0, np.float32), codec=None, brick=8)
    assert np.signbit(volume.read(0)).all()


def test_one_voxel_is_a_volume(ingested: Ingested) -> None:
    volume = ingested(np.full((1, 1, 1), 42, np.uint8))
    assert volume.read(0).tolist() == [[[42]]]
    assert len(volume.levels) == 1
    assert volume.value_range == (42, 42)


def test_bytes_depend_on_neither_workers_nor_time_nor_name(ingested: Ingested) -> None:
    voxels = smooth((70, 40, 40))
    a = ingested(voxels, name="a", brick=16, shard=2, workers=1)
    b = ingested(voxels, name="b", brick=16, shard=2, workers=3)
    differing = {k for k, v in files_of(a.path).items() if files_of(b.path)[k] != v}
    assert set(files_of(a.path)) == set(files_of(b.path))
    assert differing == {"zarr.json"}  # the OME name and the source's file name stand there


def test_the_revision_names_the_content(ingested: Ingested, tmp_path: Path) -> None:
    voxels = smooth((20, 20, 20))
    a = ingested(voxels, name="a")
    ingest(tmp_path / "a.npy", tmp_path / "again.zarr")
    changed = voxels.copy()
    changed[0, 0, 0] ^= 0x4000
    assert open_volume(tmp_path / "again.zarr").revision == a.revision
    np.save(tmp_path / "a.npy", changed)
    ingest(tmp_path / "a.npy", tmp_path / "changed.zarr")
    assert open_volume(tmp_path / "changed.zarr").revision != a.revision


def test_progress_ends_at_the_last_voxel_with_rate_and_memory(tmp_path: Path) -> None:
    np.save(tmp_path / "v.npy", smooth((40, 512, 512)))
    moments: list[Progress] = []
    result = ingest(tmp_path / "v.npy", tmp_path / "v.zarr", progress=moments.append)
    done = [moment.done_voxels for moment in moments]
    assert done == sorted(done)
    assert len(done) > 1
    assert done[-1] == moments[-1].total_voxels == 40 * 512 * 512
    assert moments[-1].voxels_per_second > 0
    assert moments[-1].eta_seconds == 0
    assert 0 < moments[-1].rss_nbytes <= result.peak_rss_nbytes


def test_the_result_is_json_and_agrees_with_the_volume(tmp_path: Path) -> None:
    voxels = smooth((40, 70, 50), "uint8")
    np.save(tmp_path / "v.npy", voxels)
    result = ingest(tmp_path / "v.npy", tmp_path / "v.zarr", spacing=(2.0, 1.0, 0.5))
    volume = open_volume(tmp_path / "v.zarr")
    report = json.loads(json.dumps(result.to_dict()))
    assert report["revision"] == volume.revision
    assert [level["shape_zyx"] for level in report["levels"]] == [[40, 70, 50], [20, 35, 25]]
    assert report["levels"][0]["nbytes"] == voxels.nbytes
    stored = sum(p.stat().st_size for p in (volume.path / "0" / "c").rglob("*") if p.is_file())
    assert report["levels"][0]["stored_nbytes"] == stored == volume.level(0).stored_nbytes
    assert volume.level(0).spacing_xyz == (0.5, 1.0, 2.0)
    assert volume.level(1).spacing_xyz == (1.0, 2.0, 4.0)
    assert volume.level(1).origin_xyz == (0.25, 0.5, 1.0)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_value_that_is_not_finite_is_refused_with_its_position(
    tmp_path: Path, value: float
) -> None:
    voxels = smooth((20, 30, 40), "float32")
    voxels[17, 2, 39] = value
    np.save(tmp_path / "v.npy", voxels)
    with pytest.raises(NotFiniteError, match=r"v\.npy.*\(17, 2, 39\)") as caught:
        ingest(tmp_path / "v.npy", tmp_path / "v.zarr")
    assert caught.value.facts["voxel_zyx"] == [17, 2, 39]
    assert [p.name for p in tmp_path.iterdir()] == ["v.npy"]


def test_values_that_are_not_finite_are_replaced_when_told_by_what(tmp_path: Path) -> None:
    voxels = smooth((20, 30, 40), "float32")
    voxels[3, 2, 1] = np.nan
    np.save(tmp_path / "v.npy", voxels)
    ingest(tmp_path / "v.npy", tmp_path / "v.zarr", codec=None, replace_nonfinite=-7.5)
    assert open_volume(tmp_path / "v.zarr").read(0)[3, 2, 1] == -7.5


@pytest.mark.parametrize(
    "options",
    [{"brick": 7}, {"brick": 512}, {"brick": 33}, {"shard": 0}, {"zstd_level": 0}, {"levels": 0}],
)
def test_an_option_out_of_its_bounds_is_refused_before_anything_is_written(
    tmp_path: Path, options: dict[str, int]
) -> None:
    np.save(tmp_path / "v.npy", smooth((4, 4, 4)))
    with pytest.raises(InvalidInputError, match=next(iter(options))):
        ingest(tmp_path / "v.npy", tmp_path / "v.zarr", **options)  # type: ignore[arg-type]
    assert [p.name for p in tmp_path.iterdir()] == ["v.npy"]


KILLED = """
import os, signal, sys
from octobrick.store import ingest

def die_half_way(moment):
    if moment.done_voxels * 2 >= moment.total_voxels:
        os.kill(os.getpid(), signal.SIGKILL)

ingest(sys.argv[1], sys.argv[2], brick=16, progress=die_half_way)
"""


def test_an_ingest_killed_half_way_leaves_no_volume_and_the_next_one_succeeds(
    tmp_path: Path,
) -> None:
    voxels = smooth((64, 512, 512), "uint16")
    np.save(tmp_path / "v.npy", voxels)
    source, dest = tmp_path / "v.npy", tmp_path / "v.zarr"
    killed = subprocess.run([sys.executable, "-c", KILLED, source, dest], check=False)
    assert killed.returncode == -9
    assert not dest.exists()
    with pytest.raises(IncompleteVolumeError, match="did not finish"):
        open_volume(dest)
    ingest(source, dest, codec=None)
    np.testing.assert_array_equal(open_volume(dest).read(0), voxels)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["v.npy", "v.zarr"]


def test_a_window_between_the_ends_of_float32_is_finite(ingested: Ingested) -> None:
    """The percentile once lay between −3.4e38 and 3.4e38, whose difference float32 cannot hold."""
    greatest = np.finfo(np.float32).max
    voxels = np.full((10, 10, 10), -greatest, np.float32)
    voxels[0, 0, 0] = greatest
    low, high = ingested(voxels, codec=None).window
    assert -greatest == low < high <= greatest
