"""What write_vdb keeps, refuses and leaves behind."""

from __future__ import annotations

import resource
import signal

import numpy as np
import pytest

from octobrick.codec.errors import InvalidInputError, ResourceError
from octobrick.store.box import Box
from octobrick.store.errors import DestinationError
from octobrick.store.sources import open_source
from octobrick.store.vdb_writer import write_vdb

ONE = np.ones((1, 1, 1), np.float32)


@pytest.fixture
def extension():
    return pytest.importorskip("octobrick.store._vdb")


def read_all(path):
    with open_source(path) as source:
        return source.read(Box.of_shape(source.shape_zyx))


def test_values_outside_the_range_and_nan_are_left_out(extension, tmp_path):
    voxels = np.array([[[1, 2, np.nan, 3, 4, 2]]], np.float32)
    count = write_vdb(
        tmp_path / "a.vdb", [((0, 0, 0), voxels)], dtype="float32", active=(2, 3), background=-5
    )
    assert count == 3
    assert read_all(tmp_path / "a.vdb").ravel().tolist() == [2, -5, 3, -5, 2]


def test_later_boxes_win_where_boxes_overlap(extension, tmp_path):
    boxes = [((0, 0, 0), np.ones((1, 1, 3), np.int16)), ((0, 0, 2), np.full((1, 1, 3), 7, "i2"))]
    write_vdb(tmp_path / "a.vdb", boxes, dtype="int16")
    assert read_all(tmp_path / "a.vdb").ravel().tolist() == [1, 1, 7, 7, 7]


def test_constant_regions_become_tiles(extension, tmp_path):
    voxels = np.ones((128, 128, 128), np.float32)
    write_vdb(tmp_path / "a.vdb", [((0, 0, 0), voxels)], dtype="float32")
    file = extension.list_grids(str(tmp_path / "a.vdb"))
    assert file.grids[0].active_voxels == voxels.size
    assert extension.load_grid(str(tmp_path / "a.vdb"), file, 0).leaves == 0


def test_half_is_smaller_and_close(extension, tmp_path):
    voxels = np.random.default_rng(1).random((16, 16, 16), np.float32)
    for half in (False, True):
        write_vdb(tmp_path / f"{half}.vdb", [((0, 0, 0), voxels)], dtype="float32", half=half)
    assert (tmp_path / "True.vdb").stat().st_size < (tmp_path / "False.vdb").stat().st_size
    np.testing.assert_array_equal(read_all(tmp_path / "True.vdb"), voxels.astype(np.float16))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"dtype": "uint64"}, "no OpenVDB grid holds uint64"),
        ({"dtype": "float32", "active": (2, 1)}, "active values from 2 to 1"),
        ({"dtype": "float32", "active": (float("nan"), 1)}, "active values from nan"),
        ({"dtype": "float32", "spacing_zyx": (1, 0, 1)}, "spacing"),
        ({"dtype": "float32", "origin_xyz": (1, float("inf"), 1)}, "origin"),
        ({"dtype": "float64"}, "a box is float32 with 3 axes; expected float64"),
    ],
)
def test_what_makes_no_sense_is_refused_and_nothing_is_left(extension, tmp_path, options, message):
    with pytest.raises(InvalidInputError, match=message):
        write_vdb(tmp_path / "a.vdb", [((0, 0, 0), ONE)], **options)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("place", [1 << 31, -(1 << 40), (1 << 30) + 5000])
def test_box_beyond_the_index_space_is_refused(extension, tmp_path, place):
    with pytest.raises(InvalidInputError, match="indices are within 2"):
        write_vdb(tmp_path / "a.vdb", [((0, 0, place), ONE)], dtype="float32")


def test_folder_that_does_not_exist_is_named(extension, tmp_path):
    with pytest.raises(DestinationError, match=r"gone/a\.vdb: cannot be written"):
        write_vdb(tmp_path / "gone" / "a.vdb", [((0, 0, 0), ONE)], dtype="float32")


def test_no_room_leaves_the_old_file_and_nothing_else(extension, tmp_path):
    path = tmp_path / "a.vdb"
    path.write_bytes(b"old")
    voxels = np.random.default_rng(1).random((64, 64, 64), np.float32)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, limits[1]))
        with pytest.raises(DestinationError, match=r"a\.vdb: cannot be written"):
            write_vdb(path, [((0, 0, 0), voxels)], dtype="float32")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_without_the_extension_the_remedy_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "octobrick.store._vdb", None)
    with pytest.raises(ResourceError, match="apt-get install libopenvdb-dev"):
        write_vdb(tmp_path / "a.vdb", [], dtype="float32")
