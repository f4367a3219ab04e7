"""Volumes in other people's formats, behind one small class: `open_source` and `Source`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy.typing as npt

from octobrick.codec.errors import InvalidInputError
from octobrick.store.camera_grid import CameraStep
from octobrick.store.errors import UnsupportedSourceError
from octobrick.store.sources.base import Channel, Description, Pick, Rescale, Source
from octobrick.store.sources.described import (
    RawOptions,
    complete,
    open_described,
    require_spacing,
)
from octobrick.store.sources.dicom import open_dicom
from octobrick.store.sources.formats import (
    FORMATS,
    HEAD_NBYTES,
    ZARR,
    Format,
    foreign_name,
    is_raw_name,
    recognise,
)
from octobrick.store.sources.head import read_head, read_head_inflated
from octobrick.store.sources.light_field import open_light_field
from octobrick.store.sources.location import Location, Url, location_of
from octobrick.store.sources.remote import open_remote
from octobrick.store.sources.several import (
    dicoms_of,
    files_of,
    is_picture,
    is_several,
    pictures_of,
    refuse_folder,
)
from octobrick.store.sources.slices import is_slice, open_slices
from octobrick.store.sources.time_series import open_time_series
from octobrick.store.sources.zarr_source import is_zarr

__all__ = ["Channel", "Description", "Rescale", "Source", "open_source"]


def open_source(
    path: str | os.PathLike[str],
    *,
    shape_zyx: Sequence[int] | None = None,
    dtype: npt.DTypeLike | None = None,
    spacing_zyx: Sequence[float] | None = None,
    offset_nbytes: int = 0,
    big_endian: bool = False,
    dataset: str | None = None,
    axes: str | None = None,
    cameras: CameraStep | None = None,
) -> Source:
    """A volume of any format that is read, open; close it, or use it as a context manager.

    Args:
        path: the file; of a header with a data file of its own, the header; the folder of a Zarr
            array or group; a folder of pictures (the slices of one volume) or DICOM files, or a
            pattern (``*``, ``?``, ``[``) of such files, or of files that are one time step each;
            the address of a Zarr array or group (``http://``, ``https://``, ``s3://``).
        shape_zyx: voxels of a raw file along z, y and x.
        dtype: sample type of a raw file.
        spacing_zyx: distance of voxels; takes the place of what the header says.
        offset_nbytes: where the voxels of a raw file begin (after decompression).
        big_endian: whether a raw file has its most significant bytes first.
        dataset: which volume of a file that holds several.
        axes: the letters of the axes, slowest first, where a format does not name them.
        cameras: given, the pictures of a folder or pattern are the views of a light field.

    Raises:
        SourceNotFoundError: the file, or the data file it names, does not exist.
        SourceUnreachableError: a server does not answer, or refuses to.
        UnsupportedSourceError: a format, sample type or number of axes that is not read.
        SourceError: the file is damaged; `TruncatedSourceError` if it ends too early.
        InvalidInputError: a raw file is not described, or a file that describes itself is.
        ResourceError: the file cannot be opened, or a package is missing.
    """
    location = location_of(path)
    options = RawOptions(shape_zyx, dtype, spacing_zyx, offset_nbytes, big_endian)
    pick = Pick(dataset, axes)
    if cameras is not None:
        return _open_light_field(location, options, pick, cameras)
    if isinstance(location, Url):
        return _open_url(location, options, pick)
    if is_zarr(location):
        return _open_known(ZARR, location, options, pick)
    if is_several(location):
        return _open_several(location, options, pick)
    return _open_file(location, options, pick)


def _open_url(url: Url, options: RawOptions, pick: Pick) -> Source:
    """A Zarr array or image on a server."""
    _refuse_options(url, ZARR.name, options)
    require_spacing(options.spacing_zyx, url)
    return _with_spacing(open_remote(url, pick), options, url)


def _open_light_field(
    location: Location, options: RawOptions, pick: Pick, cameras: CameraStep
) -> Source:
    """A folder or pattern of views."""
    _refuse_options(location, "a light field", options, pick)
    if isinstance(location, Url):
        raise UnsupportedSourceError(f"{location}: the views of a light field are read from files")
    require_spacing(options.spacing_zyx, location)
    return _with_spacing(open_light_field(location, cameras), options, location)


def _open_several(path: Path, options: RawOptions, pick: Pick) -> Source:
    """A folder or pattern: DICOM files as a series, pictures as slices, others as time steps."""
    files = files_of(path)
    dicoms, notes = dicoms_of(path, files)
    if dicoms:
        _refuse_options(path, "DICOM", options)
        return _with_spacing(open_dicom(path, dicoms, pick, notes), options, path)
    if path.is_dir():
        pictures, notes = pictures_of(path, files)
        if not pictures:
            refuse_folder(path, files)
    elif all(is_picture(file) for file in files) and is_slice(files[0]):
        pictures = files
    elif len(files) == 1:
        return _open_file(files[0], options, pick)
    else:
        return open_time_series(path, files, lambda file: _open_file(file, options, pick))
    _refuse_options(path, "slices", options, pick)
    return _with_spacing(open_slices(path, pictures, notes), options, path)


def _open_file(path: Path, options: RawOptions, pick: Pick) -> Source:
    is_gz = path.suffix.lower() == ".gz"
    head = (read_head_inflated if is_gz else read_head)(path, HEAD_NBYTES)
    known = recognise(path, head)
    if known is not None:
        return _open_known(known, path, options, pick)
    options = complete(path, options)
    foreign = foreign_name(head)
    if options.is_complete or (foreign is None and is_raw_name(path)):
        return open_described(path, options)
    raise _unknown(path, foreign)


def _open_known(known: Format, path: Path, options: RawOptions, pick: Pick) -> Source:
    """Open a file that describes itself, of which a caller may only correct the spacing."""
    _refuse_options(path, known.name, options)
    require_spacing(options.spacing_zyx, path)
    return _with_spacing(known.open(path, pick), options, path)


def _refuse_options(
    path: Location, format_name: str, options: RawOptions, pick: Pick | None = None
) -> None:
    """Refuse what a file that describes itself does not need to be told."""
    if given := options.given() + (pick.given() if pick else []):
        raise InvalidInputError(
            f"{path}: is {format_name} and describes itself; leave out {', '.join(given)}",
            path=str(path),
            format=format_name,
            options=given,
        )


def _with_spacing(source: Source, options: RawOptions, path: Location) -> Source:
    """The source with the spacing that a caller gives in place of its own."""
    if options.spacing_zyx is not None:
        try:
            source.spacing_zyx = require_spacing(options.spacing_zyx, path)
        except InvalidInputError:
            source.close()
            raise
    return source


def _unknown(path: Path, foreign: str | None) -> UnsupportedSourceError:
    formats = ", ".join(f"{known.name} ({' '.join(known.suffixes)})" for known in FORMATS)
    looks = (
        f"looks like {foreign}, which is not read" if foreign else "is of no format that is read"
    )
    return UnsupportedSourceError(
        f"{path}: {looks}; those read are {formats} and raw voxels "
        "(described by --shape Z,Y,X --dtype uint16); convert it to one of these",
        path=str(path),
        looks_like=foreign,
    )
