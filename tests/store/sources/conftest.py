"""Small volumes in every format and variant that is read; each variant is one function below.

A new format joins the contract and the fuzzing by adding its writers to ``WRITERS``.
"""

from __future__ import annotations

import gzip
import json
import zlib
from pathlib import Path
from typing import Any

import nibabel
import nrrd
import numpy as np
import pytest

from .sample import READ_DTYPES, SPACING_ZYX, Sample, Writer
from .writers_arrays import WRITERS as ARRAY_WRITERS
from .writers_images import WRITERS as IMAGE_WRITERS
from .writers_nanovdb import NANOVDB_WRITERS
from .writers_openvdb import OPENVDB_WRITERS


def _raw_options(voxels: np.ndarray, **more: Any) -> dict[str, Any]:
    shape = {"shape_zyx": voxels.shape, "dtype": voxels.dtype.name, "spacing_zyx": SPACING_ZYX}
    return shape | more


def raw_little_endian(folder: Path, voxels: np.ndarray) -> Sample:
    path = folder / "a.raw"
    path.write_bytes(voxels.astype(voxels.dtype.newbyteorder("<")).tobytes())
    return Sample(path, voxels, _raw_options(voxels))


def raw_big_endian_with_offset(folder: Path, voxels: np.ndarray) -> Sample:
    path = folder / "a.bin"
    path.write_bytes(b"header!" + voxels.astype(voxels.dtype.newbyteorder(">")).tobytes())
    return Sample(path, voxels, _raw_options(voxels, offset_nbytes=7, big_endian=True))


def raw_gzip(folder: Path, voxels: np.ndarray) -> Sample:
    path = folder / "a.raw.gz"
    path.write_bytes(gzip.compress(voxels.tobytes()))
    return Sample(path, voxels, _raw_options(voxels))


def raw_with_sidecar(folder: Path, voxels: np.ndarray) -> Sample:
    path = folder / "a.raw"
    path.write_bytes(voxels.tobytes())
    description = {
        "shape": voxels.shape,
        "dtype": voxels.dtype.name,
        "spacing_xyz": SPACING_ZYX[::-1],
    }
    (folder / "a.json").write_text(json.dumps(description))
    return Sample(path, voxels)


def npy_c_order(folder: Path, voxels: np.ndarray) -> Sample:
    np.save(folder / "a.npy", voxels)
    return Sample(folder / "a.npy", voxels, {"spacing_zyx": SPACING_ZYX})


def npy_fortran_order_big_endian(folder: Path, voxels: np.ndarray) -> Sample:
    stored = np.asfortranarray(voxels.astype(voxels.dtype.newbyteorder(">")))
    np.save(folder / "a.npy", stored)
    return Sample(folder / "a.npy", voxels, {"spacing_zyx": SPACING_ZYX})


def _nifti_affine() -> np.ndarray:
    return np.diag([*SPACING_ZYX[::-1], 1.0])


def nifti1(folder: Path, voxels: np.ndarray) -> Sample:
    image = nibabel.Nifti1Image(voxels.T, _nifti_affine(), dtype=voxels.dtype)
    nibabel.save(image, folder / "a.nii")
    return Sample(folder / "a.nii", voxels)


def nifti1_big_endian(folder: Path, voxels: np.ndarray) -> Sample:
    header = nibabel.Nifti1Header(endianness=">")
    header.set_data_dtype(voxels.dtype)
    nibabel.save(nibabel.Nifti1Image(voxels.T, _nifti_affine(), header), folder / "a.nii")
    return Sample(folder / "a.nii", voxels)


def nifti1_gzip(folder: Path, voxels: np.ndarray) -> Sample:
    path = folder / "a.nii.gz"
    plain = nifti1(folder, voxels).path
    path.write_bytes(gzip.compress(plain.read_bytes()))
    plain.unlink()
    return Sample(path, voxels)


def nifti1_one_time_step(folder: Path, voxels: np.ndarray) -> Sample:
    image = nibabel.Nifti1Image(voxels.T[..., np.newaxis], _nifti_affine(), dtype=voxels.dtype)
    nibabel.save(image, folder / "a.nii")
    return Sample(folder / "a.nii", voxels)


def nifti1_pair(folder: Path, voxels: np.ndarray) -> Sample:
    image = nibabel.Nifti1Pair(voxels.T, _nifti_affine(), dtype=voxels.dtype)
    nibabel.save(image, folder / "a.img")
    return Sample(folder / "a.hdr", voxels)


def nifti1_pair_gzip(folder: Path, voxels: np.ndarray) -> Sample:
    image = nibabel.Nifti1Pair(voxels.T, _nifti_affine(), dtype=voxels.dtype)
    nibabel.save(image, folder / "a.img.gz")
    return Sample(folder / "a.img.gz", voxels)


def nifti2(folder: Path, voxels: np.ndarray) -> Sample:
    image = nibabel.Nifti2Image(voxels.T, _nifti_affine(), dtype=voxels.dtype)
    nibabel.save(image, folder / "a.nii")
    return Sample(folder / "a.nii", voxels)


def _nrrd(path: Path, voxels: np.ndarray, **header: Any) -> Sample:
    header = {"spacings": list(SPACING_ZYX[::-1])} | header
    nrrd.write(str(path), voxels.T, header)
    return Sample(path, voxels)


def nrrd_raw(folder: Path, voxels: np.ndarray) -> Sample:
    return _nrrd(folder / "a.nrrd", voxels, encoding="raw")


def nrrd_gzip(folder: Path, voxels: np.ndarray) -> Sample:
    return _nrrd(folder / "a.nrrd", voxels, encoding="gzip")


def nrrd_detached(folder: Path, voxels: np.ndarray) -> Sample:
    return _nrrd(folder / "a.nhdr", voxels, encoding="raw")


def nrrd_detached_gzip(folder: Path, voxels: np.ndarray) -> Sample:
    return _nrrd(folder / "a.nhdr", voxels, encoding="gzip")


_NRRD_TYPES = {"float32": "float", "float64": "double"}


def _nrrd_header(voxels: np.ndarray, *lines: str) -> bytes:
    sizes, spacings = voxels.shape[::-1], SPACING_ZYX[::-1]
    fields = [
        "NRRD0004",
        f"type: {_NRRD_TYPES.get(voxels.dtype.name, voxels.dtype.name)}",
        "dimension: 3",
        f"sizes: {sizes[0]} {sizes[1]} {sizes[2]}",
        f"spacings: {spacings[0]} {spacings[1]} {spacings[2]}",
        *lines,
    ]
    return "\n".join(fields).encode() + b"\n"


def nrrd_line_and_byte_skip(folder: Path, voxels: np.ndarray) -> Sample:
    path = folder / "a.nhdr"
    lines = ("encoding: raw", "endian: big", "line skip: 2", "byte skip: 3", "data file: sub/a.raw")
    path.write_bytes(_nrrd_header(voxels, *lines))
    (folder / "sub").mkdir(exist_ok=True)
    stored = voxels.astype(voxels.dtype.newbyteorder(">")).tobytes()
    (folder / "sub" / "a.raw").write_bytes(b"one\ntwo\n123" + stored)
    return Sample(path, voxels)


def nrrd_byte_skip_from_the_end(folder: Path, voxels: np.ndarray) -> Sample:
    path = folder / "a.nrrd"
    header = _nrrd_header(voxels, "encoding: raw", "endian: little", "byteskip: -1")
    path.write_bytes(header + b"\nsomething else first" + voxels.tobytes())
    return Sample(path, voxels)


_MET_TYPES = {
    "uint8": "MET_UCHAR",
    "int8": "MET_CHAR",
    "uint16": "MET_USHORT",
    "int16": "MET_SHORT",
    "float32": "MET_FLOAT",
    "uint32": "MET_UINT",
    "int32": "MET_INT",
    "uint64": "MET_ULONG_LONG",
    "int64": "MET_LONG_LONG",
    "float64": "MET_DOUBLE",
}


def metaimage_header(voxels: np.ndarray, *lines: str) -> bytes:
    sizes, spacings = voxels.shape[::-1], SPACING_ZYX[::-1]
    fields = [
        "ObjectType = Image",
        "NDims = 3",
        f"DimSize = {sizes[0]} {sizes[1]} {sizes[2]}",
        f"ElementSpacing = {spacings[0]} {spacings[1]} {spacings[2]}",
        f"ElementType = {_MET_TYPES[voxels.dtype.name]}",
        *lines,
    ]
    return "\n".join(fields).encode() + b"\n"


def metaimage_local(folder: Path, voxels: np.ndarray) -> Sample:
    path = folder / "a.mha"
    path.write_bytes(metaimage_header(voxels, "ElementDataFile = LOCAL") + voxels.tobytes())
    return Sample(path, voxels)


def metaimage_local_compressed(folder: Path, voxels: np.ndarray) -> Sample:
    path = folder / "a.mha"
    data = zlib.compress(voxels.tobytes())
    lines = (
        "CompressedData = True",
        f"CompressedDataSize = {len(data)}",
        "ElementDataFile = LOCAL",
    )
    path.write_bytes(metaimage_header(voxels, *lines) + data)
    return Sample(path, voxels)


def metaimage_detached_msb(folder: Path, voxels: np.ndarray) -> Sample:
    path = folder / "a.mhd"
    lines = ("BinaryDataByteOrderMSB = True", "HeaderSize = 5", "ElementDataFile = a.raw")
    path.write_bytes(metaimage_header(voxels, *lines))
    stored = voxels.astype(voxels.dtype.newbyteorder(">")).tobytes()
    (folder / "a.raw").write_bytes(b"12345" + stored)
    return Sample(path, voxels)


def metaimage_header_size_from_the_end(folder: Path, voxels: np.ndarray) -> Sample:
    path = folder / "a.mhd"
    path.write_bytes(metaimage_header(voxels, "HeaderSize = -1", "ElementDataFile = a.raw"))
    (folder / "a.raw").write_bytes(b"anything at all" + voxels.tobytes())
    return Sample(path, voxels)


def metaimage_zraw(folder: Path, voxels: np.ndarray) -> Sample:
    path = folder / "a.mhd"
    path.write_bytes(metaimage_header(voxels, "CompressedData = True", "ElementDataFile = a.zraw"))
    (folder / "a.zraw").write_bytes(zlib.compress(voxels.tobytes()))
    return Sample(path, voxels)


WRITERS: tuple[Writer, ...] = (
    raw_little_endian,
    raw_big_endian_with_offset,
    raw_gzip,
    raw_with_sidecar,
    npy_c_order,
    npy_fortran_order_big_endian,
    nifti1,
    nifti1_big_endian,
    nifti1_gzip,
    nifti1_one_time_step,
    nifti1_pair,
    nifti1_pair_gzip,
    nifti2,
    nrrd_raw,
    nrrd_gzip,
    nrrd_detached,
    nrrd_detached_gzip,
    nrrd_line_and_byte_skip,
    nrrd_byte_skip_from_the_end,
    metaimage_local,
    metaimage_local_compressed,
    metaimage_detached_msb,
    metaimage_header_size_from_the_end,
    metaimage_zraw,
    *ARRAY_WRITERS,
    *IMAGE_WRITERS,
    *OPENVDB_WRITERS,
    *NANOVDB_WRITERS,
)
for _writer in WRITERS:
    if _writer.__name__.startswith(("nifti", "nrrd", "metaimage")):
        _writer.dtypes = tuple(name for name in READ_DTYPES if name not in ("bool", "float16"))


def make_voxels(dtype: str, shape_zyx: tuple[int, int, int] = (4, 5, 37)) -> np.ndarray:
    """Voxels that differ from their neighbours and use the whole type."""
    bits = np.random.default_rng(7).integers(0, 256, (*shape_zyx, np.dtype(dtype).itemsize))
    if dtype == "bool":
        return bits[..., 0] > 127
    voxels = bits.astype(np.uint8).view(dtype)[..., 0]
    return np.nan_to_num(voxels) if voxels.dtype.kind == "f" else voxels


@pytest.fixture(params=WRITERS, ids=lambda writer: writer.__name__)
def writer(request: pytest.FixtureRequest) -> Writer:
    """Each writer in turn."""
    return request.param


@pytest.fixture(params=READ_DTYPES)
def dtype(request: pytest.FixtureRequest) -> str:
    """Each sample type that is read."""
    return request.param


@pytest.fixture
def sample(tmp_path: Path, writer: Writer) -> Sample:
    """A file by each writer, of 16-bit voxels (so that byte order counts)."""
    return writer(tmp_path, make_voxels("int16"))


@pytest.fixture
def voxels() -> np.ndarray:
    """Voxels for tests that write a file of their own."""
    return make_voxels("uint16", (3, 4, 5))


@pytest.fixture(params=["buffers-as-shipped", "buffers-tiny"])
def buffers(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Buffers so small that a small file has many seams, and those that are shipped."""
    if request.param == "buffers-tiny":
        monkeypatch.setattr("octobrick.store.sources.flat._STAGE_NBYTES", 2 * 2 * 37)
        monkeypatch.setattr("octobrick.store.sources.flat._READ_COST_NBYTES", 2 * 20)
        monkeypatch.setattr("octobrick.store.sources.gzip_stream._INPUT_NBYTES", 13)
        monkeypatch.setattr("octobrick.store.sources.gzip_stream._OUTPUT_NBYTES", 17)
