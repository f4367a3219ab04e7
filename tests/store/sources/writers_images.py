"""Small volumes as TIFF, folders of pictures and DICOM series, for the contract tests."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tifffile

SPACING_ZYX = (2.5, 0.75, 0.5)


class Written(NamedTuple):
    """A file or folder, the voxels that are in it and what `open_source` must be told about it."""

    path: Path
    voxels: np.ndarray
    options: dict[str, Any]


def _tiff(folder: Path, voxels: np.ndarray, **how: Any) -> Written:
    path = folder / "a.tif"
    tifffile.imwrite(path, voxels, photometric="minisblack", metadata=None, **how)
    return Written(path, voxels, {"spacing_zyx": SPACING_ZYX})


def tiff_strips(folder: Path, voxels: np.ndarray) -> Written:
    path = folder / "a.tif"
    how = {"photometric": "minisblack", "metadata": None, "rowsperstrip": 2}
    with tifffile.TiffWriter(path) as file:
        for plane in voxels:  # one by one, so that pixels are last in the file, not slack
            file.write(plane, contiguous=False, **how)
    return Written(path, voxels, {"spacing_zyx": SPACING_ZYX})


def tiff_deflate_big_endian(folder: Path, voxels: np.ndarray) -> Written:
    how = {"byteorder": ">", "compression": "zlib", "rowsperstrip": 3}
    return _tiff(folder, voxels, **how)


def bigtiff_tiles_lzw(folder: Path, voxels: np.ndarray) -> Written:
    how = {"bigtiff": True, "tile": (16, 16), "compression": "lzw", "predictor": True}
    return _tiff(folder, voxels, **how)


def ome_tiff_zstd(folder: Path, voxels: np.ndarray) -> Written:
    path = folder / "a.ome.tif"
    metadata: dict[str, Any] = {"axes": "ZYX"}
    for axis, size in zip("ZYX", SPACING_ZYX, strict=True):
        metadata |= {f"PhysicalSize{axis}": size, f"PhysicalSize{axis}Unit": "mm"}
    tifffile.imwrite(path, voxels, ome=True, metadata=metadata, compression="zstd")
    return Written(path, voxels, {})


def tiff_slices(folder: Path, voxels: np.ndarray) -> Written:
    path = folder / "slices"
    path.mkdir(exist_ok=True)
    for z, plane in enumerate(voxels):
        how = {"compression": "lzw"} if z % 2 else {}
        tifffile.imwrite(path / f"s{z + 8}.tif", plane, photometric="minisblack", **how)
    return Written(path, voxels, {"spacing_zyx": SPACING_ZYX})


WRITERS = (
    tiff_strips,
    tiff_deflate_big_endian,
    bigtiff_tiles_lzw,
    ome_tiff_zstd,
    tiff_slices,
)
