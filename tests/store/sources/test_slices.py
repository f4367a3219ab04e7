"""Folders and patterns of pictures: order, sizes, colours, and what is refused."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import imagecodecs
import numpy as np
import pytest
import tifffile
from PIL import Image

from octobrick.codec.errors import InvalidInputError
from octobrick.store.box import Box
from octobrick.store.errors import SourceError, TruncatedSourceError, UnsupportedSourceError
from octobrick.store.sources import open_source
from octobrick.store.sources.several import natural_key


def planes(*shape: int, dtype: str = "uint8") -> np.ndarray:
    return np.random.default_rng(6).integers(0, np.iinfo(dtype).max, shape).astype(dtype)


def write(folder: Path, pictures: np.ndarray, name: str = "s{}.png", first: int = 8) -> None:
    for z, picture in enumerate(pictures):
        Image.fromarray(picture).save(folder / name.format(z + first))


def everything(source) -> np.ndarray:
    """All channels, (c, z, y, x), read together and one by one."""
    box = Box.of_shape(source.shape_zyx)
    together = source.read_channels(box)
    np.testing.assert_array_equal(together, [source.read(box, 0, c) for c in range(source.nc)])
    return together


@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
def test_png_slices_in_natural_order(tmp_path, dtype):
    voxels = planes(5, 6, 7, dtype=dtype)
    write(tmp_path, voxels)
    for path in (tmp_path, tmp_path / "s*.png", str(tmp_path / "s[0-9]*.png")):
        with open_source(path) as source:
            assert (source.format, source.dtype, source.nc) == ("png slices", dtype, 1)
            assert [file.name for file in source.files] == [f"s{z}.png" for z in range(8, 13)]
            np.testing.assert_array_equal(everything(source)[0], voxels)


@pytest.mark.parametrize("ncolors", [2, 3, 4])
@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
def test_colours_are_channels(tmp_path, ncolors, dtype):
    pictures = planes(3, 6, 7, ncolors, dtype=dtype)
    for z, picture in enumerate(pictures):
        (tmp_path / f"{z}.png").write_bytes(imagecodecs.png_encode(picture))
    with open_source(tmp_path) as source:
        assert (source.nc, source.dtype) == (ncolors, dtype)
        assert source.is_rgb == (ncolors > 2)
        np.testing.assert_array_equal(everything(source), pictures.transpose(3, 0, 1, 2))


def test_bilevel_is_bool_and_a_palette_is_its_colours(tmp_path):
    for folder in ("one", "palette"):
        (tmp_path / folder).mkdir()
    bits = planes(6, 7) > 100
    Image.fromarray(bits).save(tmp_path / "one" / "0.png")
    with open_source(tmp_path / "one") as source:
        np.testing.assert_array_equal(everything(source)[0, 0], bits)
    picture = Image.fromarray(planes(6, 7, 3)).quantize(16)
    picture.save(tmp_path / "palette" / "0.png")
    with open_source(tmp_path / "palette") as source:
        assert source.is_rgb
        expected = np.asarray(picture.convert("RGB")).transpose(2, 0, 1)
        np.testing.assert_array_equal(everything(source)[:, 0], expected)


def test_tiff_slices_of_colours(tmp_path):
    pictures = planes(3, 6, 7, 3)
    for z, picture in enumerate(pictures):
        tifffile.imwrite(tmp_path / f"{z}.tif", picture, photometric="rgb", compression="zlib")
    with open_source(tmp_path) as source:
        assert source.is_rgb
        np.testing.assert_array_equal(everything(source), pictures.transpose(3, 0, 1, 2))


@pytest.mark.parametrize("suffix", ["png", "jpg", "tif"])
def test_slice_of_another_size_is_named_with_both_sizes(tmp_path, suffix):
    write(tmp_path, planes(4, 6, 7), name=f"s{{}}.{suffix}")
    Image.fromarray(planes(6, 9)).save(tmp_path / f"s10.{suffix}")
    with pytest.raises(SourceError, match=rf"s10\.{suffix}: is 9 x 6 pixels.*s8.* 7 x 6 pixels"):
        open_source(tmp_path)


def test_slice_of_another_type_is_named_with_both_types(tmp_path):
    write(tmp_path, planes(2, 6, 7))
    Image.fromarray(planes(6, 7, dtype="uint16")).save(tmp_path / "s99.png")
    with pytest.raises(SourceError, match=r"s99\.png: is .* 1 uint16, .* 1 uint8"):
        open_source(tmp_path)


def test_slice_that_changes_after_opening_is_refused(tmp_path):
    write(tmp_path, planes(3, 6, 7))
    with open_source(tmp_path) as source:
        Image.fromarray(planes(8, 9)).save(tmp_path / "s9.png")
        source.read(Box((0, 0, 0), (1, 6, 7)))
        with pytest.raises(SourceError, match=r"s9\.png: is 9 x 8 .* was 7 x 6"):
            source.read(Box((1, 0, 0), (2, 6, 7)))


def test_other_files_in_a_folder_are_left_aside_with_a_warning(tmp_path):
    write(tmp_path, planes(3, 6, 7))
    (tmp_path / "notes.txt").write_text("hello")
    (tmp_path / ".DS_Store").write_text("hidden")
    with open_source(tmp_path) as source:
        assert source.shape_zyx == (3, 6, 7)
        assert source.warnings == ("1 files that are no pictures are left aside: notes.txt",)


def test_two_kinds_in_one_folder_are_refused(tmp_path):
    write(tmp_path, planes(3, 6, 7))
    write(tmp_path, planes(2, 6, 7), name="t{}.jpg")
    with pytest.raises(UnsupportedSourceError, match=r"3 \.png, 2 \.jpg.*pattern"):
        open_source(tmp_path)


def test_stack_among_slices_is_refused(tmp_path):
    for z in range(2):
        tifffile.imwrite(tmp_path / f"{z}.tif", planes(z + 1, 6, 7), photometric="minisblack")
    with pytest.raises(UnsupportedSourceError, match=r"1\.tif: holds 2 pictures"):
        open_source(tmp_path)


@pytest.mark.parametrize("suffix", ["png", "jpg", "tif"])
def test_truncated_slice_is_named(tmp_path, suffix):
    write(tmp_path, planes(3, 60, 70), name=f"s{{}}.{suffix}")
    path = tmp_path / f"s9.{suffix}"
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    with (
        pytest.raises(TruncatedSourceError, match=rf"s9\.{suffix}: "),
        open_source(tmp_path) as source,
    ):
        source.read(Box.of_shape(source.shape_zyx))


@pytest.mark.parametrize("content", [b"", b"GIF89a", b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff"])
def test_file_that_is_no_picture_is_named(tmp_path, content):
    write(tmp_path, planes(3, 6, 7))
    (tmp_path / "s9.png").write_bytes(content)
    with pytest.raises((SourceError, UnsupportedSourceError), match=r"s9\.png"):
        open_source(tmp_path)


def test_enormous_png_header_is_refused(tmp_path):
    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    header = struct.pack(">IIBBBBB", 2_000_000_000, 2_000_000_000, 8, 0, 0, 0, 0)
    (tmp_path / "0.png").write_bytes(
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(b"a" * 99))
    )
    with pytest.raises(SourceError, match=r"2000000000 x 2000000000 pixels.*cannot hold"):
        open_source(tmp_path)


def test_larger_pictures_than_pillow_likes_are_read(tmp_path):
    Image.fromarray(np.zeros((14000, 13000), bool)).save(tmp_path / "0.png")
    with open_source(tmp_path) as source:
        assert source.shape_zyx == (1, 14000, 13000)


def test_cmyk_is_refused(tmp_path):
    Image.fromarray(planes(6, 7, 3)).convert("CMYK").save(tmp_path / "0.jpg")
    with pytest.raises(UnsupportedSourceError, match="CMYK"):
        open_source(tmp_path)


def test_description_of_slices_is_refused(tmp_path):
    write(tmp_path, planes(3, 6, 7))
    with pytest.raises(InvalidInputError, match="leave out --shape, --dataset"):
        open_source(tmp_path, shape_zyx=(3, 6, 7), dataset="1")


def test_numbers_in_names_sort_as_numbers():
    names = ["a10", "a9", "a09", "b1", "A2", "a2x", "10", "9"]
    assert sorted(names, key=natural_key) == ["9", "10", "A2", "a2x", "a09", "a9", "a10", "b1"]
