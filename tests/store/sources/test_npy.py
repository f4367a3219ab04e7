"""npy: what is refused. That its orders are read right is in the contract."""

from __future__ import annotations

import numpy as np
import pytest

from octobrick.store.box import Box
from octobrick.store.errors import SourceError, TruncatedSourceError, UnsupportedSourceError
from octobrick.store.sources import open_source


@pytest.fixture
def save(tmp_path):
    def save_array(array: np.ndarray):
        np.save(tmp_path / "a.npy", array)
        return tmp_path / "a.npy"

    return save_array


def test_version_2_of_the_format_is_read(tmp_path, voxels):
    with (tmp_path / "a.npy").open("wb") as file:
        np.lib.format.write_array(file, voxels, version=(2, 0))
    with open_source(tmp_path / "a.npy") as source:
        np.testing.assert_array_equal(source.read(Box.of_shape(source.shape_zyx)), voxels)


@pytest.mark.parametrize("shape", [(), (3,), (3, 4), (2, 3, 4, 5)])
def test_other_numbers_of_axes_are_refused_with_what_was_found(save, shape):
    with pytest.raises(UnsupportedSourceError, match=f"{len(shape)} axes"):
        open_source(save(np.zeros(shape, np.uint8)))


@pytest.mark.parametrize("shape", [(0, 4, 5), (3, 0, 5), (3, 4, 0)])
def test_axis_without_voxels_is_refused_by_name(save, shape):
    with pytest.raises(SourceError, match=f"axis {'zyx'[shape.index(0)]} a size of 0"):
        open_source(save(np.zeros(shape, np.uint8)))


@pytest.mark.parametrize("dtype", ["complex64", "U3", "u1,u1,u1"])
def test_samples_that_are_no_scalars_are_refused(save, dtype):
    with pytest.raises(UnsupportedSourceError, match="one scalar component"):
        open_source(save(np.zeros((2, 2, 2), dtype)))


def test_data_shorter_than_the_header_says_name_both_counts(save, voxels):
    path = save(voxels)
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(TruncatedSourceError, match=r"a\.npy.*119 of 120 bytes"):
        open_source(path)


def test_header_that_is_no_literal_is_refused_and_not_run(tmp_path):
    header = b"__import__('os').abort()".ljust(117) + b"\n"
    path = tmp_path / "a.npy"
    path.write_bytes(b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header)
    with pytest.raises(SourceError, match=r"a\.npy.*npy header"):
        open_source(path)


def test_objects_are_refused_and_not_unpickled(tmp_path):
    array = np.empty((2, 2, 2), object)
    np.save(tmp_path / "a.npy", array, allow_pickle=True)
    with pytest.raises(UnsupportedSourceError, match="object"):
        open_source(tmp_path / "a.npy")


def test_another_file_under_this_name_is_refused(tmp_path):
    (tmp_path / "a.npy").write_bytes(b"not numpy's")
    with pytest.raises(SourceError, match=r"a\.npy"):
        open_source(tmp_path / "a.npy")
