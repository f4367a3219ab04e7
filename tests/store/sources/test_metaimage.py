"""MetaImage: geometry, the ways of naming data, and what is refused."""

from __future__ import annotations

import zlib

import numpy as np
import pytest

from octobrick.store.box import Box
from octobrick.store.errors import (
    SourceError,
    SourceNotFoundError,
    TruncatedSourceError,
    UnsupportedSourceError,
)
from octobrick.store.sources import open_source

BASE = {
    "ObjectType": "Image",
    "NDims": "3",
    "BinaryData": "True",
    "DimSize": "5 4 3",
    "ElementType": "MET_USHORT",
}


@pytest.fixture
def write(tmp_path, voxels):
    """Write a file of these fields (None leaves one out) and these data."""

    def write_file(data: bytes | None = None, file: str = "LOCAL", **fields: str | None):
        merged = BASE | fields | {"ElementDataFile": file}
        lines = [f"{key} = {value}\n" for key, value in merged.items() if value is not None]
        path = tmp_path / "a.mha"
        path.write_bytes("".join(lines).encode() + (voxels.tobytes() if data is None else data))
        return path

    return write_file


@pytest.mark.parametrize("key", ["TransformMatrix", "Orientation", "Rotation"])
def test_each_three_numbers_of_the_matrix_are_the_direction_of_one_axis(write, key):
    with open_source(write(**{key: "0.6 0.8 0 -0.8 0.6 0 0 0 -1"})) as source:
        expected = np.array([[0.6, 0.8, 0], [-0.8, 0.6, 0], [0, 0, -1]]).T
        np.testing.assert_allclose(source.direction, expected, atol=1e-12)


def test_no_direction_without_a_matrix(write):
    with open_source(write()) as source:
        assert source.direction is None


def test_matrix_of_zeros_is_told_and_not_used(write):
    with open_source(write(TransformMatrix="0 0 0 0 0 0 0 0 0")) as source:
        assert source.direction is None
        assert "span no space" in source.warnings[0]


@pytest.mark.parametrize(
    "fields",
    [
        {"ElementSpacing": "0.5 0.75 2"},
        {"ElementSize": "0.5 0.75 2"},
        {"ElementSpacing": "0.5 0.75 2", "ElementSize": "9 9 9"},
    ],
)
def test_spacing_comes_from_element_spacing_or_else_element_size(write, fields):
    with open_source(write(**fields)) as source:
        assert source.spacing_zyx == (2.0, 0.75, 0.5)


def test_spacing_that_is_no_size_is_replaced_and_told(write):
    with open_source(write(ElementSpacing="-0.5 0 nan")) as source:
        assert source.spacing_zyx == (1.0, 1.0, 0.5)
        assert len(source.warnings) == 3


@pytest.mark.parametrize(("given", "unit"), [("mm", "millimeter"), ("um", "micrometer")])
def test_unit_comes_from_distance_units(write, given, unit):
    with open_source(write(DistanceUnits=given)) as source:
        assert source.unit == unit


@pytest.mark.parametrize("key", ["BinaryDataByteOrderMSB", "ElementByteOrderMSB"])
def test_most_significant_byte_first_under_either_name(write, voxels, key):
    with open_source(write(voxels.astype(">u2").tobytes(), **{key: "True"})) as source:
        np.testing.assert_array_equal(source.read(Box.of_shape(source.shape_zyx)), voxels)


@pytest.mark.parametrize("file", ["LIST", "LIST 2D", "slice%03d.raw 1 3 1", "slice%d.raw 1 3 1"])
def test_several_data_files_are_refused(write, file):
    with pytest.raises(UnsupportedSourceError, match="several files"):
        open_source(write(file=file))


@pytest.mark.parametrize("nc", ["0", "-3"])
def test_no_channels_are_refused(write, nc):
    with pytest.raises(SourceError, match="at least 1"):
        open_source(write(ElementNumberOfChannels=nc))


def test_text_data_are_refused(write):
    with pytest.raises(UnsupportedSourceError, match="text"):
        open_source(write(BinaryData="False"))


def test_unknown_sample_type_is_refused_by_name(write):
    with pytest.raises(UnsupportedSourceError, match="MET_OTHER"):
        open_source(write(ElementType="MET_OTHER"))


@pytest.mark.parametrize("size", [0, -1])
def test_axis_without_voxels_is_refused_by_name(write, size):
    with pytest.raises(SourceError, match=f"axis z a size of {size}"):
        open_source(write(DimSize=f"5 4 {size}"))


def test_five_axes_are_refused_with_what_was_found(write):
    with pytest.raises(UnsupportedSourceError, match=r"5 axes of \[5, 4, 3, 2, 1\]"):
        open_source(write(NDims="5", DimSize="5 4 3 2 1"))


def test_number_of_axes_that_contradicts_sizes_is_refused(write):
    with pytest.raises(SourceError, match="NDims is 4 but DimSize has 3"):
        open_source(write(NDims="4"))


@pytest.mark.parametrize("key", ["DimSize", "ElementType"])
def test_missing_field_is_named(write, key):
    with pytest.raises(SourceError, match=f"lacks {key}"):
        open_source(write(**{key: None}))


def test_sizes_that_are_no_numbers_are_refused(write):
    with pytest.raises(SourceError, match=r"a\.mha.*MetaImage header"):
        open_source(write(DimSize="five 4 3"))


def test_header_without_data_file_is_refused(tmp_path):
    path = tmp_path / "a.mhd"
    path.write_bytes(b"ObjectType = Image\nNDims = 3\n")
    with pytest.raises(SourceError, match="ElementDataFile"):
        open_source(path)


def test_line_that_is_no_field_is_refused(write):
    path = write()
    path.write_bytes(b"ObjectType = Image\nwhat is this\n" + path.read_bytes())
    with pytest.raises(SourceError, match="what is this"):
        open_source(path)


def test_data_file_that_does_not_exist_names_it_and_the_header(write):
    with pytest.raises(SourceNotFoundError, match=r"gone\.raw.*a\.mha"):
        open_source(write(file="gone.raw"))


@pytest.mark.parametrize("name", ["", "a\x00b"])
def test_data_file_name_that_is_none_is_refused(write, name):
    with pytest.raises(SourceError, match="data file"):
        open_source(write(file=name))


def test_data_file_that_is_a_folder_is_refused(write, tmp_path):
    (tmp_path / "folder").mkdir()
    with pytest.raises(UnsupportedSourceError, match="a folder"):
        open_source(write(file="folder"))


def test_data_shorter_than_the_header_says_name_both_counts(write):
    with pytest.raises(TruncatedSourceError, match="7 of 120 bytes"):
        open_source(write(bytes(7)))


def test_local_data_counted_from_the_end_never_begin_inside_the_header(write):
    with pytest.raises(TruncatedSourceError, match="100 of 120 bytes"):
        open_source(write(bytes(100), HeaderSize="-1"))


def test_compressed_data_shorter_than_their_size_are_refused_when_opened(write, voxels):
    data = zlib.compress(voxels.tobytes())
    with pytest.raises(TruncatedSourceError, match=f"{len(data) - 5} of {len(data)} bytes"):
        open_source(write(data[:-5], CompressedData="True", CompressedDataSize=str(len(data))))


@pytest.mark.parametrize("skip", ["-2", "3"])
def test_header_size_that_is_no_place_for_data_is_refused(write, skip):
    with pytest.raises(SourceError, match="HeaderSize"):
        open_source(write(HeaderSize=skip))


def test_data_file_name_with_spaces_is_found(write, tmp_path, voxels):
    (tmp_path / "my data.raw").write_bytes(voxels.tobytes())
    with open_source(write(b"", file="my data.raw")) as source:
        np.testing.assert_array_equal(source.read(Box.of_shape(source.shape_zyx)), voxels)
