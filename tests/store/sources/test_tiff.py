"""TIFF: axes, channels, spacings, layouts of pages, and what is refused."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
import tifffile

from octobrick.codec.errors import InvalidInputError
from octobrick.store.box import Box
from octobrick.store.errors import SourceError, TruncatedSourceError, UnsupportedSourceError
from octobrick.store.sources import open_source


def numbers(*shape: int, dtype: str = "uint16") -> np.ndarray:
    return np.random.default_rng(5).integers(0, 250, shape).astype(dtype)


def everything(source) -> np.ndarray:
    """All time steps and channels, (t, c, z, y, x), each read on its own."""
    box = Box.of_shape(source.shape_zyx)
    return np.array([[source.read(box, t, c) for c in range(source.nc)] for t in range(source.nt)])


def test_ome_time_steps_channels_spacing_and_names(tmp_path):
    voxels = numbers(2, 3, 4, 5, 6)
    metadata = {
        "axes": "TZCYX",
        "PhysicalSizeX": 0.5,
        "PhysicalSizeY": 750,
        "PhysicalSizeYUnit": "nm",
        "PhysicalSizeZ": 2,
        "Channel": {"Name": ["a", "b", "c", "d"], "Color": [-16776961, 16711935, 65535, -1]},
    }
    tifffile.imwrite(tmp_path / "a.ome.tif", voxels, metadata=metadata, photometric="minisblack")
    with open_source(tmp_path / "a.ome.tif") as source:
        assert (source.nt, source.nc, source.shape_zyx) == (2, 4, (3, 5, 6))
        assert source.format == "ome-tiff"
        assert source.spacing_zyx == pytest.approx((2, 0.75, 0.5))
        assert source.unit == "micrometer"
        assert [tuple(channel) for channel in source.channels] == [
            ("a", "ff0000"),
            ("b", "00ff00"),
            ("c", "0000ff"),
            ("d", "ffffff"),
        ]
        np.testing.assert_array_equal(everything(source), voxels.transpose(0, 2, 1, 3, 4))
        box = Box((1, 1, 2), (3, 4, 6))
        expected = voxels[1].transpose(1, 0, 2, 3)[(slice(None), *box.slices)]
        np.testing.assert_array_equal(source.read_channels(box, 1), expected)


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
def test_imagej_hyperstack(tmp_path, dtype):
    voxels = numbers(2, 3, 4, 5, 6, dtype=dtype)
    metadata = {"axes": "TZCYX", "spacing": 3.0, "unit": "um"}
    tifffile.imwrite(tmp_path / "a.tif", voxels, imagej=True, resolution=(4, 2), metadata=metadata)
    with open_source(tmp_path / "a.tif") as source:
        assert (source.nt, source.nc, source.shape_zyx) == (2, 4, (3, 5, 6))
        assert source.spacing_zyx == (3.0, 0.5, 0.25)
        assert source.unit == "micrometer"
        np.testing.assert_array_equal(everything(source), voxels.transpose(0, 2, 1, 3, 4))


@pytest.mark.parametrize("code", ["jpeg", "jpeg2000"])
def test_tiles_of_picture_codes(tmp_path, code):
    ramp = np.tile(np.arange(40, dtype="uint8") * 4, (3, 20, 1))
    how = {"compression": code, "tile": (16, 16), "photometric": "minisblack"}
    tifffile.imwrite(tmp_path / "a.tif", ramp, **how)
    with open_source(tmp_path / "a.tif") as source:
        expected = tifffile.imread(tmp_path / "a.tif")
        np.testing.assert_array_equal(everything(source)[0, 0], expected)


@pytest.mark.parametrize("order", ["<", ">"])
def test_planes_without_directories_of_their_own(tmp_path, order):
    voxels = numbers(7, 5, 6).astype(order + "u2")
    with tifffile.TiffWriter(tmp_path / "a.tif", byteorder=order) as file:
        file.write(voxels, contiguous=True)  # one directory, seven planes after it
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        truncated = file.series[0].is_truncated or len(file.pages) == 7
    assert truncated
    with open_source(tmp_path / "a.tif") as source:
        np.testing.assert_array_equal(everything(source)[0, 0], voxels)


@pytest.mark.parametrize("ncolors", [3, 4])
@pytest.mark.parametrize("planar", ["contig", "separate"])
@pytest.mark.parametrize(
    "how",
    [{}, {"compression": "zlib", "rowsperstrip": 3}, {"tile": (16, 16), "compression": "zstd"}],
    ids=["plain", "strips", "tiles"],
)
def test_colours_are_channels(tmp_path, ncolors, planar, how):
    colours = numbers(3, 21, 35, ncolors, dtype="uint8")
    stored = colours if planar == "contig" else colours.transpose(0, 3, 1, 2)
    extra = ["unassalpha"] if ncolors == 4 else None
    tifffile.imwrite(
        tmp_path / "a.tif",
        stored,
        photometric="rgb",
        planarconfig=planar,
        extrasamples=extra,
        **how,
    )
    with open_source(tmp_path / "a.tif") as source:
        assert source.is_rgb
        assert (source.nc, source.shape_zyx) == (ncolors, (3, 21, 35))
        box = Box((1, 2, 3), (3, 20, 33))
        expected = colours.transpose(3, 0, 1, 2)
        np.testing.assert_array_equal(everything(source)[0], expected)
        np.testing.assert_array_equal(
            source.read_channels(box), expected[(slice(None), *box.slices)]
        )


def test_bilevel_pages_are_bool(tmp_path):
    voxels = numbers(2, 5, 19) > 100
    tifffile.imwrite(tmp_path / "a.tif", voxels, photometric="minisblack")
    with open_source(tmp_path / "a.tif") as source:
        assert source.dtype == bool
        np.testing.assert_array_equal(everything(source)[0, 0], voxels)


def test_unnamed_axes_are_asked_for(tmp_path):
    voxels = numbers(2, 3, 5, 6)
    tifffile.imwrite(tmp_path / "a.tif", voxels, photometric="minisblack")
    with pytest.raises(UnsupportedSourceError, match="--axes tzyx"):
        open_source(tmp_path / "a.tif")
    with open_source(tmp_path / "a.tif", axes="czyx") as source:
        np.testing.assert_array_equal(everything(source)[0], voxels)
    with open_source(tmp_path / "a.tif", axes="ztyx") as source:
        np.testing.assert_array_equal(everything(source)[:, 0], voxels.transpose(1, 0, 2, 3))


@pytest.mark.parametrize("axes", ["zyx", "tzxy", "zzyx", "qzyx", "yzyx"])
def test_axes_that_do_not_fit_are_refused(tmp_path, axes):
    tifffile.imwrite(tmp_path / "a.tif", numbers(2, 3, 5, 6), photometric="minisblack")
    with pytest.raises(InvalidInputError, match=f"--axes {axes} does not fit"):
        open_source(tmp_path / "a.tif", axes=axes)


def test_one_of_several_images_is_chosen_by_number(tmp_path):
    first, second = numbers(3, 5, 6), numbers(4, 7, 8, dtype="uint8")
    with tifffile.TiffWriter(tmp_path / "a.tif") as file:
        file.write(first, photometric="minisblack")
        file.write(second, photometric="minisblack")
    with pytest.raises(UnsupportedSourceError, match=r"holds 2 images.*--dataset 0"):
        open_source(tmp_path / "a.tif")
    with pytest.raises(UnsupportedSourceError, match="there is no '2'"):
        open_source(tmp_path / "a.tif", dataset="2")
    with open_source(tmp_path / "a.tif", dataset="1") as source:
        np.testing.assert_array_equal(everything(source)[0, 0], second)


def test_a_file_cut_between_two_pages_is_not_taken_for_a_shorter_one(tmp_path):
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, numbers(6, 5, 6), photometric="minisblack", metadata=None)
    with tifffile.TiffFile(path) as file:
        cut = file.pages[3].offset
    path.write_bytes(path.read_bytes()[:cut])
    with pytest.raises(TruncatedSourceError, match=rf"page 3 .* the file has {cut}"):
        open_source(path)


def test_pixels_that_end_early_are_told_when_opened(tmp_path):
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, numbers(5, 600), photometric="minisblack", metadata=None)
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(TruncatedSourceError, match="page 0 go up to byte"):
        open_source(path)


def test_directories_in_a_ring_are_refused(tmp_path):
    path = tmp_path / "a.tif"
    entry = struct.pack("<HHII", 256, 4, 1, 5)
    path.write_bytes(struct.pack("<2sHIH", b"II", 42, 8, 1) + entry + struct.pack("<I", 8))
    with pytest.raises(SourceError, match="no end"):
        open_source(path)


@pytest.mark.parametrize("head", [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"])
def test_a_file_that_only_begins_as_tiff_is_truncated(tmp_path, head):
    (tmp_path / "a.dat").write_bytes(head + b"rest")
    with pytest.raises(SourceError):
        open_source(tmp_path / "a.dat")


@pytest.mark.parametrize("content", [b"", b"no picture at all", b"MM*\0\0\0\0\x08"])
def test_other_content_named_tif_is_refused(tmp_path, content):
    (tmp_path / "a.tif").write_bytes(content)
    with pytest.raises(SourceError, match="does not begin as a TIFF"):
        open_source(tmp_path / "a.tif")


@pytest.mark.parametrize(
    ("tag", "value"), [("ImageWidth", 1 << 31), ("ImageLength", 1 << 31), ("ImageLength", 0)]
)
def test_enormous_or_empty_sizes_are_refused(tmp_path, tag, value):
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, numbers(3, 5, 6), photometric="minisblack", metadata=None)
    with tifffile.TiffFile(path, mode="r+b") as file:
        file.pages[0].tags[tag].overwrite(value, dtype="I")
    with pytest.raises((SourceError, UnsupportedSourceError)):
        open_source(path)


@pytest.mark.parametrize(
    "attribute", ['SizeZ="3000000000"', 'FirstZ="9999999999"', 'PlaneCount="-7"', 'IFD="x"']
)
def test_ome_counts_beyond_reason_are_refused(tmp_path, attribute):
    path = tmp_path / "a.ome.tif"
    xml = (
        '<OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06"><Image ID="Image:0">'
        '<Pixels ID="Pixels:0" DimensionOrder="XYZCT" Type="uint16" SizeX="6" SizeY="5" '
        f'SizeC="1" SizeT="1" {attribute}><TiffData {attribute}/></Pixels></Image></OME>'
    )
    tifffile.imwrite(
        path, numbers(3, 5, 6), description=xml, metadata=None, photometric="minisblack"
    )
    with pytest.raises(SourceError, match="OME-XML counts"):
        open_source(path)


def test_damaged_strip_is_named(tmp_path):
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, numbers(30, 40), compression="zlib", photometric="minisblack")
    with tifffile.TiffFile(path) as file:
        start = file.pages[0].dataoffsets[0]
    content = bytearray(path.read_bytes())
    content[start : start + 40] = bytes(40)
    path.write_bytes(content)
    with (
        open_source(path) as source,
        pytest.raises(SourceError, match=r"strip or tile 0 .* cannot be decoded"),
    ):
        source.read(Box.of_shape(source.shape_zyx))


def test_files_of_an_image_in_several_files_are_all_named(tmp_path):
    voxels = numbers(4, 5, 6)
    uuids = ["urn:uuid:00000000-0000-0000-0000-00000000000a", "urn:uuid:0-b"]
    data = "".join(
        f'<TiffData FirstZ="{2 * i}" IFD="0" PlaneCount="2">'
        f'<UUID FileName="{name}">{uuid}</UUID></TiffData>'
        for i, (name, uuid) in enumerate(zip(["a.ome.tif", "b.ome.tif"], uuids, strict=True))
    )
    for name, uuid, part in zip("ab", uuids, (voxels[:2], voxels[2:]), strict=True):
        xml = (
            '<OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06" '
            f'UUID="{uuid}"><Image ID="Image:0"><Pixels ID="Pixels:0" DimensionOrder="XYZCT" '
            'Type="uint16" SizeX="6" SizeY="5" SizeZ="4" SizeC="1" SizeT="1" BigEndian="false">'
            f'<Channel ID="Channel:0" SamplesPerPixel="1"/>{data}</Pixels></Image></OME>'
        )
        path = tmp_path / f"{name}.ome.tif"
        tifffile.imwrite(path, part, description=xml, metadata=None, photometric="minisblack")
    with open_source(tmp_path / "a.ome.tif") as source:
        np.testing.assert_array_equal(everything(source)[0, 0], voxels)
        assert [Path(path).name for path in source.files] == ["a.ome.tif", "b.ome.tif"]


def test_jpeg_that_says_it_is_enormous_is_not_decoded(tmp_path):
    path = tmp_path / "a.tif"
    pixels = numbers(16, 32, dtype="uint8")
    tifffile.imwrite(path, pixels, compression="jpeg", photometric="minisblack")
    content = path.read_bytes()
    frame = content.index(b"\xff\xc0")
    path.write_bytes(content[: frame + 5] + b"\xff\xff\xff\xff" + content[frame + 9 :])
    with (
        open_source(path) as source,
        pytest.raises(SourceError, match="its code is of 4294836225 pixels, not 512"),
    ):
        source.read(Box.of_shape(source.shape_zyx))


def test_wrong_byte_order_is_refused(tmp_path):
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, numbers(3, 5, 6), photometric="minisblack", byteorder="<")
    path.write_bytes(b"MM\0*" + path.read_bytes()[4:])
    with pytest.raises(SourceError, match=r"a\.tif: the directory of page 0"):
        open_source(path)


def test_refused_files_are_not_left_open(tmp_path):
    with tifffile.TiffWriter(tmp_path / "a.tif") as file:
        file.write(numbers(3, 5, 6), photometric="minisblack")
        file.write(numbers(4, 7, 8), photometric="minisblack")
    descriptors = Path("/proc/self/fd")
    before = len(list(descriptors.iterdir()))
    for _ in range(3):
        with pytest.raises(UnsupportedSourceError):
            open_source(tmp_path / "a.tif")
    assert len(list(descriptors.iterdir())) == before
