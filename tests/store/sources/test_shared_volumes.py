"""Real volumes of others: opened as their list says, and one slab against another reader."""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import nibabel
import nrrd
import numpy as np
import pytest
import tifffile
from PIL import Image

from octobrick.store.box import Box
from octobrick.store.sources import open_source

DATA = Path(__file__).resolve().parents[4] / "shared" / "data"
pytestmark = [
    pytest.mark.shared,
    pytest.mark.skipif(not DATA.is_dir(), reason="no real volumes beside the checkout"),
]


class Listed(NamedTuple):
    """A row of the list of that folder, and a reader that is not ours."""

    file: str
    shape_xyz: tuple[int, int, int]
    dtype: str
    spacing_xyz: tuple[float, float, float]
    read: Callable[[Path], np.ndarray]


def by_nibabel(path: Path) -> np.ndarray:
    return np.asanyarray(nibabel.load(path).dataobj).T


def by_pynrrd(path: Path) -> np.ndarray:
    return nrrd.read(str(path), index_order="C")[0]


def by_zlib(path: Path) -> np.ndarray:
    data = zlib.decompress(path.with_suffix(".zraw").read_bytes())
    return np.frombuffer(data, np.uint8).reshape(234, 512, 512)


def by_gzip(dtype: str, shape: tuple[int, int, int]) -> Callable[[Path], np.ndarray]:
    return lambda path: np.frombuffer(gzip.decompress(path.read_bytes()), dtype).reshape(shape)


LISTED = (
    Listed("ct_cranium.nrrd", (256, 256, 108), "int16", (0.957, 0.957, 1.5), by_pynrrd),
    Listed("ct_vhf_head.mhd", (512, 512, 234), "uint8", (0.977, 0.977, 1.0), by_zlib),
    Listed("ct_bonsai.nii.gz", (256, 256, 256), "uint8", (1, 1, 1), by_nibabel),
    Listed("mri_vs_t1c.nii.gz", (512, 512, 120), "uint16", (0.410, 0.410, 1.5), by_nibabel),
    Listed("mri_stroke_t1.nii.gz", (124, 160, 140), "uint8", (1, 1, 1), by_nibabel),
    Listed("mra_avf_f32.nrrd", (74, 93, 20), "float32", (0.723, 0.723, 1.0), by_pynrrd),
    Listed("sim_heptane.nii.gz", (302, 302, 302), "uint8", (1, 1, 1), by_nibabel),
    Listed(
        "sim_lcdm.raw.gz", (128, 128, 128), "uint8", (1, 1, 1), by_gzip("uint8", (128, 128, 128))
    ),
    Listed(
        "tv_viscous_run01/t050.raw.gz",
        (64, 64, 64),
        "float32",
        (1, 1, 1),
        by_gzip("float32", (64, 64, 64)),
    ),
)


@pytest.mark.parametrize("listed", LISTED, ids=lambda listed: listed.file)
def test_real_volume_is_as_listed_and_a_slab_equals_another_reader(listed):
    with open_source(DATA / listed.file) as source:
        assert source.shape_zyx == listed.shape_xyz[::-1]
        assert source.dtype == listed.dtype
        assert source.spacing_zyx[::-1] == pytest.approx(listed.spacing_xyz, abs=1e-3)
        assert source.warnings == ()
        nz, ny, nx = source.shape_zyx
        slab = Box((nz // 2, 0, 0), (nz // 2 + 8, ny, nx))
        np.testing.assert_array_equal(
            source.read(slab), listed.read(DATA / listed.file)[slab.slices]
        )


@pytest.mark.parametrize(
    ("file", "shape_zyx", "nc"),
    [
        ("rgb_histology.tif", (35, 670, 1024), 3),
        ("fluor_mousebrain_u16.tif", (270, 193, 271), 1),
        ("em_fib25_train1.tif", (250, 250, 250), 1),
    ],
)
def test_real_tiff_stack_equals_its_pages(file, shape_zyx, nc):
    with open_source(DATA / file) as source:
        assert (source.shape_zyx, source.nc, source.is_rgb) == (shape_zyx, nc, nc == 3)
        _, ny, nx = shape_zyx
        read = source.read_channels(Box((7, 0, 0), (9, ny, nx)))
    for z in range(2):
        page = tifffile.imread(DATA / file, key=7 + z).reshape(ny, nx, nc)
        np.testing.assert_array_equal(read[:, z], page.transpose(2, 0, 1))


@pytest.mark.parametrize(
    ("folder", "shape_zyx"),
    [("lightfield_grid16", (256, 256, 384)), ("lightfield_row13", (27, 640, 960))],
)
def test_real_slices_equal_each_picture(folder, shape_zyx):
    with open_source(DATA / folder) as source:
        assert (source.shape_zyx, source.is_rgb) == (shape_zyx, True)
        _, ny, nx = shape_zyx
        read = source.read_channels(Box((11, 0, 0), (12, ny, nx)))[:, 0]
        picture = np.asarray(Image.open(source.files[11]))
    np.testing.assert_array_equal(read, picture.transpose(2, 0, 1))
