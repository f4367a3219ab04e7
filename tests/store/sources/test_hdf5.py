"""HDF5: which dataset is read and as what, and what would lead out of the file."""

from __future__ import annotations

import sys

import h5py
import numpy as np
import pytest

from octobrick.codec.errors import InvalidInputError, ResourceError
from octobrick.store.box import Box
from octobrick.store.errors import SourceError, TruncatedSourceError, UnsupportedSourceError
from octobrick.store.sources import open_source


@pytest.fixture
def file(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as made:
        yield made


@pytest.fixture
def opened(file, tmp_path):
    """Opens what a test has put into the file."""

    def open_it(**options):
        file.close()
        return open_source(tmp_path / "a.h5", **options)

    return open_it


def read_all(source):
    return source.read(Box.of_shape(source.shape_zyx))


def test_the_only_dataset_of_three_axes_is_found(file, opened, voxels):
    file["table"] = np.zeros((5, 2))
    file["deep/er/volume"] = voxels
    with opened() as source:
        assert source.format == "hdf5"
        assert source.chunk_zyx is None
        np.testing.assert_array_equal(read_all(source), voxels)


def test_several_datasets_are_refused_with_paths_and_shapes(file, opened, voxels):
    file["one"], file["two/three"] = voxels, voxels.astype(np.float32)
    with pytest.raises(
        InvalidInputError, match=r"one \[3, 4, 5\] uint16, two/three \[3, 4, 5\] float32.*--dataset"
    ):
        opened()


def test_no_dataset_is_refused(file, opened):
    file["table"] = np.zeros((5, 2))
    with pytest.raises(UnsupportedSourceError, match="no dataset of 3 or more axes"):
        opened()


@pytest.mark.parametrize("name", ["nothing", "group", "volume/deeper", ""])
def test_a_path_without_a_dataset_is_refused(file, opened, voxels, name):
    file["volume"] = voxels
    file.create_group("group")
    with pytest.raises(InvalidInputError, match="no dataset at"):
        opened(dataset=name)


def test_time_channels_and_chunks(file, opened):
    array = np.random.default_rng(4).integers(0, 99, (2, 4, 5, 6, 3), np.int16)
    file.create_dataset("v", data=array, chunks=(1, 2, 5, 100, 3), maxshape=(2, 4, 5, None, 3))
    with opened(axes="tzyxs") as source:
        assert (source.nt, source.nc, source.is_rgb, source.chunk_zyx) == (2, 3, True, (2, 5, 6))
        box = Box((1, 0, 2), (3, 4, 6))
        read = source.read_channels(box, 1)
        np.testing.assert_array_equal(read, np.moveaxis(array[1, 1:3, 0:4, 2:6], -1, 0))
        np.testing.assert_array_equal(source.read(box, 1, 2), read[2])


def test_axes_come_from_dimension_labels(file, opened, voxels):
    file["v"] = voxels.T
    for dimension, label in zip(file["v"].dims, "xyz", strict=True):
        dimension.label = label
    with opened() as source:
        np.testing.assert_array_equal(read_all(source), voxels)


@pytest.mark.parametrize(
    ("name", "value", "spacing", "unit"),
    [
        ("element_size_um", (3.0, 2.0, 1.0), (3, 2, 1), "micrometer"),
        ("resolution", (40, 4, 4), (40, 4, 4), None),
        ("resolution", "40 nm", (1, 1, 1), None),
        ("element_size_um", (1.0, 2.0), (1, 1, 1), None),
    ],
)
def test_spacing_comes_from_attributes(file, opened, voxels, name, value, spacing, unit):
    file["v"] = voxels
    file["v"].attrs[name] = value
    with opened() as source:
        assert (source.spacing_zyx, source.unit) == (spacing, unit)
        assert bool(source.warnings) == (spacing == (1, 1, 1))


def test_links_inside_the_file_are_followed(file, opened, voxels):
    file["group/volume"] = voxels
    file["soft"] = h5py.SoftLink("/group")
    file["group/again"] = h5py.SoftLink("volume")
    with opened(dataset="soft/again") as source:
        np.testing.assert_array_equal(read_all(source), voxels)


def test_links_that_go_in_circles_end(file, opened):
    file["a"], file["b"] = h5py.SoftLink("/b"), h5py.SoftLink("/a")
    with pytest.raises(SourceError, match="more than 32 links"):
        opened(dataset="a")


@pytest.mark.parametrize("dataset", ["out", "soft", "external", "virtual"])
def test_what_leads_out_of_the_file_is_refused(file, opened, tmp_path, voxels, dataset):
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["v"] = voxels
    file["out"] = h5py.ExternalLink("other.h5", "/v")
    file["soft"] = h5py.SoftLink("/out")
    (tmp_path / "secret").write_bytes(bytes(120))
    file.create_dataset(
        "external", (3, 4, 5), np.uint16, external=[(str(tmp_path / "secret"), 0, 120)]
    )
    layout = h5py.VirtualLayout((3, 4, 5), np.uint16)
    layout[:] = h5py.VirtualSource(tmp_path / "other.h5", "v", (3, 4, 5))
    file.create_virtual_dataset("virtual", layout)
    with pytest.raises(UnsupportedSourceError, match="outside this file"):
        opened(dataset=dataset)


def test_chunks_larger_than_any_sensible_one_are_refused(file, opened):
    file.create_dataset("v", (2000, 2000, 2000), np.uint8, chunks=(1100, 1000, 1000))
    with pytest.raises(UnsupportedSourceError, match="1100000000 bytes each"):
        opened()


@pytest.mark.parametrize("dtype", ["complex64", "S5", [("a", "u1"), ("b", "f4")]])
def test_samples_that_are_no_scalars_are_refused(file, opened, dtype):
    file["v"] = np.zeros((2, 2, 2), dtype)
    with pytest.raises(UnsupportedSourceError, match="voxels are"):
        opened(dataset="v")


def test_a_file_that_is_cut_short_says_so(file, tmp_path, opened, voxels):
    file["v"] = voxels
    file.close()
    path = tmp_path / "a.h5"
    path.write_bytes(path.read_bytes()[:-50])
    with pytest.raises(TruncatedSourceError, match="cut short"):
        open_source(path)


def test_a_damaged_chunk_is_an_error_that_names_the_box(file, tmp_path):
    file.create_dataset("v", data=np.ones((4, 4, 4)), chunks=(4, 4, 4), fletcher32=True)
    start = file["v"].id.get_chunk_info(0).byte_offset
    file.close()
    content = bytearray((tmp_path / "a.h5").read_bytes())
    content[start] ^= 255
    (tmp_path / "a.h5").write_bytes(content)
    with (
        open_source(tmp_path / "a.h5") as source,
        pytest.raises(SourceError, match=r"box \(0, 0, 0\) to \(4, 4, 4\)"),
    ):
        read_all(source)


def test_without_the_package_the_error_names_the_extra(file, opened, monkeypatch, voxels):
    file["v"] = voxels
    file.close()
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(ResourceError, match=r"h5py.*octobrick\[formats\]"):
        opened()
