"""NIfTI in one file, ``.nii`` or ``.nii.gz``; NIfTI-2 where a side is too long for NIfTI-1.

nibabel makes the header; the voxels are streamed behind it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from octobrick.codec.errors import UnsupportedError
from octobrick.store.export.options import WriterOptions
from octobrick.store.export.packages import require_package
from octobrick.store.export.region import Region
from octobrick.store.export.stream import gzip_writer, write_voxels

_NIFTI1_SIDE_MAX = 2**15 - 1
_CODES = {
    "uint8": 2,
    "int16": 4,
    "int32": 8,
    "float32": 16,
    "float64": 64,
    "int8": 256,
    "uint16": 512,
    "uint32": 768,
    "int64": 1024,
    "uint64": 1280,
}
# The code of the unit that is written, and how many of it one of ours is.
_UNITS = {
    "meter": (1, 1.0),
    "centimeter": (2, 10.0),
    "millimeter": (2, 1.0),
    "micrometer": (3, 1.0),
    "nanometer": (3, 1e-3),
}
_SCANNER, _ALIGNED = 1, 2  # codes of what an affine leads to
_RAS_OF_LPS = np.diag([-1.0, -1.0, 1.0])


def write_nifti(region: Region, path: Path, options: WriterOptions) -> list[str]:  # noqa: ARG001
    """Write a region with its affine in RAS; returns what NIfTI cannot hold.

    Raises:
        UnsupportedError: a sample type that NIfTI does not have.
        ResourceError: nibabel is not installed.
    """
    header, notes = _header(region, path)
    with path.open("wb") as file:
        if path.name.lower().endswith(".gz"):
            with gzip_writer(file) as compressed:
                compressed.write(header)
                write_voxels(compressed, region)  # type: ignore[arg-type]
        else:
            file.write(header)
            write_voxels(file, region)
    return notes


def _header(region: Region, path: Path) -> tuple[bytes, list[str]]:
    nibabel = require_package("nibabel", path)
    if region.dtype.name not in _CODES:
        raise UnsupportedError(
            f"NIfTI has no {region.dtype.name}; export to .npy, .nrrd, .tif or .ome.zarr",
            dtype=region.dtype.name,
        )
    is_long = max(region.shape_zyx) > _NIFTI1_SIDE_MAX
    header: Any = nibabel.Nifti2Header() if is_long else nibabel.Nifti1Header()
    header["datatype"] = _CODES[region.dtype.name]
    header["bitpix"] = region.dtype.itemsize * 8
    header["dim"] = [3, *reversed(region.shape_zyx), 1, 1, 1, 1]
    header["vox_offset"] = header.sizeof_hdr + 4
    header["scl_slope"], header["scl_inter"] = region.rescale or (1.0, 0.0)
    unit, scale, notes = _unit(region.unit)
    header["xyzt_units"] = unit
    _place(header, region, scale)
    # What follows the header tells of extensions: there are none.
    block: bytes = header.as_byteswapped("<").binaryblock
    return block + bytes(4), notes


def _place(header: Any, region: Region, scale: float) -> None:
    """Spacing and, where anything is known of it, the affine; in the unit of the file."""
    spacing_xyz = np.array(region.spacing_xyz) * scale
    axes = np.eye(3) if region.direction is None else region.direction
    affine = np.eye(4)
    affine[:3, :3] = _RAS_OF_LPS @ axes * spacing_xyz
    affine[:3, 3] = _RAS_OF_LPS @ np.array(region.origin_xyz) * scale
    if region.direction is not None or any(region.origin_xyz):
        code = _ALIGNED if region.direction is None else _SCANNER
        header.set_sform(affine + 0.0, code)
        header.set_qform(affine + 0.0, code, strip_shears=True)
    header["pixdim"][1:4] = spacing_xyz
    header["pixdim"][4:] = 1


def _unit(unit: str | None) -> tuple[int, float, list[str]]:
    if unit is None:
        return 0, 1.0, []
    if unit in _UNITS:
        return *_UNITS[unit], []
    return 0, 1.0, [f"NIfTI has no unit {unit}; the numbers are in it all the same"]
