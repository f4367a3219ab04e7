"""Which format a file is of: by its first bytes, and by its name where they do not tell."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from octobrick.codec.errors import InvalidInputError
from octobrick.store.sources.base import Pick, Source
from octobrick.store.sources.dicom import open_dicom_file
from octobrick.store.sources.hdf5 import MAGIC as HDF5_MAGIC
from octobrick.store.sources.hdf5 import open_hdf5
from octobrick.store.sources.metaimage import is_metaimage, open_metaimage
from octobrick.store.sources.nanovdb import is_nanovdb, open_nanovdb
from octobrick.store.sources.nifti import is_nifti, open_nifti
from octobrick.store.sources.npy import MAGIC as NPY_MAGIC
from octobrick.store.sources.npy import open_npy
from octobrick.store.sources.npz import MAGIC as ZIP_MAGIC
from octobrick.store.sources.npz import open_npz
from octobrick.store.sources.nrrd import MAGIC as NRRD_MAGIC
from octobrick.store.sources.nrrd import open_nrrd
from octobrick.store.sources.openvdb import MAGIC as OPENVDB_MAGIC
from octobrick.store.sources.openvdb import open_openvdb
from octobrick.store.sources.tiff import open_tiff
from octobrick.store.sources.tiff_chain import is_tiff
from octobrick.store.sources.zarr_source import SUFFIX as ZARR_SUFFIX
from octobrick.store.sources.zarr_source import open_zarr

# As much as any check below looks at.
HEAD_NBYTES = 1024

RAW_SUFFIXES = (".raw", ".bin", ".dat", ".vol", "")


class Format(NamedTuple):
    """A format that describes itself: its name, endings of file names, and how it is opened."""

    name: str
    suffixes: tuple[str, ...]
    is_it: Callable[[bytes], bool]
    open: Callable[[Path, Pick], Source]


def alone(open_file: Callable[[Path], Source]) -> Callable[[Path, Pick], Source]:
    """The opener of a format whose files hold one volume and name its axes."""

    def open_alone(path: Path, pick: Pick) -> Source:
        if given := pick.given():
            raise InvalidInputError(
                f"{path}: holds one volume and says what its axes are; leave out "
                f"{', '.join(given)}",
                path=str(path),
                options=given,
            )
        return open_file(path)

    return open_alone


# A folder, which has no first bytes; a file of this name is refused.
ZARR = Format("Zarr", (ZARR_SUFFIX,), lambda head: False, open_zarr)  # noqa: ARG005

FORMATS = (
    Format(
        "NIfTI",
        (".nii", ".nii.gz", ".hdr", ".hdr.gz", ".img", ".img.gz"),
        is_nifti,
        alone(open_nifti),
    ),
    Format("NRRD", (".nrrd", ".nhdr"), lambda head: head.startswith(NRRD_MAGIC), open_nrrd),
    Format("MetaImage", (".mhd", ".mha"), is_metaimage, alone(open_metaimage)),
    Format("OpenVDB", (".vdb",), lambda head: head.startswith(OPENVDB_MAGIC), open_openvdb),
    Format("NanoVDB", (".nvdb",), is_nanovdb, open_nanovdb),
    Format("TIFF", (".tif", ".tiff", ".btf", ".tf8"), is_tiff, open_tiff),
    Format("DICOM", (".dcm",), lambda head: head[128:132] == b"DICM", open_dicom_file),
    Format("npy", (".npy",), lambda head: head.startswith(NPY_MAGIC), open_npy),
    Format("npz", (".npz",), lambda head: head.startswith(ZIP_MAGIC), open_npz),
    Format(
        "HDF5",
        (".h5", ".hdf5", ".hdf", ".he5"),
        lambda head: head.startswith(HDF5_MAGIC),
        open_hdf5,
    ),
    ZARR,
)

# Not read, but told by name: offset, bytes, name.
_FOREIGN = (
    (0, b"\x89PNG\r\n", "PNG"),
    (0, b"\xff\xd8\xff", "JPEG"),
    (0, b"BZh", "bzip2 data"),
    (0, b"\xfd7zXZ\0", "xz data"),
    (0, b"\x28\xb5\x2f\xfd", "zstd data"),
)


def recognise(path: Path, head: bytes) -> Format | None:
    """The format of a file.

    Args:
        path: its name is looked at where the bytes do not tell.
        head: its first `HEAD_NBYTES` bytes, decompressed.
    """
    for candidate in FORMATS:
        if candidate.is_it(head):
            return candidate
    name = path.name.lower()
    for candidate in FORMATS:
        if name.endswith(candidate.suffixes):
            return candidate
    return None


def foreign_name(head: bytes) -> str | None:
    """The name of a format that is known but not read."""
    for offset, magic, name in _FOREIGN:
        if head[offset:].startswith(magic):
            return name
    return None


def is_raw_name(path: Path) -> bool:
    """Whether a file is named as raw voxels are, compressed or not."""
    plain = path.with_suffix("") if path.suffix.lower() == ".gz" else path
    return plain.suffix.lower() in RAW_SUFFIXES
