"""numpy's own files: ``.npy``, C or Fortran order, indexed [z, y, x]."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from octobrick.store.box import Zyx
from octobrick.store.errors import UnsupportedSourceError
from octobrick.store.sources.base import Description, Source
from octobrick.store.sources.flat import Layout
from octobrick.store.sources.head import parsing, read_head
from octobrick.store.sources.raw import RawSource
from octobrick.store.sources.voxels import require_dtype, require_shape

MAGIC = b"\x93NUMPY"


def open_npy(path: Path) -> Source:
    """A three-dimensional ``.npy`` array, whose axes are taken as z, y, x.

    Raises:
        SourceError: the header is damaged or the data are too short.
        UnsupportedSourceError: another number of axes, or a sample type that is not read.
    """
    shape, z_fastest, dtype, offset = _parse(path)
    description = Description("npy", _zyx(shape, path), require_dtype(dtype, path))
    return RawSource(path, description, Layout(path, offset, dtype, z_fastest))


def _parse(path: Path) -> tuple[tuple[int, ...], bool, np.dtype[Any], int]:
    """Shape, whether Fortran order, sample type and where the data begin."""
    file = io.BytesIO(read_head(path))
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
    return shape, fortran, dtype, file.tell()


def _zyx(shape: tuple[int, ...], path: Path) -> Zyx:
    if len(shape) != 3:
        raise UnsupportedSourceError(
            f"{path}: the array has {len(shape)} axes of {list(shape)} elements; "
            "one 3D scalar volume [z, y, x] is read for now; save one such part on its own",
            path=str(path),
            sizes=list(shape),
        )
    return require_shape(shape[::-1], path)
