"""Which format a name asks for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from octobrick.codec.errors import InvalidInputError
from octobrick.store.export.nifti import write_nifti
from octobrick.store.export.npy import write_npy
from octobrick.store.export.nrrd import write_nrrd
from octobrick.store.export.ome_zarr import write_ome_zarr
from octobrick.store.export.options import WriterOptions
from octobrick.store.export.region import Region
from octobrick.store.export.tiff import write_tiff
from octobrick.store.export.vdb import write_vdb_grid

Writer = Callable[[Region, Path, WriterOptions], list[str]]


@dataclass(frozen=True, slots=True)
class ExportFormat:
    """A format that is written.

    Attributes:
        name: what results call it.
        suffixes: names that ask for it, the first by custom.
        write: writes a region to a path; returns what the format cannot hold.
        compresses: whether the caller can choose compression.
        is_sparse: whether the caller can choose which voxels are kept.
        is_folder: whether it is a folder of files.
    """

    name: str
    suffixes: tuple[str, ...]
    write: Writer
    compresses: bool = False
    is_sparse: bool = False
    is_folder: bool = False


FORMATS = (
    ExportFormat("npy", (".npy",), write_npy),
    ExportFormat("nrrd", (".nrrd",), write_nrrd, compresses=True),
    ExportFormat("nifti", (".nii", ".nii.gz"), write_nifti),
    ExportFormat("ome-tiff", (".ome.tif", ".tif", ".tiff"), write_tiff, compresses=True),
    ExportFormat("ome-zarr", (".ome.zarr", ".zarr"), write_ome_zarr, is_folder=True),
    ExportFormat("vdb", (".vdb",), write_vdb_grid, is_sparse=True),
)
EXPORT_SUFFIXES = tuple(suffix for format_ in FORMATS for suffix in format_.suffixes)


def format_of(out: Path, options: WriterOptions) -> ExportFormat:
    """The format that a name asks for.

    Raises:
        InvalidInputError: the name ends in none of the suffixes, or an option is given that
            the format does not take.
    """
    name = out.name.lower()
    for format_ in FORMATS:
        if name.endswith(format_.suffixes):
            if options.compress and not format_.compresses:
                raise InvalidInputError(
                    f"{out}: compression cannot be chosen for {format_.name}; leave it out "
                    "(for NIfTI, name the file .nii.gz)",
                    path=str(out),
                )
            if options.active is not None and not format_.is_sparse:
                raise InvalidInputError(
                    f"{out}: {format_.name} keeps all voxels; leave out the active range, or "
                    "export to .vdb",
                    path=str(out),
                )
            return format_
    raise InvalidInputError(
        f"{out}: the name says no format that is written; it must end in one of "
        f"{', '.join(EXPORT_SUFFIXES)}",
        path=str(out),
    )
