"""Exports to .npy, NRRD, NIfTI and OME-TIFF: voxels and their place come back as they were."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import nibabel
import nrrd
import numpy as np
import pytest
import tifffile

from octobrick.codec.errors import InvalidInputError
from octobrick.store import Box, Volume, ingest
from octobrick.store.export import export, ome_zarr, tiff
from octobrick.store.export import region as regions
from octobrick.store.sources import open_source

from .conftest import DIRECTION, ORIGIN_XYZ, SPACING_XYZ, steps

Lossless = Callable[..., Volume]
SHAPE = (37, 29, 43)
BOX = Box((5, 17, 2), (36, 20, 40))
LPS_OF_RAS = np.diag([-1.0, -1.0, 1.0])
FLAT = (".npy", ".nrrd", ".nii", ".nii.gz", ".tif", ".ome.tif")


def read_back(path: Path) -> Any:
    if path.suffix in (".tif", ".tiff"):
        return tifffile.imread(path)
    with open_source(path) as source:
        return source.read(Box.of_shape(source.shape_zyx))


@pytest.mark.parametrize("suffix", FLAT)
@pytest.mark.parametrize("dtype", ["uint8", "int8", "uint16", "int16", "float32"])
def test_voxels_come_back(tmp_path: Path, lossless: Lossless, dtype: str, suffix: str) -> None:
    voxels = steps(SHAPE, dtype)
    out = tmp_path / f"out{suffix}"
    with lossless(voxels) as volume:
        result = export(volume, out)
    np.testing.assert_array_equal(read_back(out), voxels, strict=True)
    assert result.nbytes == out.stat().st_size
    assert (result.shape_zyx, result.dtype, result.levels) == (SHAPE, dtype, 1)
    assert sorted(path.name for path in tmp_path.iterdir()) == [out.name, "v.zarr"]


@pytest.mark.parametrize("suffix", FLAT)
def test_a_box_and_a_level_are_that_box_of_that_level(
    tmp_path: Path, lossless: Lossless, suffix: str
) -> None:
    out, coarse = tmp_path / f"box{suffix}", tmp_path / f"coarse{suffix}"
    voxels = steps(SHAPE)
    with lossless(voxels) as volume:
        export(volume, out, box=BOX)
        export(volume.path, coarse, level=1)
        np.testing.assert_array_equal(read_back(coarse), volume.read(1))
    np.testing.assert_array_equal(read_back(out), voxels[BOX.slices])


@pytest.mark.parametrize("suffix", [".nrrd", ".nii", ".nii.gz"])
@pytest.mark.parametrize("level", [0, 1])
def test_spacing_unit_and_direction_come_back(
    tmp_path: Path, lossless: Lossless, suffix: str, level: int
) -> None:
    out = tmp_path / f"out{suffix}"
    with lossless(steps(SHAPE)) as volume:
        export(volume, out, level=level)
    with open_source(out) as source:
        expected = tuple(size * 2**level for size in reversed(SPACING_XYZ))
        np.testing.assert_allclose(source.spacing_zyx, expected, rtol=1e-6)
        assert source.unit == "millimeter"
        np.testing.assert_allclose(source.direction, DIRECTION, atol=1e-6)
        shift = DIRECTION @ (np.array(SPACING_XYZ) * (2**level - 1) / 2)
        np.testing.assert_allclose(source.origin_xyz, ORIGIN_XYZ + shift, rtol=1e-6)
        assert source.warnings == ()


@pytest.mark.parametrize(("level", "box"), [(0, None), (0, BOX), (1, None)])
def test_a_voxel_stays_where_it_is_in_the_world(
    tmp_path: Path, lossless: Lossless, level: int, box: Box | None
) -> None:
    with lossless(steps(SHAPE)) as volume:
        result = export(volume, tmp_path / "out.nii", level=level, box=box)
        export(volume, tmp_path / "out.nrrd", level=level, box=box)
    start_xyz = np.array(box.start_zyx[::-1] if box else (0, 0, 0))
    # In voxels of level 0; a coarser voxel's centre is between finer ones.
    index = start_xyz * 2**level + (2**level - 1) / 2
    expected = ORIGIN_XYZ + DIRECTION @ (index * SPACING_XYZ)
    np.testing.assert_allclose(result.origin_xyz, expected)
    affine = nibabel.load(tmp_path / "out.nii").affine
    np.testing.assert_allclose(LPS_OF_RAS @ affine[:3, 3], expected, rtol=1e-6)
    header = nrrd.read_header(str(tmp_path / "out.nrrd"))
    np.testing.assert_allclose(header["space origin"], expected)


def test_nifti_says_the_same_by_sform_and_qform(tmp_path: Path, lossless: Lossless) -> None:
    with lossless(steps(SHAPE)) as volume:
        export(volume, tmp_path / "out.nii")
    image = nibabel.load(tmp_path / "out.nii")
    np.testing.assert_allclose(image.get_qform(), image.get_sform(), atol=1e-5)
    np.testing.assert_allclose(image.header.get_zooms(), SPACING_XYZ)
    assert image.shape == SHAPE[::-1]


def test_a_nifti_source_keeps_its_rescale(tmp_path: Path, ingested: Lossless) -> None:
    image = nibabel.Nifti1Image(steps((5, 6, 7), "int16"), np.diag([2.0, 2, 2, 1]))
    image.header.set_slope_inter(0.5, -3)
    nibabel.save(image, tmp_path / "scaled.nii")
    with open_source(tmp_path / "scaled.nii") as source:
        rescale = source.rescale
    assert rescale is not None
    ingest(tmp_path / "scaled.nii", tmp_path / "scaled.zarr", codec=None)
    export(tmp_path / "scaled.zarr", tmp_path / "again.nii.gz")
    with open_source(tmp_path / "again.nii.gz") as source:
        assert source.rescale == rescale
    (warning,) = export(tmp_path / "scaled.zarr", tmp_path / "again.nrrd").warnings
    assert "rescale" in warning


def test_ome_tiff_says_size_and_place(tmp_path: Path, lossless: Lossless) -> None:
    with lossless(steps(SHAPE)) as volume:
        result = export(volume, tmp_path / "out.tif")
    with tifffile.TiffFile(tmp_path / "out.tif") as tiff:
        assert not tiff.is_bigtiff
        assert len(tiff.pages) == SHAPE[0]
        assert tiff.series[0].axes == "ZYX"
        image = tifffile.xml2dict(tiff.ome_metadata)["OME"]["Image"]
    pixels = image["Pixels"]
    assert [pixels[f"PhysicalSize{axis}"] for axis in "XYZ"] == list(SPACING_XYZ)
    assert {pixels[f"PhysicalSize{axis}Unit"] for axis in "XYZ"} == {"mm"}
    assert [pixels["Plane"][0][f"Position{axis}"] for axis in "XYZ"] == list(result.origin_xyz)
    assert any("direction" in text for text in result.warnings)


def test_npy_tells_what_it_cannot_hold(tmp_path: Path, lossless: Lossless) -> None:
    with lossless(steps(SHAPE)) as volume:
        (warning,) = export(volume, tmp_path / "out.npy").warnings
    for word in ("spacing", "millimeter", "direction"):
        assert word in warning


@pytest.mark.parametrize("suffix", [".nrrd", ".tif"])
def test_compression_can_be_chosen(tmp_path: Path, lossless: Lossless, suffix: str) -> None:
    voxels = steps(SHAPE)
    plain, small = tmp_path / f"plain{suffix}", tmp_path / f"small{suffix}"
    with lossless(voxels) as volume:
        export(volume, plain)
        export(volume, small, compress=True)
        with pytest.raises(InvalidInputError, match="compression"):
            export(volume, tmp_path / "no.npy", compress=True)
    np.testing.assert_array_equal(read_back(small), voxels)
    assert small.stat().st_size < 0.8 * plain.stat().st_size


@pytest.mark.parametrize("suffix", FLAT)
def test_thin_slabs_and_threads_change_nothing(
    tmp_path: Path, lossless: Lossless, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = tmp_path / f"a{suffix}", tmp_path / f"b{suffix}"
    with lossless(steps(SHAPE)) as volume:
        export(volume, first, workers=1)
        monkeypatch.setattr(regions, "_SLAB_NBYTES", 29 * 43 * 2 * 3)
        export(volume, second, workers=3)
    if suffix.endswith(".tif"):  # OME-XML holds an identifier that is new each time
        np.testing.assert_array_equal(read_back(first), read_back(second))
    else:
        assert first.read_bytes() == second.read_bytes()


@pytest.mark.parametrize("suffix", FLAT)
@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 5, 9), (4, 1, 1)])
def test_small_shapes_come_back(
    tmp_path: Path, lossless: Lossless, suffix: str, shape: tuple[int, int, int]
) -> None:
    voxels = steps(shape)
    with lossless(voxels) as volume:
        export(volume, tmp_path / f"out{suffix}")
    back = read_back(tmp_path / f"out{suffix}")
    np.testing.assert_array_equal(back.reshape(shape), voxels)


def test_long_sides_make_nifti_2(tmp_path: Path, lossless: Lossless) -> None:
    voxels = steps((1, 2, 40_000), "uint8")
    with lossless(voxels, brick=64) as volume:
        export(volume, tmp_path / "long.nii")
    with open_source(tmp_path / "long.nii") as source:
        assert source.format == "nifti-2"
        np.testing.assert_array_equal(source.read(Box.of_shape(voxels.shape)), voxels)


def test_a_volume_without_a_place_has_none_afterwards(
    tmp_path: Path, ingested: Callable[..., Volume]
) -> None:
    with ingested(steps(SHAPE), codec=None) as volume:
        for suffix in (".nii", ".nrrd"):
            export(volume, tmp_path / f"out{suffix}")
            with open_source(tmp_path / f"out{suffix}") as source:
                assert source.direction is None
                assert source.unit is None
                assert source.origin_xyz == (0, 0, 0)
                assert source.warnings == ()


def test_what_4_gb_do_not_hold_is_bigtiff(
    tmp_path: Path, lossless: Lossless, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tiff, "_TIFF_NBYTES", 37 * (29 * 43 * 2 + 1024) - 1)
    voxels = steps(SHAPE)
    with lossless(voxels) as volume:
        export(volume, tmp_path / "out.tif")
    with tifffile.TiffFile(tmp_path / "out.tif") as file:
        assert file.is_bigtiff
        np.testing.assert_array_equal(file.asarray(), voxels)


@pytest.mark.parametrize("suffix", [*FLAT, ".ome.zarr"])
def test_memory_is_that_of_a_layer_not_of_the_volume(
    tmp_path: Path, lossless: Lossless, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ome_zarr, "_SHARD_SIDE", 64)
    voxels = steps((512, 128, 128))
    with lossless(voxels, brick=32) as volume:
        export(volume, tmp_path / f"warm{suffix}", level=3)  # what is imported does not count
        tracemalloc.start()
        try:
            export(volume, tmp_path / f"out{suffix}", workers=1)
            peak_nbytes = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
    assert peak_nbytes < voxels.nbytes / 3
