"""Small volumes as TIFF, folders of pictures and DICOM series, for the contract tests."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from pydicom import Dataset, dcmwrite
from pydicom.dataset import FileMetaDataset
from pydicom.uid import ExplicitVRBigEndian, ExplicitVRLittleEndian, generate_uid

from .sample import SPACING_ZYX, Sample


def _tiff(folder: Path, voxels: np.ndarray, **how: Any) -> Sample:
    path = folder / "a.tif"
    tifffile.imwrite(path, voxels, photometric="minisblack", metadata=None, **how)
    return Sample(path, voxels, {"spacing_zyx": SPACING_ZYX})


def tiff_strips(folder: Path, voxels: np.ndarray) -> Sample:
    path = folder / "a.tif"
    how = {"photometric": "minisblack", "metadata": None, "rowsperstrip": 2}
    with tifffile.TiffWriter(path) as file:
        for plane in voxels:  # one by one, so that pixels are last in the file, not slack
            file.write(plane, contiguous=False, **how)
    return Sample(path, voxels, {"spacing_zyx": SPACING_ZYX})


def tiff_deflate_big_endian(folder: Path, voxels: np.ndarray) -> Sample:
    how = {"byteorder": ">", "compression": "zlib", "rowsperstrip": 3}
    return _tiff(folder, voxels, **how)


def bigtiff_tiles_lzw(folder: Path, voxels: np.ndarray) -> Sample:
    how = {"bigtiff": True, "tile": (16, 16), "compression": "lzw", "predictor": True}
    return _tiff(folder, voxels, **how)


def ome_tiff_zstd(folder: Path, voxels: np.ndarray) -> Sample:
    path = folder / "a.ome.tif"
    metadata: dict[str, Any] = {"axes": "ZYX"}
    for axis, size in zip("ZYX", SPACING_ZYX, strict=True):
        metadata |= {f"PhysicalSize{axis}": size, f"PhysicalSize{axis}Unit": "mm"}
    tifffile.imwrite(path, voxels, ome=True, metadata=metadata, compression="zstd")
    return Sample(path, voxels, {})


def tiff_slices(folder: Path, voxels: np.ndarray) -> Sample:
    path = folder / "slices"
    path.mkdir(exist_ok=True)
    for z, plane in enumerate(voxels):
        how = {"compression": "lzw"} if z % 2 else {}
        tifffile.imwrite(path / f"s{z + 8}.tif", plane, photometric="minisblack", **how)
    return Sample(path, voxels, {"spacing_zyx": SPACING_ZYX})


def dicom_file(path: Path, plane: np.ndarray, z: float = 0.0, **more: Any) -> Dataset:
    """One file: a plane, or frames, (z, y, x) with further keywords as elements."""
    _, size_y, size_x = SPACING_ZYX
    made = Dataset()
    made.SOPClassUID = "1.2.840.10008.5.1.4.1.1.2"
    made.SOPInstanceUID = more.pop("SOPInstanceUID", None) or generate_uid()
    made.SeriesInstanceUID = "1.2.3"
    made.Modality, made.InstanceNumber = "CT", 1
    made.ImagePositionPatient = [10.0, 20.0, z]
    made.ImageOrientationPatient = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    made.PixelSpacing = [size_y, size_x]
    made.SamplesPerPixel, made.PhotometricInterpretation = 1, "MONOCHROME2"
    made.Rows, made.Columns = plane.shape[-2:]
    made.BitsAllocated = made.BitsStored = plane.dtype.itemsize * 8
    made.HighBit = made.BitsStored - 1
    made.PixelRepresentation = int(plane.dtype.kind == "i")
    syntax = more.pop("syntax", ExplicitVRLittleEndian)
    pixels = more.pop("pixels", None)
    for name, value in more.items():
        setattr(made, name, value)
    order = ">" if syntax == ExplicitVRBigEndian else "<"
    data = plane.astype(plane.dtype.newbyteorder(order)).tobytes()
    if pixels is not None:
        made.PixelData = pixels
        made["PixelData"].VR = "OB"
        made["PixelData"].is_undefined_length = True
    elif plane.dtype.kind == "f":
        made.FloatPixelData = data
    else:
        made.PixelData = data + b"\0" * (len(data) % 2)
        made["PixelData"].VR = "OW" if plane.dtype.itemsize > 1 else "OB"
    made.file_meta = FileMetaDataset()
    made.file_meta.TransferSyntaxUID = syntax
    made.file_meta.MediaStorageSOPClassUID = made.SOPClassUID
    made.file_meta.MediaStorageSOPInstanceUID = made.SOPInstanceUID
    dcmwrite(path, made, enforce_file_format=True)
    return made


def dicom_series(folder: Path, voxels: np.ndarray) -> Sample:
    """Names and numbers run against the positions, as from many scanners."""
    path = folder / "series"
    path.mkdir(exist_ok=True)
    for z, plane in enumerate(voxels):
        dicom_file(path / f"IM{99 - z}", plane, SPACING_ZYX[0] * z, InstanceNumber=99 - z)
    return Sample(path, voxels, {})


WRITERS = (
    tiff_strips,
    tiff_deflate_big_endian,
    bigtiff_tiles_lzw,
    ome_tiff_zstd,
    tiff_slices,
    dicom_series,
)

# Horizontal prediction of LZW is for numbers of up to 32 bits, OME and DICOM name no others either.
_UP_TO_32 = ("uint8", "int8", "uint16", "int16", "uint32", "int32", "float32")
bigtiff_tiles_lzw.dtypes = (*_UP_TO_32, "float16", "float64")
ome_tiff_zstd.dtypes = (*_UP_TO_32, "bool", "float64")
dicom_series.dtypes = _UP_TO_32
