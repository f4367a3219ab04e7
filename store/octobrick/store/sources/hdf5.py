"""HDF5: one dataset of a file, read by region through h5py.

The HDF5 library serves one call at a time, so reads take turns. Nothing outside the file is
opened: links, virtual datasets and external storage that lead there are refused.
"""

from __future__ import annotations

import posixpath
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from octobrick.codec.errors import InvalidInputError
from octobrick.store.errors import SourceError, TruncatedSourceError, UnsupportedSourceError
from octobrick.store.sources.array import ArraySource, require_chunk
from octobrick.store.sources.axes import LETTERS, Axes, axes_of
from octobrick.store.sources.base import Description, Pick, Source, Vector
from octobrick.store.sources.head import missing_package, parsing, printable, require_file
from octobrick.store.sources.voxels import READ_DTYPES, clean_spacing, require_dtype

MAGIC = b"\x89HDF\r\n\x1a\n"
_LOCK = threading.Lock()
_LISTED = 20
_VISITED = 100_000
_LINKS = 32


def open_hdf5(path: Path, pick: Pick) -> Source:
    """One dataset: at the path ``pick.dataset`` in the file, or the only one of 3 and more axes.

    Raises:
        SourceError: the file is damaged.
        InvalidInputError: several datasets and no path, no dataset at it, or axes that do not fit.
        UnsupportedSourceError: no dataset to read, one that leads out of the file, or a sample
            type that is not read.
        ResourceError: h5py is not installed.
    """
    try:
        import h5py  # in the extra "formats"
    except ImportError as error:
        raise missing_package("h5py", path) from error
    require_file(path)
    with _LOCK:
        with parsing(path, "HDF5"):
            file = _open(h5py, path)
        try:
            with parsing(path, "HDF5"):
                name = _find(h5py, file, path) if pick.dataset is None else pick.dataset
                dataset = _dataset_at(h5py, file, name, path)
                description, axes = _describe(dataset, pick.axes, path)
        except BaseException:
            file.close()
            raise
    return Hdf5Source(path, description, axes, file, dataset)


class Hdf5Source(ArraySource):
    """A source that is one dataset of an HDF5 file."""

    def __init__(
        self, path: Path, description: Description, axes: Axes, file: Any, dataset: Any
    ) -> None:
        super().__init__(path, description, axes)
        self._file = file
        self._dataset = dataset if dataset.dtype.isnative else dataset.astype(self.dtype)

    def _select(self, index: tuple[int | slice, ...]) -> npt.NDArray[Any]:
        with _LOCK:
            return np.asarray(self._dataset[index])

    def _close(self) -> None:
        with _LOCK:
            self._file.close()


def _open(h5py: Any, path: Path) -> Any:
    """The file, without a lock on it: a reader must not keep others out, nor need a lock file."""
    try:
        return h5py.File(path, "r", locking=False)
    except OSError as error:
        if "truncated" in str(error):
            raise TruncatedSourceError(
                f"{path}: the HDF5 file is cut short ({printable(str(error))}); "
                "copy or export it again",
                path=str(path),
            ) from error
        raise


def _find(h5py: Any, file: Any, path: Path) -> str:
    """The path of the only dataset that looks like a volume; links are not followed."""
    found: list[tuple[str, tuple[int, ...], str]] = []
    visited = 0

    def visit(name: str, item: Any) -> bool | None:
        nonlocal visited
        visited += 1
        is_volume = (
            isinstance(item, h5py.Dataset)
            and item.shape is not None
            and len(item.shape) >= 3
            and item.dtype.name in READ_DTYPES
        )
        if is_volume:
            found.append((name, item.shape, item.dtype.name))
        return True if visited >= _VISITED or len(found) > _LISTED else None

    file.visititems(visit)
    if len(found) == 1:
        return found[0][0]
    if not found:
        raise UnsupportedSourceError(
            f"{path}: no dataset of 3 or more axes of numbers among {visited} objects; "
            "name one with --dataset PATH",
            path=str(path),
        )
    listed = ", ".join(
        f"{printable(name)} {list(shape)} {dtype}" for name, shape, dtype in found[:_LISTED]
    )
    more = " and more" if len(found) > _LISTED else ""
    raise InvalidInputError(
        f"{path}: holds several datasets: {listed}{more}; choose one with --dataset PATH",
        path=str(path),
        datasets=[name for name, _, _ in found[:_LISTED]],
    )


def _dataset_at(h5py: Any, file: Any, name: str, path: Path) -> Any:
    """The dataset at a path, reached by links that stay in the file."""
    item = _follow(h5py, file, name, path)
    if not isinstance(item, h5py.Dataset) or item.shape is None:
        raise InvalidInputError(
            f"{path}: no dataset at {printable(name)!r}; look with: h5ls -r {path.name}",
            path=str(path),
            dataset=printable(name),
        )
    leaves = bool(item.external) or (
        item.is_virtual and any(source.file_name != "." for source in item.virtual_sources())
    )
    if leaves:
        raise _outside(path, name, "its elements are")
    return item


def _follow(h5py: Any, file: Any, name: str, path: Path) -> Any:
    """What is at a path; None where there is nothing."""
    parts = [part for part in name.split("/") if part]
    at, nlinks = "/", 0
    while parts:
        group = file[at]
        if not isinstance(group, h5py.Group):
            return None
        part = parts.pop(0)
        link = group.get(part, getlink=True)
        if link is None:
            return None
        if isinstance(link, h5py.ExternalLink):
            raise _outside(path, name, f"{printable(part)} links to {printable(link.filename)},")
        if not isinstance(link, h5py.SoftLink):
            at = posixpath.join(at, part)
            continue
        nlinks += 1
        if nlinks > _LINKS:
            raise SourceError(
                f"{path}: more than {_LINKS} links on the way to {printable(name)!r}; "
                "give the path of the dataset itself",
                path=str(path),
            )
        if link.path.startswith("/"):
            at = "/"
        parts = [step for step in link.path.split("/") if step] + parts
    return file[at]


def _outside(path: Path, name: str, what: str) -> UnsupportedSourceError:
    return UnsupportedSourceError(
        f"{path}: {printable(name)!r}: {what} outside this file, and other files are not opened "
        "through a link; give the path of the file that holds the data",
        path=str(path),
        dataset=printable(name),
    )


def _describe(dataset: Any, letters: str | None, path: Path) -> tuple[Description, Axes]:
    axes = axes_of(dataset.shape, letters or _labels(dataset), path)
    dtype = require_dtype(dataset.dtype, path)
    notes: list[str] = []
    spacing_zyx, unit = _spacing(dataset.attrs, axes, notes)
    description = Description(
        "hdf5",
        axes.shape_zyx,
        dtype,
        spacing_zyx,
        unit,
        warnings=tuple(notes),
        nt=axes.nt,
        nc=axes.nc,
        channels=axes.channels,
        chunk_zyx=require_chunk(dataset.chunks, dtype, axes, path),
    )
    return description, axes


def _labels(dataset: Any) -> str | None:
    """The letters of the axes from their labels, where each axis has one of ours."""
    labels = [str(dimension.label).lower() for dimension in dataset.dims]
    known = all(len(label) == 1 and label in LETTERS for label in labels)
    return "".join(labels) if known and len(set(labels)) == len(labels) else None


def _spacing(attributes: Any, axes: Axes, notes: list[str]) -> tuple[Vector, str | None]:
    """From element_size_um (as ilastik and ImageJ write it) or resolution, both z, y, x."""
    for name, unit in (("element_size_um", "micrometer"), ("resolution", None)):
        if name not in attributes:
            continue
        values = np.asarray(attributes[name]).ravel()
        sizes = _sizes_zyx(values.tolist(), axes) if values.dtype.kind in "iuf" else None
        if sizes is not None:
            return clean_spacing(sizes[::-1], notes), unit
        notes.append(f"attribute {name} is no size for each of z, y, x; it is not used")
    return (1.0, 1.0, 1.0), None


def _sizes_zyx(values: Sequence[float], axes: Axes) -> tuple[float, float, float] | None:
    if len(values) == 3:
        return (values[0], values[1], values[2])
    return axes.of_zyx(values, 1.0) if len(values) == len(axes.letters) else None
