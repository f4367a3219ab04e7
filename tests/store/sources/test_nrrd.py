"""NRRD: geometry, the ways of naming data, and what is refused."""

from __future__ import annotations

import bz2
import sys

import numpy as np
import pytest

from octobrick.codec.errors import InvalidInputError, ResourceError
from octobrick.store.box import Box
from octobrick.store.errors import (
    SourceError,
    SourceNotFoundError,
    TruncatedSourceError,
    UnsupportedSourceError,
)
from octobrick.store.sources import open_source

BASE = {
    "type": "uint16",
    "dimension": "3",
    "sizes": "5 4 3",
    "encoding": "raw",
    "endian": "little",
}


@pytest.fixture
def write(tmp_path, voxels):
    """Write a file of these fields (None leaves one out) and these data."""

    def write_file(data: bytes | None = None, name: str = "a.nrrd", **fields: str | None):
        merged = BASE | {key.replace("_", " "): value for key, value in fields.items()}
        lines = [f"{key}: {value}" for key, value in merged.items() if value is not None]
        header = "\n".join(["NRRD0005", "# a comment", *lines, "key:=a value"]) + "\n\n"
        content = voxels.tobytes() if data is None else data
        path = tmp_path / name
        path.write_bytes(header.encode() + content)
        return path

    return write_file


@pytest.mark.parametrize(
    ("space", "signs"),
    [
        ("left-posterior-superior", (1, 1, 1)),
        ("LPS", (1, 1, 1)),
        ("right-anterior-superior", (-1, -1, 1)),
        ("left-anterior-superior", (1, -1, 1)),
    ],
)
def test_space_directions_give_spacing_and_direction_in_lps(write, space, signs):
    path = write(space=space, space_directions="(0.3,0.4,0) (-0.8,0.6,0) (0,0,2)")
    with open_source(path) as source:
        assert source.spacing_zyx == pytest.approx((2.0, 1.0, 0.5))
        columns = np.array([[0.6, 0.8, 0], [-0.8, 0.6, 0], [0, 0, 1]]) * signs
        np.testing.assert_allclose(source.direction, columns.T, atol=1e-12)
        assert source.warnings == ()


def test_directions_in_a_space_that_is_not_a_body_are_told_and_not_used(write):
    path = write(space="scanner-xyz", space_directions="(0,1,0) (1,0,0) (0,0,2)")
    with open_source(path) as source:
        assert source.direction is None
        assert source.spacing_zyx == (2.0, 1.0, 1.0)
        assert "scanner-xyz" in source.warnings[0]


def test_directions_that_span_no_space_are_told_and_not_used(write):
    path = write(space="LPS", space_directions="(1,0,0) (1,0,0) (0,0,2)")
    with open_source(path) as source:
        assert source.direction is None
        assert "span no space" in source.warnings[0]


def test_spacing_that_is_no_size_is_replaced_and_told(write):
    with open_source(write(spacings="0 nan -2")) as source:
        assert source.spacing_zyx == (2.0, 1.0, 1.0)
        told = [warning.split(" is ")[0] for warning in source.warnings]
        assert told == ["spacing along x", "spacing along y", "spacing along z"]


@pytest.mark.parametrize(
    ("fields", "unit"),
    [
        ({"space_units": '"mm" "mm" "mm"', "space dimension": "3"}, "millimeter"),
        ({"units": '"um" "um" "um"'}, "micrometer"),
        ({"units": '"" "" ""'}, None),
        ({}, None),
    ],
)
def test_unit_of_space(write, fields, unit):
    with open_source(write(**fields)) as source:
        assert source.unit == unit
        assert source.warnings == ()


@pytest.mark.parametrize("units", ['"mm" "mm" "cm"', '"parsec" "parsec" "parsec"'])
def test_unit_that_is_not_one_known_unit_is_told_and_not_used(write, units):
    with open_source(write(units=units)) as source:
        assert source.unit is None
        assert "unit" in source.warnings[0]


@pytest.mark.parametrize(
    ("sizes", "directions"),
    [
        ("1 5 4 3", "none (2,0,0) (0,2,0) (0,0,2)"),
        ("5 4 3 1", "(2,0,0) (0,2,0) (0,0,2) none"),
    ],
)
def test_axis_of_one_sample_outside_space_is_dropped(write, voxels, sizes, directions):
    path = write(dimension="4", sizes=sizes, space="LPS", space_directions=directions)
    with open_source(path) as source:
        assert source.spacing_zyx == (2.0, 2.0, 2.0)
        np.testing.assert_array_equal(source.read(Box.of_shape(source.shape_zyx)), voxels)


def test_the_axis_dropped_is_the_one_outside_space_even_if_another_has_one_sample(write):
    path = write(
        dimension="4",
        sizes="1 60 1 1",
        space="LPS",
        space_directions="none (2,0,0) (0,3,0) (0,0,4)",
    )
    with open_source(path) as source:
        assert source.shape_zyx == (1, 1, 60)
        assert source.spacing_zyx == (4.0, 3.0, 2.0)


@pytest.mark.parametrize(
    ("name", "dtype"), [("unsigned short int", "uint16"), ("short", "int16"), ("ushort", "uint16")]
)
def test_c_names_of_types_are_known(write, name, dtype):
    with open_source(write(type=name)) as source:
        assert source.dtype == dtype


def test_one_byte_samples_need_no_byte_order(write):
    with open_source(write(type="uchar", endian=None)) as source:
        assert source.dtype == "uint8"


def test_larger_samples_without_byte_order_are_refused(write):
    with pytest.raises(SourceError, match="endian"):
        open_source(write(endian=None))


@pytest.mark.parametrize(
    ("encoding", "data"), [("bzip2", bz2.compress(b"")), ("text", b"1 2 3"), ("hex", b"00")]
)
def test_other_encodings_are_refused_by_name(write, encoding, data):
    with pytest.raises(UnsupportedSourceError, match=f"encoded as {encoding}; raw and gzip"):
        open_source(write(data, encoding=encoding))


@pytest.mark.parametrize("files", ["LIST", "a.%03d.raw 1 3 1"])
def test_several_data_files_are_refused(write, files):
    with pytest.raises(UnsupportedSourceError, match="several files"):
        open_source(write(b"", "a.nhdr", data_file=files))


def test_data_file_that_does_not_exist_names_it_and_the_header(write):
    with pytest.raises(SourceNotFoundError, match=r"gone\.raw.*a\.nhdr"):
        open_source(write(b"", "a.nhdr", data_file="gone.raw"))


def test_data_file_in_another_folder_is_found(write, tmp_path, voxels):
    (tmp_path / "sub").mkdir()
    (tmp_path / "data.raw").write_bytes(voxels.tobytes())
    path = write(b"", "sub/a.nhdr", data_file="../data.raw")
    with open_source(path) as source:
        np.testing.assert_array_equal(source.read(Box.of_shape(source.shape_zyx)), voxels)


def test_data_file_shorter_than_the_header_says_names_both_files_and_counts(write, tmp_path):
    (tmp_path / "short.raw").write_bytes(bytes(50))
    path = write(b"", "a.nhdr", data_file="short.raw")
    with pytest.raises(
        TruncatedSourceError, match=r"short\.raw named by .*a\.nhdr: .*50 of 120 bytes"
    ):
        open_source(path)


def test_attached_data_shorter_than_the_header_says_name_both_counts(write):
    with pytest.raises(TruncatedSourceError, match="50 of 120 bytes"):
        open_source(write(bytes(50)))


def test_attached_data_counted_from_the_end_never_begin_inside_the_header(write):
    with pytest.raises(TruncatedSourceError, match="100 of 120 bytes"):
        open_source(write(bytes(100), byte_skip="-1"))


def test_line_skip_beyond_the_end_is_a_short_file(write):
    with pytest.raises(TruncatedSourceError, match="0 of 120 bytes"):
        open_source(write(line_skip="1000000000"))


@pytest.mark.parametrize("skip", [{"line_skip": "-1"}, {"byte_skip": "-2"}])
def test_impossible_skips_are_refused(write, skip):
    with pytest.raises(SourceError, match="skip is -"):
        open_source(write(**skip))


def test_byte_skip_from_the_end_of_compressed_data_is_refused(write):
    with pytest.raises(UnsupportedSourceError, match="byte skip -1"):
        open_source(write(encoding="gzip", byte_skip="-1"))


@pytest.mark.parametrize("sizes", ["5 0 3", "5 -4 3"])
def test_axis_without_voxels_is_refused_by_name(write, sizes):
    with pytest.raises(SourceError, match="axis y"):
        open_source(write(sizes=sizes))


def test_sizes_whose_product_overflows_are_a_short_file(write):
    with pytest.raises(TruncatedSourceError) as caught:
        open_source(write(sizes="4000000000 4000000000 4000000000"))
    assert caught.value.facts["expected_nbytes"] == 2 * 4_000_000_000**3


def test_size_beyond_any_integer_is_refused(write):
    with pytest.raises(SourceError, match=r"a\.nrrd"):
        open_source(write(sizes="1e300 4 3"))


@pytest.mark.parametrize("field", ["type", "dimension", "sizes", "encoding"])
def test_missing_field_is_named(write, field):
    with pytest.raises(SourceError, match=f"lacks {field}"):
        open_source(write(**{field: None}))


def test_dimension_that_contradicts_sizes_is_refused(write):
    with pytest.raises(SourceError, match="dimension 4 but 3 sizes"):
        open_source(write(dimension="4"))


def test_four_axes_that_nothing_names_are_refused_with_what_was_found(write):
    with pytest.raises(InvalidInputError, match=r"4 axes of \[5, 2, 2, 3\].*--axes tzyx"):
        open_source(write(dimension="4", sizes="5 2 2 3"))


def test_block_type_is_refused(write):
    with pytest.raises(UnsupportedSourceError, match="block"):
        open_source(write(type="block"))


def test_newer_version_of_the_format_is_refused(write):
    path = write()
    path.write_bytes(path.read_bytes().replace(b"NRRD0005", b"NRRD0009"))
    with pytest.raises(SourceError, match="version"):
        open_source(path)


def test_header_that_never_ends_is_refused_without_reading_it_all(tmp_path):
    path = tmp_path / "a.nrrd"
    path.write_bytes(b"NRRD0005\n" + b"# no end\n" * 300_000)
    with pytest.raises(SourceError, match=r"a\.nrrd"):
        open_source(path)


def test_header_without_end_and_data_file_is_refused(write):
    path = write(b"")
    path.write_bytes(path.read_bytes().rstrip(b"\n"))
    with pytest.raises(SourceError, match="no blank line"):
        open_source(path)


def test_windows_line_ends_are_read(write, voxels):
    path = write(b"")
    path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n") + voxels.tobytes())
    with open_source(path) as source:
        np.testing.assert_array_equal(source.read(Box.of_shape(source.shape_zyx)), voxels)


def test_control_characters_of_a_header_do_not_reach_the_message(write):
    with pytest.raises(UnsupportedSourceError) as caught:
        open_source(write(encoding="\x1b[31mred"))
    assert "\x1b" not in caught.value.message


def test_missing_pynrrd_names_the_extra_to_install(write, monkeypatch):
    monkeypatch.setitem(sys.modules, "nrrd", None)
    with pytest.raises(ResourceError, match=r"pip install 'octobrick\[formats\]'"):
        open_source(write())
