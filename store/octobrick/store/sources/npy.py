"""numpy's own files: ``.npy``, C or Fortran order, indexed [z, y, x] or as the caller says."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from octobrick.codec.errors import InvalidInputError
from octobrick.store.errors import UnsupportedSourceError
from octobrick.store.sources.axes import Axes, axes_of
from octobrick.store.sources.base import Description, Pick, Source
from octobrick.store.sources.flat import Layout
from octobrick.store.sources.head import parsing, printable, read_head
from octobrick.store.sources.raw import RawSource
from octobrick.store.sources.voxels import require_dtype

MAGIC = b"\x93NUMPY"


class Header(NamedTuple):
    """What the header of an array says: its elements begin ``nbytes`` after it does."""

    shape: tuple[int, ...]
    fortran: bool
    dtype: np.dtype[Any]
    nbytes: int

    def describe(self, format_name: str, letters: str | None, path: Path) -> Description:
        """The volume that the array is; raises what `axes_of` and `require_dtype` do."""
        axes = self._axes(letters, path)
        return Description(
            format_name,
            axes.shape_zyx,
            require_dtype(self.dtype, path),
            nt=axes.nt,
            nc=axes.nc,
            channels=axes.channels,
        )

    def layout(self, letters: str | None, path: Path, start_nbytes: int = 0) -> Layout:
        """Where the elements lie, in a file (or in data) in which the header is at a place."""
        strides = self._axes(letters, path).strides(fortran=self.fortran)
        return Layout(path, start_nbytes + self.nbytes, self.dtype, strides=strides)

    def _axes(self, letters: str | None, path: Path) -> Axes:
        return axes_of(self.shape, letters, path)


def open_npy(path: Path, pick: Pick) -> Source:
    """A ``.npy`` array; three axes are z, y, x where the caller does not name them.

    Raises:
        SourceError: the header is damaged or the data are too short.
        UnsupportedSourceError: a sample type that is not read.
        InvalidInputError: axes that do not fit the array, or none for other than three; a dataset.
    """
    if pick.dataset is not None:
        raise InvalidInputError(
            f"{path}: holds one array; leave out --dataset",
            path=str(path),
            dataset=printable(pick.dataset),
        )
    header = parse_header(read_head(path), path)
    return RawSource(path, header.describe("npy", pick.axes, path), header.layout(pick.axes, path))


def parse_header(head: bytes, path: Path) -> Header:
    """The header at the start of an array's bytes.

    Raises:
        SourceError: it is damaged.
        UnsupportedSourceError: an array of records.
    """
    file = io.BytesIO(head)
    with parsing(path, "npy"):
        version = np.lib.format.read_magic(file)
        if version == (1, 0):
            shape, fortran, dtype = np.lib.format.read_array_header_1_0(file)
        elif version == (2, 0):
            shape, fortran, dtype = np.lib.format.read_array_header_2_0(file)
        else:  # 3.0 differs in the names of fields only, and arrays with fields are not read
            raise UnsupportedSourceError(
                f"{path}: npy format {version[0]}.{version[1]} is for arrays with named fields; "
                "save one field on its own",
                path=str(path),
            )
    return Header(shape, fortran, dtype, file.tell())
