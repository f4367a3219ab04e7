"""Time steps, channels, colours and labels of NIfTI, NRRD and MetaImage."""

from __future__ import annotations

import contextlib
import gzip
from pathlib import Path
from typing import Any

import nibabel
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from octobrick.codec.errors import InvalidInputError, OctobrickError
from octobrick.store import open_volume
from octobrick.store.box import Box
from octobrick.store.errors import SourceError, TruncatedSourceError, UnsupportedSourceError
from octobrick.store.ingest import ingest
from octobrick.store.sources import Source, open_source
from octobrick.store.sources.gzip_stream import GzipReader

NT, NC, SHAPE = 2, 3, (3, 4, 5)


@pytest.fixture
def tczyx() -> np.ndarray:
    return np.random.default_rng(3).integers(0, 255, (NT, NC, *SHAPE)).astype(np.uint8)


def read_all(source: Source) -> np.ndarray:
    """All voxels, (t, c, z, y, x), both by channel and together."""
    box = Box.of_shape(source.shape_zyx)
    together = np.stack([source.read_channels(box, t) for t in range(source.nt)])
    each = [[source.read(box, t, c) for c in range(source.nc)] for t in range(source.nt)]
    np.testing.assert_array_equal(together, each)
    part = Box((1, 1, 2), (3, 3, 4))
    np.testing.assert_array_equal(source.read_channels(part), together[0][:, *part.slices])
    return together


def nifti(path: Path, voxels_xyz: np.ndarray, intent: int = 0, **header: Any) -> Path:
    """A file of an array indexed [x, y, z, ...]."""
    image = nibabel.Nifti1Image(voxels_xyz, np.diag([1, 2, 3, 1]), dtype=voxels_xyz.dtype)
    image.header["intent_code"] = intent
    for name, value in header.items():
        image.header[name] = value
    nibabel.save(image, path)
    return path


@pytest.mark.parametrize("name", ["a.nii", "a.nii.gz"])
def test_nifti_time_then_channels(tmp_path, tczyx, name):
    path = nifti(tmp_path / name, tczyx.transpose(4, 3, 2, 0, 1))
    with open_source(path) as source:
        assert (source.nt, source.nc, source.shape_zyx) == (NT, NC, SHAPE)
        assert source.spacing_zyx == (3.0, 2.0, 1.0)
        assert not source.is_rgb
        assert not source.labels
        np.testing.assert_array_equal(read_all(source), tczyx)


def test_nifti2_time(tmp_path, tczyx):
    image = nibabel.Nifti2Image(tczyx[:, 0].T, np.eye(4), dtype=np.uint8)
    nibabel.save(image, tmp_path / "a.nii")
    with open_source(tmp_path / "a.nii") as source:
        np.testing.assert_array_equal(read_all(source), tczyx[:, :1])


@pytest.mark.parametrize(("intent", "is_rgb"), [(1007, False), (2003, True)])
@pytest.mark.parametrize("with_time", [True, False])
def test_nifti_components_of_a_vector_on_either_axis(tmp_path, tczyx, intent, is_rgb, with_time):
    voxels = tczyx[0].T[:, :, :, np.newaxis] if with_time else tczyx[0].T
    with open_source(nifti(tmp_path / "a.nii", voxels, intent)) as source:
        assert source.is_rgb == is_rgb
        np.testing.assert_array_equal(read_all(source), tczyx[:1])


@pytest.mark.parametrize("nc", [3, 4])
@pytest.mark.parametrize("name", ["a.nii", "a.nii.gz"])
def test_nifti_rgb_and_rgba(tmp_path, name, nc):
    colours = np.random.default_rng(3).integers(0, 255, (NT, *SHAPE, nc)).astype(np.uint8)
    dtype = np.dtype([(letter, "u1") for letter in "RGBA"[:nc]])
    stored = np.ascontiguousarray(colours).view(dtype)[..., 0].T
    with open_source(nifti(tmp_path / name, stored, scl_slope=2)) as source:
        assert source.is_rgb
        assert source.rescale is None
        np.testing.assert_array_equal(read_all(source), np.moveaxis(colours, -1, 1))


def test_nifti_colours_with_channels_are_refused(tmp_path):
    dtype = np.dtype([(letter, "u1") for letter in "RGB"])
    path = nifti(tmp_path / "a.nii", np.zeros((5, 4, 3, 1, 2), dtype))
    with pytest.raises(UnsupportedSourceError, match="2 channels of 3 samples"):
        open_source(path)


@pytest.mark.parametrize(("dtype", "labels"), [(np.uint16, True), (np.float32, False)])
def test_nifti_label_intent(tmp_path, dtype, labels):
    path = nifti(tmp_path / "a.nii", np.ones(SHAPE, dtype), 1002)
    with open_source(path) as source:
        assert source.labels == labels


def test_gzip_of_time_steps_is_decoded_once_when_read_in_order(tmp_path, tczyx, monkeypatch):
    path = nifti(tmp_path / "a.nii.gz", np.repeat(tczyx[:, 0].T, 9, axis=0))
    resumed = []
    resume = GzipReader._resume
    monkeypatch.setattr(GzipReader, "_resume", lambda *of: resumed.append(of) or resume(*of))
    with open_source(path) as source:
        _, ny, nx = source.shape_zyx
        for t in range(source.nt):
            for z in range(3):
                source.read_channels(Box((z, 0, 0), (z + 1, ny, nx)), t)
    assert len(resumed) == 1


def test_channels_behind_each_other_are_decoded_about_twice(tmp_path, monkeypatch):
    monkeypatch.setattr("octobrick.store.sources.flat._STAGE_NBYTES", 2000)
    monkeypatch.setattr("octobrick.store.sources.gzip_stream._INPUT_NBYTES", 500)
    monkeypatch.setattr("octobrick.store.sources.gzip_stream._OUTPUT_NBYTES", 500)
    voxels = np.random.default_rng(3).integers(0, 255, (1, 4, 40, 30, 50), np.uint8)
    path = nifti(tmp_path / "a.nii.gz", voxels.transpose(4, 3, 2, 0, 1))
    decoded = []
    decode = GzipReader._decode

    def counted(reader: GzipReader) -> bytes:
        decoded.append(len(data := decode(reader)))
        return data

    monkeypatch.setattr(GzipReader, "_decode", counted)
    with open_source(path) as source:
        for z in range(40):
            read = source.read_channels(Box((z, 0, 0), (z + 1, 30, 50)))
            np.testing.assert_array_equal(read, voxels[0, :, z : z + 1])
        assert sum(decoded) < 2.2 * voxels.size
        for z in (5, 3, 39, 0):
            read = source.read(Box((z, 0, 0), (z + 1, 30, 50)), 0, 2)
            np.testing.assert_array_equal(read[0], voxels[0, 2, z])


def nrrd(path: Path, voxels: np.ndarray, *lines: str, encoding: str = "raw") -> Path:
    """A file of an array indexed slowest first."""
    sizes = " ".join(map(str, voxels.shape[::-1]))
    fields = ["NRRD0005", "type: uint8", f"dimension: {voxels.ndim}", f"sizes: {sizes}"]
    fields += [f"encoding: {encoding}", *lines]
    data = voxels.tobytes() if encoding == "raw" else gzip.compress(voxels.tobytes())
    path.write_bytes("\n".join(fields).encode() + b"\n\n" + data)
    return path


SPACE = "space: left-posterior-superior"
VECTORS = "(1,0,0) (0,2,0) (0,0,3)"


@pytest.mark.parametrize("encoding", ["raw", "gzip"])
@pytest.mark.parametrize(
    ("order", "lines"),
    [
        ("tczyx", ["kinds: domain domain domain list time"]),
        ("tzyxc", ["kinds: vector space space space time"]),
        ("ctzyx", ["kinds: domain domain domain time list", "units: mm mm mm s none"]),
        ("tzyxc", [SPACE, f"space directions: none {VECTORS} none", "kinds: ??? ??? ??? ??? time"]),
    ],
)
def test_nrrd_axes_by_kinds(tmp_path, tczyx, order, lines, encoding):
    stored = tczyx.transpose(["tczyx".index(letter) for letter in order])
    path = nrrd(tmp_path / "a.nrrd", np.ascontiguousarray(stored), *lines, encoding=encoding)
    with open_source(path) as source:
        assert (source.nt, source.nc, source.shape_zyx) == (NT, NC, SHAPE)
        assert not source.is_rgb
        np.testing.assert_array_equal(read_all(source), tczyx)


@pytest.mark.parametrize("kind", ["RGB-color", "3-color"])
def test_nrrd_colours(tmp_path, tczyx, kind):
    stored = np.ascontiguousarray(np.moveaxis(tczyx[0], 0, -1))
    line = f"kinds: {kind} domain domain domain"
    with open_source(nrrd(tmp_path / "a.nrrd", stored, line, "spacings: nan 1 2 3")) as source:
        assert source.is_rgb
        assert source.spacing_zyx == (3.0, 2.0, 1.0)
        np.testing.assert_array_equal(read_all(source), tczyx[:1])


def test_nrrd_leading_axis_outside_space_is_channels(tmp_path, tczyx):
    stored = np.ascontiguousarray(np.moveaxis(tczyx[0], 0, -1))
    lines = (SPACE, f"space directions: none {VECTORS}", "byte skip: -1")
    with open_source(nrrd(tmp_path / "a.nrrd", stored, *lines)) as source:
        assert source.spacing_zyx == (3.0, 2.0, 1.0)
        np.testing.assert_array_equal(read_all(source), tczyx[:1])


def test_nrrd_time_as_an_axis_of_the_world(tmp_path, tczyx):
    lines = (f"{SPACE}-time", "space directions: (1,0,0,0) (0,2,0,0) (0,0,3,0) (0,0,0,9)")
    path = nrrd(
        tmp_path / "a.nrrd", tczyx[:, 0].copy(), *lines, "kinds: space space space time",
        'space units: "mm" "mm" "mm" "s"', "space origin: (1,2,3,4)",
    )  # fmt: skip
    with open_source(path) as source:
        assert (source.nt, source.spacing_zyx) == (NT, (3.0, 2.0, 1.0))
        assert (source.unit, source.origin_xyz) == ("millimeter", (1.0, 2.0, 3.0))
        assert source.direction == ((1, 0, 0), (0, 1, 0), (0, 0, 1))
        np.testing.assert_array_equal(read_all(source), tczyx[:, :1])


@pytest.mark.parametrize(
    "lines", [(), (SPACE, f"space directions: {VECTORS} none")], ids=["nothing", "trailing-none"]
)
def test_nrrd_axes_that_the_header_leaves_open_are_asked_for(tmp_path, tczyx, lines):
    path = nrrd(tmp_path / "a.nrrd", tczyx[:, 0].copy(), *lines)
    with pytest.raises(InvalidInputError, match=r"4 axes.*--axes tzyx"):
        open_source(path)
    with open_source(path, axes="tzyx") as source:
        np.testing.assert_array_equal(read_all(source), tczyx[:, :1])
    with open_source(path, axes="czyx") as source:
        assert (source.nt, source.nc) == (1, NT)
    with pytest.raises(InvalidInputError, match="one letter"):
        open_source(path, axes="zyx")
    with pytest.raises(InvalidInputError, match="--dataset"):
        open_source(path, dataset="a")


def test_nrrd_two_axes_of_channels_are_refused(tmp_path, tczyx):
    path = nrrd(tmp_path / "a.nrrd", tczyx, "kinds: domain domain domain list vector")
    with pytest.raises(UnsupportedSourceError, match="several axes of channels"):
        open_source(path)


def metaimage(path: Path, voxels: np.ndarray, *lines: str) -> Path:
    fields = ["ObjectType = Image", *lines, "ElementType = MET_UCHAR", "ElementDataFile = LOCAL"]
    path.write_bytes("\n".join(fields).encode() + b"\n" + voxels.tobytes())
    return path


def test_metaimage_channels_and_time(tmp_path, tczyx):
    stored = np.ascontiguousarray(np.moveaxis(tczyx, 1, -1))
    path = metaimage(
        tmp_path / "a.mha", stored,
        "NDims = 4", "DimSize = 5 4 3 2", "ElementNumberOfChannels = 3",
        "ElementSpacing = 1 2 3 9", "Offset = 1 2 3 4", "HeaderSize = -1",
        "TransformMatrix = 0 1 0 0 1 0 0 0 0 0 1 0 0 0 0 1",
    )  # fmt: skip
    with open_source(path) as source:
        assert (source.nt, source.nc, source.is_rgb) == (NT, NC, True)
        assert (source.spacing_zyx, source.origin_xyz) == ((3.0, 2.0, 1.0), (1.0, 2.0, 3.0))
        assert source.direction == ((0, 1, 0), (1, 0, 0), (0, 0, 1))
        np.testing.assert_array_equal(read_all(source), tczyx)


def test_metaimage_of_two_channels_is_no_colour(tmp_path, tczyx):
    stored = np.ascontiguousarray(np.moveaxis(tczyx[0, :2], 0, -1))
    lines = ("NDims = 3", "DimSize = 5 4 3", "ElementNumberOfChannels = 2")
    with open_source(metaimage(tmp_path / "a.mha", stored, *lines)) as source:
        assert source.channels == ()
        np.testing.assert_array_equal(read_all(source), tczyx[:1, :2])


def test_channels_beyond_the_file_are_refused_with_both_byte_counts(tmp_path, tczyx):
    lines = ("NDims = 3", "DimSize = 5 4 3", "ElementNumberOfChannels = 999999999999999")
    with pytest.raises(TruncatedSourceError) as caught:
        open_source(metaimage(tmp_path / "a.mha", tczyx, *lines))
    assert caught.value.facts["expected_nbytes"] == 60 * 999_999_999_999_999


@pytest.mark.parametrize("size", [0, -2])
def test_no_time_steps_are_refused(tmp_path, tczyx, size):
    path = nifti(tmp_path / "a.nii", tczyx[:, 0].T)
    content = bytearray(path.read_bytes())
    content[48:50] = np.int16(size).tobytes()
    path.write_bytes(content)
    with pytest.raises(SourceError, match="at least 1"):
        open_source(path)


@pytest.mark.parametrize("name", ["a.nii", "a.nrrd", "a.mha"])
@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_flipped_bytes_are_an_octobrick_error_or_read(tmp_path, tczyx, name, data):
    path = tmp_path / name
    if name == "a.nii":
        nifti(path, tczyx.transpose(4, 3, 2, 0, 1), 1007)
    elif name == "a.nrrd":
        nrrd(
            path,
            tczyx,
            SPACE,
            f"space directions: {VECTORS} none none",
            "kinds: ??? ??? ??? list time",
        )
    else:
        metaimage(path, tczyx, "NDims = 4", "DimSize = 5 4 3 2", "ElementNumberOfChannels = 3")
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 3))):
        content[data.draw(st.integers(0, min(len(content), 360) - 1))] = data.draw(
            st.integers(0, 255)
        )
    path.write_bytes(content)
    with contextlib.suppress(OctobrickError), open_source(path) as source:
        read_all_of_it = source.read_channels(Box.of_shape(source.shape_zyx), source.nt - 1)
        assert read_all_of_it.shape == (source.nc, *source.shape_zyx)


def test_ingest_keeps_time_steps_and_channels(tmp_path, tczyx):
    path = nifti(tmp_path / "a.nii.gz", tczyx.transpose(4, 3, 2, 0, 1))
    ingest(path, tmp_path / "a.zarr", codec=None)
    with open_volume(tmp_path / "a.zarr") as volume:
        read = [[volume.read(0, t=t, c=c) for c in range(volume.nc)] for t in range(volume.nt)]
    np.testing.assert_array_equal(read, tczyx)
