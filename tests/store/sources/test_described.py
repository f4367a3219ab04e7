"""Raw voxels: descriptions by options and by a file beside them, and what is refused."""

from __future__ import annotations

import json

import numpy as np
import pytest

from octobrick.codec.errors import InvalidInputError
from octobrick.store.box import Box
from octobrick.store.errors import SourceError, TruncatedSourceError
from octobrick.store.sources import open_source


@pytest.fixture
def raw(tmp_path, voxels):
    path = tmp_path / "a.raw"
    path.write_bytes(voxels.tobytes())
    return path


def read_all(source):
    return source.read(Box.of_shape(source.shape_zyx))


@pytest.mark.parametrize(
    ("options", "lacking"),
    [
        ({}, "shape and type"),
        ({"shape_zyx": (3, 4, 5)}, "the type"),
        ({"dtype": "uint16"}, "the shape"),
    ],
)
def test_raw_file_without_description_says_which_options_to_give(raw, options, lacking):
    with pytest.raises(InvalidInputError, match=rf"{lacking}.*--shape Z,Y,X --dtype uint16"):
        open_source(raw, **options)


@pytest.mark.parametrize("dtype", ["uint16", "u2", "<u2", np.uint16, np.dtype("uint16")])
def test_type_may_be_given_as_numpy_does(raw, voxels, dtype):
    with open_source(raw, shape_zyx=(3, 4, 5), dtype=dtype) as source:
        np.testing.assert_array_equal(read_all(source), voxels)


@pytest.mark.parametrize("options", [{"dtype": ">u2"}, {"dtype": "u2", "big_endian": True}])
def test_byte_order_may_be_given_in_two_ways(raw, voxels, options):
    with open_source(raw, shape_zyx=(3, 4, 5), **options) as source:
        np.testing.assert_array_equal(read_all(source), voxels.byteswap())


@pytest.mark.parametrize("dtype", ["uint17", "", "O", "voxels", "u2,u2", "\x1b[31m"])
def test_unknown_type_is_refused_with_those_that_are_read(raw, dtype):
    with pytest.raises(InvalidInputError, match=r"no sample type.*uint8, int8, uint16") as caught:
        open_source(raw, shape_zyx=(3, 4, 5), dtype=dtype)
    assert "\x1b" not in caught.value.message


@pytest.mark.parametrize(("code", "name"), [("i2", "int16"), ("f2", "float16"), ("<u2", "uint16")])
def test_type_may_be_given_by_numpys_code(raw, code, name):
    with open_source(raw, shape_zyx=(3, 4, 5), dtype=code) as source:
        assert source.dtype == name


def test_bytes_of_bool_that_are_neither_0_nor_1_are_true(tmp_path):
    (tmp_path / "a.raw").write_bytes(bytes([0, 1, 2, 255]))
    with open_source(tmp_path / "a.raw", shape_zyx=(1, 1, 4), dtype="bool") as source:
        assert read_all(source).view(np.uint8).ravel().tolist() == [0, 1, 1, 1]


@pytest.mark.parametrize("shape", [(0, 4, 5), (3, -4, 5), (3, 4), (1, 3, 4, 5), ()])
def test_shape_that_is_no_volume_is_refused(raw, shape):
    with pytest.raises(InvalidInputError, match="the shape is"):
        open_source(raw, shape_zyx=shape, dtype="uint16")


@pytest.mark.parametrize("spacing", [(0, 1, 1), (1, np.nan, 1), (1, 1, np.inf), (-1, 1, 1), (1, 1)])
def test_spacing_that_is_no_size_is_refused(raw, spacing):
    with pytest.raises(InvalidInputError, match="the spacing is"):
        open_source(raw, shape_zyx=(3, 4, 5), dtype="uint16", spacing_zyx=spacing)


def test_offset_before_the_file_is_refused(raw):
    with pytest.raises(InvalidInputError, match="offset is -1"):
        open_source(raw, shape_zyx=(3, 4, 5), dtype="uint16", offset_nbytes=-1)


@pytest.mark.parametrize(
    ("options", "have", "need"),
    [
        ({"shape_zyx": (30, 4, 5)}, 120, 1200),
        ({"shape_zyx": (3, 4, 5), "offset_nbytes": 10}, 110, 120),
        ({"shape_zyx": (3, 4, 5), "offset_nbytes": 10**30}, 0, 120),
        ({"shape_zyx": (10**20, 10**20, 5)}, 120, 10**41),
    ],
)
def test_shape_larger_than_the_file_names_both_byte_counts(raw, options, have, need):
    with pytest.raises(
        TruncatedSourceError,
        match=rf"a\.raw.*{have} of {need} bytes.*check shape, dtype and offset",
    ):
        open_source(raw, dtype="uint16", **options)


def test_bytes_behind_the_last_voxel_are_told(raw):
    with open_source(raw, shape_zyx=(2, 4, 5), dtype="uint16") as source:
        assert "40 bytes follow" in source.warnings[0]


def test_file_cut_short_while_open_is_an_error_and_no_crash(raw):
    with open_source(raw, shape_zyx=(3, 4, 5), dtype="uint16") as source:
        raw.write_bytes(bytes(50))
        with pytest.raises(TruncatedSourceError, match="cut short since"):
            read_all(source)


def test_empty_file_is_refused(tmp_path):
    (tmp_path / "a.raw").write_bytes(b"")
    with pytest.raises(TruncatedSourceError, match="0 of 8 bytes"):
        open_source(tmp_path / "a.raw", shape_zyx=(2, 2, 2), dtype="uint8")


def test_gzip_name_without_gzip_data_is_refused(tmp_path):
    (tmp_path / "a.raw.gz").write_bytes(bytes(100))
    with pytest.raises(SourceError, match="no gzip data"):
        open_source(tmp_path / "a.raw.gz", shape_zyx=(2, 2, 2), dtype="uint8")


@pytest.mark.parametrize("name", ["a.json", "a.raw.json"])
def test_description_beside_the_file_is_used(raw, voxels, tmp_path, name):
    content = {
        "shape_zyx": [3, 4, 4],
        "dtype": "uint16",
        "endian": "big",
        "spacing": [3, 2, 1],
        "offset_nbytes": 4,
        "made_by": "someone",
    }
    (tmp_path / name).write_text(json.dumps(content))
    with open_source(raw) as source:
        assert source.spacing_zyx == (3.0, 2.0, 1.0)
        expected = voxels.byteswap().reshape(-1)[2:50].reshape(3, 4, 4)
        np.testing.assert_array_equal(read_all(source), expected)


def test_options_win_over_the_description_beside_the_file(raw, tmp_path):
    (tmp_path / "a.json").write_text('{"shape": [9, 9, 9], "dtype": "uint16"}')
    with open_source(raw, shape_zyx=(3, 4, 5)) as source:
        assert source.shape_zyx == (3, 4, 5)
        assert source.dtype == "uint16"


def test_description_beside_the_file_is_not_read_where_options_say_all(raw, tmp_path):
    (tmp_path / "a.json").write_text("no JSON at all")
    with open_source(raw, shape_zyx=(3, 4, 5), dtype="uint16") as source:
        assert source.shape_zyx == (3, 4, 5)


@pytest.mark.parametrize(
    "text",
    [
        "{",
        "[3, 4, 5]",
        '{"shape": "3,4,5", "dtype": "uint16"}',
        '{"shape": [3, 4, true], "dtype": "uint16"}',
        '{"shape": [3, 4, 5.5], "dtype": "uint16"}',
        '{"shape": [3, 4, 5], "dtype": 16}',
        '{"shape": [3, 4, 5], "dtype": "uint16", "endian": "middle"}',
        '{"shape": [3, 4, 5], "dtype": "uint16", "offset_nbytes": "x"}',
        "[" * 200_000,
        "\udcff",
    ],
)
def test_description_that_makes_no_sense_is_refused_by_its_own_name(raw, tmp_path, text):
    (tmp_path / "a.json").write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(SourceError, match=r"a\.json"):
        open_source(raw)


def test_description_of_something_else_says_which_options_to_give(raw, tmp_path):
    (tmp_path / "a.json").write_text('{"patient": "anonymous"}')
    with pytest.raises(InvalidInputError, match="--shape"):
        open_source(raw)
