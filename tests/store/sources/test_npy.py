"""npy: what is refused. That its orders are read right is in the contract."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from octobrick.codec.errors import InvalidInputError
from octobrick.store.box import Box
from octobrick.store.errors import SourceError, TruncatedSourceError, UnsupportedSourceError
from octobrick.store.sources import open_source
from octobrick.store.sources.axes import axes_of


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


@pytest.mark.parametrize("shape", [(), (3,)])
def test_arrays_that_are_no_volume_are_refused_with_what_was_found(save, shape):
    with pytest.raises(UnsupportedSourceError, match=f"{len(shape)} axes"):
        open_source(save(np.zeros(shape, np.uint8)))


@pytest.mark.parametrize("shape", [(3, 4), (2, 3, 4, 5)])
def test_axes_of_other_than_three_are_asked_for(save, shape):
    with pytest.raises(InvalidInputError, match=rf"{len(shape)} axes .*--axes tzyx"):
        open_source(save(np.zeros(shape, np.uint8)))


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("letters", ["tczyx", "zyxs", "ztyx", "xyzct", "tsyx", "yx", "cxzy"])
def test_any_axes_in_any_order_are_read(save, buffers, letters, order):
    sizes = {"t": 2, "c": 2, "s": 3, "z": 4, "y": 5, "x": 37}
    shape = [sizes[letter] for letter in letters]
    array = np.random.default_rng(2).integers(0, 999, shape, np.uint16)
    axes = axes_of(shape, letters, Path("a"))
    box = Box((0, 1, 3), (min(3, axes.shape_zyx[0]), 4, 30))
    with open_source(save(np.asarray(array, order=order)), axes=letters) as source:
        assert (source.nt, source.nc, source.shape_zyx) == (axes.nt, axes.nc, axes.shape_zyx)
        assert source.is_rgb == ("s" in letters)
        for part in (box, Box.of_shape(axes.shape_zyx)):
            for t in range(source.nt):
                expected = axes.to_czyx(array[axes.index(part, t, None)])
                read = source.read_channels(part, t)
                np.testing.assert_array_equal(read, expected)
                for c in range(source.nc):
                    np.testing.assert_array_equal(source.read(part, t, c), expected[c])


def test_a_dataset_is_refused_where_there_is_one_array(save, voxels):
    with pytest.raises(InvalidInputError, match="leave out --dataset"):
        open_source(save(voxels), dataset="a")


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
