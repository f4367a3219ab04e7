"""DICOM series: order, spacing, orientation, rescale, codes, and what is refused."""

from __future__ import annotations

import imagecodecs
import numpy as np
import pytest
from pydicom import Dataset
from pydicom.encaps import encapsulate
from pydicom.uid import (
    DeflatedExplicitVRLittleEndian,
    ExplicitVRBigEndian,
    ImplicitVRLittleEndian,
    JPEG2000Lossless,
    JPEGBaseline8Bit,
    JPEGLosslessSV1,
    JPEGLSLossless,
    RLELossless,
)

from octobrick.codec.errors import InvalidInputError
from octobrick.store.box import Box
from octobrick.store.errors import SourceError, TruncatedSourceError, UnsupportedSourceError
from octobrick.store.sources import Rescale, open_source

from .writers_images import dicom_file


def volume(*shape: int, dtype: str = "int16") -> np.ndarray:
    return np.random.default_rng(8).integers(-1000, 3000, shape).astype(dtype)


def series(folder, voxels, step: float = 2.5, **more):
    for z, plane in enumerate(voxels):
        dicom_file(folder / f"i{z}.dcm", plane, step * z, InstanceNumber=z, **more)


def everything(source, t: int = 0) -> np.ndarray:
    return source.read(Box.of_shape(source.shape_zyx), t)


def test_orientation_origin_spacing_and_rescale(tmp_path):
    voxels = volume(4, 5, 6)
    orientation = [0.0, 1.0, 0.0, 0.0, 0.0, -1.0]
    for z, plane in enumerate(voxels):
        position = [-50.0 - 3 * z, 10.0, 7.0]
        dicom_file(
            tmp_path / f"{z}",
            plane,
            ImagePositionPatient=position,
            ImageOrientationPatient=orientation,
            PixelSpacing=[0.5, 0.25],
            RescaleSlope=2,
            RescaleIntercept=-1024,
        )
    with open_source(tmp_path) as source:
        assert source.format == "dicom"
        assert source.unit == "millimeter"
        assert source.rescale == Rescale(2, -1024)
        assert source.spacing_zyx == (3.0, 0.5, 0.25)
        assert source.origin_xyz == (-50.0, 10.0, 7.0)
        assert source.direction == ((0, 0, -1), (1, 0, 0), (0, -1, 0))
        np.testing.assert_array_equal(everything(source), voxels)


@pytest.mark.parametrize("syntax", [ImplicitVRLittleEndian, ExplicitVRBigEndian])
def test_uncompressed_syntaxes(tmp_path, syntax):
    voxels = volume(3, 5, 6)
    series(tmp_path, voxels, syntax=syntax)
    with open_source(tmp_path) as source:
        np.testing.assert_array_equal(everything(source), voxels)


@pytest.mark.parametrize(
    ("syntax", "encode"),
    [
        (JPEGLSLossless, imagecodecs.jpegls_encode),
        (JPEG2000Lossless, lambda plane: imagecodecs.jpeg2k_encode(plane, codecformat="j2k")),
        (JPEGLosslessSV1, imagecodecs.ljpeg_encode),
        (RLELossless, None),
    ],
)
@pytest.mark.parametrize("dtype", ["uint8", "uint16", "int16"])
def test_compressed_frames(tmp_path, syntax, encode, dtype):
    voxels = volume(3, 17, 20, dtype=dtype)
    for z, plane in enumerate(voxels):
        if encode is None:
            made = dicom_file(tmp_path / str(z), plane, z)
            made.compress(RLELossless)
            made.save_as(tmp_path / str(z), enforce_file_format=True)
        else:
            pixels = encapsulate([encode(plane.view(f"u{plane.itemsize}"))])
            dicom_file(tmp_path / str(z), plane, z, syntax=syntax, pixels=pixels)
    with open_source(tmp_path) as source:
        np.testing.assert_array_equal(everything(source), voxels)


def test_jpeg_colours(tmp_path):
    ramp = np.linspace(0, 255, 16 * 24 * 3).reshape(16, 24, 3).astype(np.uint8)
    pixels = encapsulate([imagecodecs.jpeg_encode(ramp, level=95)])
    dicom_file(
        tmp_path / "a.dcm",
        ramp[..., 0],
        syntax=JPEGBaseline8Bit,
        pixels=pixels,
        SamplesPerPixel=3,
        PhotometricInterpretation="YBR_FULL_422",
        PlanarConfiguration=0,
    )
    with open_source(tmp_path / "a.dcm") as source:
        assert source.is_rgb
        read = source.read_channels(Box.of_shape(source.shape_zyx))[:, 0]
        assert np.abs(read.astype(int) - ramp.transpose(2, 0, 1)).max() < 16


@pytest.mark.parametrize(("planar", "rle"), [(0, False), (1, False), (0, True)])
def test_rgb(tmp_path, planar, rle):
    colours = np.random.default_rng(1).integers(0, 255, (4, 6, 3)).astype(np.uint8)
    stored = colours.transpose(2, 0, 1) if planar else colours
    more = {"Rows": 4, "Columns": 6, "SamplesPerPixel": 3, "PlanarConfiguration": planar}
    made = dicom_file(tmp_path / "a.dcm", stored, PhotometricInterpretation="RGB", **more)
    if rle:
        made.compress(RLELossless)
        made.save_as(tmp_path / "a.dcm", enforce_file_format=True)
    with open_source(tmp_path / "a.dcm") as source:
        read = source.read_channels(Box.of_shape(source.shape_zyx))
        np.testing.assert_array_equal(read[:, 0], colours.transpose(2, 0, 1))


def test_frames_of_one_file_with_positions_of_their_own(tmp_path):
    voxels = volume(4, 5, 6)
    groups = []
    for z in range(4):
        position = Dataset()
        position.ImagePositionPatient = [0.0, 0.0, -1.5 * z]
        group = Dataset()
        group.PlanePositionSequence = [position]
        groups.append(group)
    dicom_file(
        tmp_path / "a.dcm", voxels, NumberOfFrames=4, PerFrameFunctionalGroupsSequence=groups
    )
    with open_source(tmp_path / "a.dcm") as source:
        assert source.spacing_zyx[0] == 1.5
        assert source.origin_xyz == (0.0, 0.0, -4.5)
        np.testing.assert_array_equal(everything(source), voxels[::-1])


def test_frames_without_positions_are_in_their_order(tmp_path):
    voxels = volume(4, 5, 6)
    dicom_file(tmp_path / "a.dcm", voxels, NumberOfFrames=4, SpacingBetweenSlices=3)
    with open_source(tmp_path / "a.dcm") as source:
        assert source.spacing_zyx[0] == 3
        assert source.direction is None
        assert "without a position" in source.warnings[0]
        np.testing.assert_array_equal(everything(source), voxels)


def test_several_frames_at_every_place_are_time_steps(tmp_path):
    voxels = volume(2, 3, 5, 6)
    for t in range(2):
        for z in range(3):
            path = tmp_path / f"{z}{t}"
            dicom_file(path, voxels[t, z], z, InstanceNumber=10 * t + z)
    with open_source(tmp_path) as source:
        assert (source.nt, source.shape_zyx) == (2, (3, 5, 6))
        for t in range(2):
            np.testing.assert_array_equal(everything(source, t), voxels[t])


def test_rescale_of_its_own_for_each_frame_is_applied(tmp_path):
    voxels = volume(3, 5, 6)
    for z, plane in enumerate(voxels):
        dicom_file(tmp_path / str(z), plane, z, RescaleSlope=z + 0.5, RescaleIntercept=1)
    with open_source(tmp_path) as source:
        assert source.dtype == np.float32
        assert source.rescale is None
        assert "rescale of its own" in source.warnings[0]
        slopes = np.arange(3)[:, None, None] + 0.5
        np.testing.assert_allclose(everything(source), voxels * slopes + 1, rtol=1e-6)


def test_bits_above_those_stored_are_left_out(tmp_path):
    voxels = (volume(2, 5, 6) % 2048).astype(np.int16)
    for z, plane in enumerate(voxels):
        more = {"BitsStored": 12, "HighBit": 11}
        dicom_file(tmp_path / str(z), plane ^ np.int16(0x3000), z, **more)
    with open_source(tmp_path) as source:
        np.testing.assert_array_equal(everything(source), voxels)


def test_several_series_are_listed_and_chosen(tmp_path):
    first, second = volume(2, 5, 6), volume(3, 7, 8)
    for number, voxels in enumerate((first, second)):
        for z, plane in enumerate(voxels):
            more = {"SeriesInstanceUID": f"1.2.{number}", "SeriesDescription": f"scan {number}"}
            dicom_file(tmp_path / f"{number}{z}", plane, z, **more)
    message = r"2 series: 0: 1\.2\.0 \(CT scan 0, 2 files\); 1: 1\.2\.1 \(CT scan 1, 3 files\)"
    with pytest.raises(UnsupportedSourceError, match=message):
        open_source(tmp_path)
    with pytest.raises(UnsupportedSourceError, match="there is no '7'"):
        open_source(tmp_path, dataset="7")
    for chosen in ("1", "1.2.1"):
        with open_source(tmp_path, dataset=chosen) as source:
            np.testing.assert_array_equal(everything(source), second)
            assert len(source.files) == 3


def test_missing_slice_is_named_by_its_neighbours(tmp_path):
    series(tmp_path, volume(6, 5, 6))
    (tmp_path / "i3.dcm").unlink()
    with pytest.raises(SourceError, match=r"5 mm lie between i2\.dcm and i4\.dcm, elsewhere 2\.5"):
        open_source(tmp_path)


def test_uneven_slices_are_warned_of(tmp_path):
    for z, position in enumerate([0, 1, 2.1, 3]):
        dicom_file(tmp_path / str(z), volume(5, 6), position)
    with open_source(tmp_path) as source:
        assert source.spacing_zyx[0] == pytest.approx(1)
        assert source.warnings == ("frames are 0.9 to 1.1 mm apart; their mean distance is used",)


def test_tilted_gantry_is_warned_of(tmp_path):
    for z in range(3):
        dicom_file(tmp_path / str(z), volume(5, 6), ImagePositionPatient=[0, z, 2 * z])
    with open_source(tmp_path) as source:
        assert "tilted" in source.warnings[0]
        assert source.spacing_zyx[0] == pytest.approx(5**0.5)
        assert np.array(source.direction)[:, 2] == pytest.approx([0, 0.2**0.5, 0.8**0.5])


@pytest.mark.parametrize(
    "more",
    [
        {"Rows": 4, "Columns": 6},
        {"PixelSpacing": [1, 1]},
        {"ImageOrientationPatient": [0, 1, 0, 0, 0, 1]},
    ],
    ids=["size", "spacing", "orientation"],
)
def test_slice_unlike_the_others_is_named(tmp_path, more):
    series(tmp_path, volume(3, 5, 6))
    dicom_file(tmp_path / "i9.dcm", volume(5, 6), 7.5, **more)
    with pytest.raises(SourceError, match=r"i9\.dcm: has .* but i0\.dcm has"):
        open_source(tmp_path)


def test_copies_of_one_image_are_refused(tmp_path):
    series(tmp_path, volume(3, 5, 6))
    (tmp_path / "copy.dcm").write_bytes((tmp_path / "i1.dcm").read_bytes())
    with pytest.raises(SourceError, match=r"i1\.dcm: is the same image as copy\.dcm"):
        open_source(tmp_path)


def test_place_with_more_frames_than_others_is_refused(tmp_path):
    series(tmp_path, volume(3, 5, 6))
    dicom_file(tmp_path / "more.dcm", volume(5, 6), 2.5)
    with pytest.raises(SourceError, match="2 at "):
        open_source(tmp_path)


def test_files_that_are_no_images_are_left_aside(tmp_path):
    series(tmp_path, volume(3, 5, 6))
    (tmp_path / "README").write_text("hello")
    with open_source(tmp_path) as source:
        assert source.shape_zyx == (3, 5, 6)
        assert source.warnings == ("1 files that are no DICOM are left aside: README",)


def test_file_cut_to_nothing_is_not_left_aside(tmp_path):
    series(tmp_path, volume(3, 5, 6))
    (tmp_path / "i2.dcm").write_bytes(b"")
    with pytest.raises(SourceError, match=r"i2\.dcm: does not begin as DICOM does, unlike i0\.dcm"):
        open_source(tmp_path)


def test_truncated_pixels_are_told_when_opened(tmp_path):
    series(tmp_path, volume(3, 50, 60))
    path = tmp_path / "i1.dcm"
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(TruncatedSourceError, match=r"i1\.dcm: pixels end after 5900 of 6000 bytes"):
        open_source(tmp_path)


def test_enormous_size_is_refused(tmp_path):
    dicom_file(tmp_path / "a.dcm", volume(5, 6), Rows=65535, Columns=65535, NumberOfFrames=30000)
    with pytest.raises(TruncatedSourceError, match="of 257690"):
        open_source(tmp_path / "a.dcm")


@pytest.mark.parametrize("content", [b"", b"hello", bytes(128) + b"DICM", bytes(500)])
def test_other_content_named_dcm_is_refused(tmp_path, content):
    (tmp_path / "a.dcm").write_bytes(content)
    with pytest.raises((SourceError, UnsupportedSourceError)):
        open_source(tmp_path / "a.dcm")


def test_deflated_file_is_refused(tmp_path):
    dicom_file(tmp_path / "a.dcm", volume(5, 6), syntax=DeflatedExplicitVRLittleEndian)
    with pytest.raises(UnsupportedSourceError, match="deflated"):
        open_source(tmp_path / "a.dcm")


def test_axes_and_shape_are_refused(tmp_path):
    series(tmp_path, volume(3, 5, 6))
    with pytest.raises(InvalidInputError, match="--axes"):
        open_source(tmp_path, axes="zyx")
    with pytest.raises(InvalidInputError, match="--shape"):
        open_source(tmp_path, shape_zyx=(3, 5, 6))


def test_wrong_byte_order_is_refused(tmp_path):
    dicom_file(tmp_path / "a.dcm", volume(5, 6))
    content = (tmp_path / "a.dcm").read_bytes()
    wrong = content.replace(b"1.2.840.10008.1.2.1\0", b"1.2.840.10008.1.2.2\0")
    assert wrong != content
    (tmp_path / "a.dcm").write_bytes(wrong)
    with pytest.raises((SourceError, UnsupportedSourceError), match=r"a\.dcm"):
        open_source(tmp_path / "a.dcm")
