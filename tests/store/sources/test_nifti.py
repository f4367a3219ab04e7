"""NIfTI: geometry against nibabel's own, and what is refused."""

from __future__ import annotations

import gzip
import struct
import sys
from pathlib import Path

import nibabel
import numpy as np
import pytest

from octobrick.codec.errors import ResourceError
from octobrick.store.box import Box
from octobrick.store.errors import (
    SourceError,
    SourceNotFoundError,
    TruncatedSourceError,
    UnsupportedSourceError,
)
from octobrick.store.sources import open_source

RAS_TO_LPS = np.diag([-1.0, -1.0, 1.0])
# Offsets of header fields, from nifti1.h.
DIM, DATATYPE, PIXDIM, VOX_OFFSET, SCL_SLOPE, XYZT_UNITS = 40, 70, 76, 108, 112, 123
QFORM_CODE, QUATERN_B, MAGIC = 252, 256, 344


def rotation() -> np.ndarray:
    """A turn about no axis in particular."""
    a, b = np.deg2rad([20, 35])
    about_z = [[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]]
    about_x = [[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]]
    return np.array(about_z) @ np.array(about_x)


def affine(linear: np.ndarray) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = linear
    matrix[:3, 3] = (10, 20, 30)
    return matrix


def save(path: Path, voxels: np.ndarray, linear: np.ndarray | None = None) -> nibabel.Nifti1Image:
    image = nibabel.Nifti1Image(
        voxels.T, affine(np.eye(3) if linear is None else linear), dtype=voxels.dtype
    )
    nibabel.save(image, path)
    return image


def patch(path: Path, offset: int, data: bytes) -> Path:
    content = bytearray(path.read_bytes())
    content[offset : offset + len(data)] = data
    path.write_bytes(content)
    return path


@pytest.fixture
def nii(tmp_path, voxels):
    save(tmp_path / "a.nii", voxels)
    return tmp_path / "a.nii"


@pytest.mark.parametrize("handedness", [1, -1], ids=["right", "left"])
@pytest.mark.parametrize("codes", [(2, 0), (0, 1), (2, 1)], ids=["sform", "qform", "both"])
def test_direction_is_nibabels_affine_turned_from_ras_to_lps(tmp_path, voxels, handedness, codes):
    linear = rotation() @ np.diag([0.5, 0.75, handedness * 2.0])
    image = save(tmp_path / "a.nii", voxels, linear)
    sform_code, qform_code = codes
    image.set_sform(affine(linear), code=sform_code)
    image.set_qform(affine(linear), code=qform_code)
    nibabel.save(image, tmp_path / "a.nii")
    expected = nibabel.load(tmp_path / "a.nii").affine[:3, :3]
    expected = RAS_TO_LPS @ (expected / np.linalg.norm(expected, axis=0))
    with open_source(tmp_path / "a.nii") as source:
        np.testing.assert_allclose(source.direction, expected, atol=1e-6)
        assert source.spacing_zyx == pytest.approx((2.0, 0.75, 0.5))
        assert source.warnings == ()


def test_direction_has_no_negative_zeros(nii):
    with open_source(nii) as source:
        assert source.direction == ((-1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0))
        assert "-0.0" not in str(source.describe())


def test_no_direction_where_neither_sform_nor_qform_is_set(tmp_path, voxels):
    image = save(tmp_path / "a.nii", voxels)
    image.set_sform(None, code=0)
    image.set_qform(None, code=0)
    nibabel.save(image, tmp_path / "a.nii")
    with open_source(tmp_path / "a.nii") as source:
        assert source.direction is None


def test_sform_that_contradicts_pixdim_is_told(nii):
    patch(nii, PIXDIM + 4, struct.pack("<3f", 3, 3, 3))
    with open_source(nii) as source:
        assert source.spacing_zyx == (3.0, 3.0, 3.0)
        assert "pixdim is used" in source.warnings[0]


def test_quaternion_of_nan_is_told_and_not_used(nii):
    patch(nii, QFORM_CODE, struct.pack("<2h", 1, 0))
    patch(nii, QUATERN_B, struct.pack("<3f", np.nan, 0, 0))
    with open_source(nii) as source:
        assert source.direction is None
        assert "directions" in source.warnings[0]


@pytest.mark.parametrize(
    ("code", "unit"),
    [(0, None), (1, "meter"), (2, "millimeter"), (3, "micrometer"), (10, "millimeter"), (7, None)],
)
def test_unit_comes_from_the_low_bits_of_xyzt_units(nii, code, unit):
    patch(nii, XYZT_UNITS, bytes([code]))
    with open_source(nii) as source:
        assert source.unit == unit


@pytest.mark.parametrize(
    ("slope", "intercept", "rescale"),
    [
        (0, 0, None),
        (1, 0, None),
        (np.nan, np.nan, None),
        (0, np.nan, None),
        (2, -1024, (2.0, -1024.0)),
        (1, 5, (1.0, 5.0)),
        (0.1, 0, (0.1, 0.0)),
    ],
)
def test_rescale_is_told_where_samples_are_not_values(nii, voxels, slope, intercept, rescale):
    patch(nii, SCL_SLOPE, struct.pack("<2f", slope, intercept))
    with open_source(nii) as source:
        assert source.rescale == rescale
        np.testing.assert_array_equal(source.read(Box.of_shape(source.shape_zyx)), voxels)


def test_slope_without_intercept_is_refused(nii):
    patch(nii, SCL_SLOPE, struct.pack("<2f", 2, np.inf))
    with pytest.raises(SourceError, match="scl_inter is inf"):
        open_source(nii)


@pytest.mark.parametrize(("given", "used"), [(-2.0, 2.0), (0.0, 1.0), (np.nan, 1.0), (np.inf, 1.0)])
def test_spacing_that_is_no_size_is_replaced_and_told(nii, given, used):
    patch(nii, PIXDIM + 4, struct.pack("<f", given))
    with open_source(nii) as source:
        assert source.spacing_zyx == (1.0, 1.0, used)
        assert source.warnings[0].startswith("spacing along x is")


def test_float32_spacing_is_told_as_its_shortest_decimal(nii):
    patch(nii, PIXDIM + 4, struct.pack("<f", 0.41))
    with open_source(nii) as source:
        assert source.spacing_zyx[2] == 0.41


def test_offset_zero_stands_for_right_behind_the_header(nii, voxels):
    patch(nii, VOX_OFFSET, struct.pack("<f", 0))
    with open_source(nii) as source:
        np.testing.assert_array_equal(source.read(Box.of_shape(source.shape_zyx)), voxels)


@pytest.mark.parametrize("offset", [-352, 100, 352.5, np.nan, np.inf])
def test_offset_that_is_no_place_for_voxels_is_refused(nii, offset):
    patch(nii, VOX_OFFSET, struct.pack("<f", offset))
    with pytest.raises(SourceError, match="vox_offset"):
        open_source(nii)


def test_offset_beyond_the_file_names_both_byte_counts(nii):
    patch(nii, VOX_OFFSET, struct.pack("<f", 1e9))
    with pytest.raises(TruncatedSourceError, match="0 of 120 bytes") as caught:
        open_source(nii)
    assert caught.value.facts["expected_nbytes"] == 120


def test_header_larger_than_the_data_names_the_file_and_both_byte_counts(nii):
    patch(nii, DIM, struct.pack("<4h", 3, 5, 4, 300))
    with pytest.raises(TruncatedSourceError, match=r"a\.nii.* 120 of 12000 bytes") as caught:
        open_source(nii)
    assert caught.value.facts["actual_nbytes"] == 120


def test_dimensions_that_no_gzip_file_of_this_size_can_hold_are_refused_at_once(nii):
    patch(nii, DIM, struct.pack("<4h", 3, 32767, 32767, 32767))
    path = nii.with_suffix(".nii.gz")
    path.write_bytes(gzip.compress(nii.read_bytes()))
    with pytest.raises(TruncatedSourceError, match="at the very most"):
        open_source(path)


@pytest.mark.parametrize("size", [0, -3])
def test_axis_without_voxels_is_refused_by_name(nii, size):
    patch(nii, DIM, struct.pack("<4h", 3, 5, size, 3))
    with pytest.raises(SourceError, match=f"axis y a size of {size}"):
        open_source(nii)


def test_a_sixth_axis_is_refused_with_what_was_found(nii):
    patch(nii, DIM, struct.pack("<7h", 6, 5, 4, 3, 1, 1, 2))
    with pytest.raises(UnsupportedSourceError, match=r"6 axes of \[5, 4, 3, 1, 1, 2\]"):
        open_source(nii)


@pytest.mark.parametrize("ndim", [0, 8, -1])
def test_impossible_number_of_axes_is_refused(nii, ndim):
    patch(nii, DIM, struct.pack("<h", ndim))
    with pytest.raises(SourceError, match=f"{ndim} axes"):
        open_source(nii)


def test_a_single_picture_is_refused(nii):
    patch(nii, DIM, struct.pack("<h", 2))
    with pytest.raises(UnsupportedSourceError, match="2 axes"):
        open_source(nii)


@pytest.mark.parametrize(("code", "name"), [(32, "complex64"), (1536, "float128")])
def test_sample_type_that_is_no_scalar_of_ours_is_refused_by_name(nii, code, name):
    patch(nii, DATATYPE, struct.pack("<h", code))
    with pytest.raises(UnsupportedSourceError, match=rf"voxels are {name}; those read") as caught:
        open_source(nii)
    assert caught.value.facts["dtype"] == name


def test_unknown_sample_type_is_refused_by_number(nii):
    patch(nii, DATATYPE, struct.pack("<h", 999))
    with pytest.raises(UnsupportedSourceError, match="datatype 999"):
        open_source(nii)


def test_header_that_is_cut_off_names_both_byte_counts(nii):
    nii.write_bytes(nii.read_bytes()[:100])
    with pytest.raises(TruncatedSourceError, match=r"348 bytes.*holds 100"):
        open_source(nii)


def test_nifti2_header_that_is_cut_off_names_both_byte_counts(tmp_path, voxels):
    path = tmp_path / "a.nii"
    nibabel.save(nibabel.Nifti2Image(voxels.T, np.eye(4), dtype=voxels.dtype), path)
    path.write_bytes(path.read_bytes()[:400])
    with pytest.raises(TruncatedSourceError, match="400 of 540 bytes"):
        open_source(path)


def test_wrong_magic_is_refused(nii):
    patch(nii, MAGIC, b"abcd")
    with pytest.raises(SourceError, match="not a NIfTI header"):
        open_source(nii)


def test_analyze_is_refused_by_name(nii):
    with pytest.raises(UnsupportedSourceError, match="Analyze"):
        open_source(patch(nii, MAGIC, bytes(4)))


@pytest.mark.parametrize(("given", "lost"), [("a.hdr", "a.img"), ("a.img", "a.hdr")])
def test_pair_of_which_one_half_is_missing_names_it(tmp_path, voxels, given, lost):
    nibabel.save(nibabel.Nifti1Pair(voxels.T, np.eye(4), dtype=voxels.dtype), tmp_path / "a.img")
    (tmp_path / lost).unlink()
    with pytest.raises(SourceNotFoundError, match=lost):
        open_source(tmp_path / given)


def test_gzip_data_under_a_plain_name_are_read_all_the_same(nii, voxels):
    nii.write_bytes(gzip.compress(nii.read_bytes()))
    with open_source(nii) as source:
        np.testing.assert_array_equal(source.read(Box.of_shape(source.shape_zyx)), voxels)


def test_missing_nibabel_names_the_extra_to_install(nii, monkeypatch):
    monkeypatch.setitem(sys.modules, "nibabel", None)
    with pytest.raises(ResourceError, match=r"pip install 'octobrick\[formats\]'"):
        open_source(nii)
