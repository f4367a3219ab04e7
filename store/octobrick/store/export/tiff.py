"""OME-TIFF: one page per plane, BigTIFF where 4 GB do not hold it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from octobrick.codec.errors import UnsupportedError
from octobrick.store.export.losses import losses
from octobrick.store.export.options import WriterOptions
from octobrick.store.export.packages import require_package
from octobrick.store.export.region import Region

_DTYPES = ("uint8", "int8", "uint16", "int16", "uint32", "int32", "float32", "float64")
_UNITS = {
    "nanometer": "nm",
    "micrometer": "µm",
    "millimeter": "mm",
    "centimeter": "cm",
    "meter": "m",
}
_UNKNOWN_UNIT = "reference frame"  # without a unit OME means micrometers
_PAGE_NBYTES = 1024  # of tags, generously
_TIFF_NBYTES = 2**32 - 2**20


def write_tiff(region: Region, path: Path, options: WriterOptions) -> list[str]:
    """Write a region plane by plane, as it is or with zlib; returns what OME-TIFF cannot hold.

    Raises:
        UnsupportedError: a sample type that OME does not have.
        ResourceError: tifffile is not installed.
    """
    tifffile = require_package("tifffile", path)
    if region.dtype.name not in _DTYPES:
        raise UnsupportedError(
            f"OME-TIFF has no {region.dtype.name}; export to .npy, .nrrd or .ome.zarr",
            dtype=region.dtype.name,
        )
    nz, ny, _ = region.shape_zyx
    is_big = region.nbytes + nz * _PAGE_NBYTES > _TIFF_NBYTES
    with tifffile.TiffWriter(path, bigtiff=is_big, byteorder="<", ome=True) as writer:
        writer.write(
            _planes(region),
            shape=region.shape_zyx,
            dtype=region.dtype,
            photometric="minisblack",
            compression="zlib" if options.compress else None,
            rowsperstrip=None if options.compress else ny,
            metadata=_metadata(region),
        )
    return losses(region, "OME-TIFF", "direction", "rescale")


def _planes(region: Region) -> Iterator[Any]:
    for slab in region.slabs():
        yield from slab


def _metadata(region: Region) -> dict[str, Any]:
    unit = _UNKNOWN_UNIT if region.unit is None else _UNITS.get(region.unit, _UNKNOWN_UNIT)
    metadata: dict[str, Any] = {"axes": "ZYX", "Name": region.volume.name}
    nplanes = region.shape_zyx[0]
    positions: dict[str, Any] = {}
    for axis, size, start in zip("XYZ", region.spacing_xyz, region.origin_xyz, strict=True):
        metadata[f"PhysicalSize{axis}"] = size
        metadata[f"PhysicalSize{axis}Unit"] = unit
        step = size if axis == "Z" else 0.0
        positions[f"Position{axis}"] = [start + step * z for z in range(nplanes)]
        positions[f"Position{axis}Unit"] = [unit] * nplanes
    if any(region.origin_xyz):
        metadata["Plane"] = positions
    return metadata
