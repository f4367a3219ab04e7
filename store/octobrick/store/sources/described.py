"""Raw voxels without a header: the caller, or a ``.json`` beside the file, says what they are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from octobrick.codec.errors import InvalidInputError
from octobrick.store.box import Zyx
from octobrick.store.errors import SourceError
from octobrick.store.sources.base import Description, Source, Vector
from octobrick.store.sources.flat import Layout
from octobrick.store.sources.gzip_stream import GzipSource
from octobrick.store.sources.head import GZIP_MAGIC, printable, read_head
from octobrick.store.sources.location import Location
from octobrick.store.sources.raw import RawSource
from octobrick.store.sources.sidecar import find_sidecar
from octobrick.store.sources.voxels import READ_DTYPES, require_dtype

# By numpy's short codes too; a type beyond these is a slip of the pen, not another format.
_DTYPE_OF_CODE = {
    "u1": "uint8",
    "i1": "int8",
    "u2": "uint16",
    "i2": "int16",
    "f4": "float32",
    "b1": "bool",
    "u4": "uint32",
    "i4": "int32",
    "u8": "uint64",
    "i8": "int64",
    "f2": "float16",
    "f8": "float64",
}


@dataclass(frozen=True, slots=True)
class RawOptions:
    """What a caller says of a raw file; None where he does not."""

    shape_zyx: Sequence[int] | None = None
    dtype: npt.DTypeLike | None = None
    spacing_zyx: Sequence[float] | None = None
    offset_nbytes: int = 0
    big_endian: bool = False

    @property
    def is_complete(self) -> bool:
        """Whether a raw file can be read with no more than these."""
        return self.shape_zyx is not None and self.dtype is not None

    def given(self) -> list[str]:
        """The options that only raw files take, as the command line names them."""
        named = {
            "--shape": self.shape_zyx is not None,
            "--dtype": self.dtype is not None,
            "--offset": self.offset_nbytes != 0,
            "--big-endian": self.big_endian,
        }
        return [name for name, is_given in named.items() if is_given]


def complete(path: Path, options: RawOptions) -> RawOptions:
    """The options, with what they leave open taken from the ``.json`` beside the file."""
    sidecar = None if options.is_complete else find_sidecar(path)
    if sidecar is None:
        return options
    return RawOptions(
        sidecar.shape_zyx if options.shape_zyx is None else options.shape_zyx,
        sidecar.dtype if options.dtype is None else options.dtype,
        sidecar.spacing_zyx if options.spacing_zyx is None else options.spacing_zyx,
        options.offset_nbytes or sidecar.offset_nbytes,
        options.big_endian or sidecar.big_endian,
    )


def open_described(path: Path, options: RawOptions) -> Source:
    """Raw voxels, x fastest, in a file as it is or (named ``.gz``) in gzip data.

    Raises:
        InvalidInputError: shape or type are missing or mean nothing.
        TruncatedSourceError: the file is too short for the shape.
        UnsupportedSourceError: a sample type that is not read.
    """
    if options.shape_zyx is None or options.dtype is None:
        lacking = " and ".join(
            name
            for name, value in (("shape", options.shape_zyx), ("type", options.dtype))
            if value is None
        )
        raise InvalidInputError(
            f"{path}: a raw file does not say the {lacking} of its voxels; give "
            f"--shape Z,Y,X --dtype uint16, or put them into {path.name}.json as "
            '{"shape": [Z, Y, X], "dtype": "uint16"}',
            path=str(path),
        )
    is_gzip = path.suffix.lower() == ".gz"
    if is_gzip and read_head(path, len(GZIP_MAGIC)) != GZIP_MAGIC:
        raise SourceError(
            f"{path}: is named .gz but holds no gzip data; rename it or fetch it again",
            path=str(path),
        )
    dtype, is_big = _dtype(options, path)
    description = Description(
        "raw.gz" if is_gzip else "raw",
        _shape(options.shape_zyx, path),
        dtype,
        require_spacing(options.spacing_zyx, path),
    )
    if options.offset_nbytes < 0:
        raise InvalidInputError(
            f"{path}: the offset is {options.offset_nbytes} bytes; 0 or more is expected",
            path=str(path),
        )
    layout = Layout(path, options.offset_nbytes, dtype.newbyteorder(">" if is_big else "<"))
    return (GzipSource if is_gzip else RawSource)(path, description, layout)


def require_spacing(spacing_zyx: Sequence[float] | None, path: Location) -> Vector:
    """A spacing that a caller gives, or 1.

    Raises:
        InvalidInputError: it is not three positive finite numbers.
    """
    if spacing_zyx is None:
        return (1.0, 1.0, 1.0)
    sizes = [float(size) for size in spacing_zyx]
    if len(sizes) != 3 or not all(0 < size < math.inf for size in sizes):
        raise InvalidInputError(
            f"{path}: the spacing is {sizes}; three positive numbers in the order z, y, x "
            "are expected",
            path=str(path),
            spacing_zyx=[str(size) for size in sizes],
        )
    z, y, x = sizes
    return (z, y, x)


def _shape(shape_zyx: Sequence[int], path: Path) -> Zyx:
    sizes = [int(size) for size in shape_zyx]
    if len(sizes) != 3 or min(sizes) < 1:
        raise InvalidInputError(
            f"{path}: the shape is {sizes[:8]}; three numbers of at least 1 in the order z, y, x "
            "are expected (an axis without voxels makes no volume)",
            path=str(path),
            shape_zyx=sizes[:8],
        )
    z, y, x = sizes
    return (z, y, x)


def _dtype(options: RawOptions, path: Path) -> tuple[np.dtype[Any], bool]:
    """The sample type, and whether its bytes are big-endian."""
    given = options.dtype
    name = given if isinstance(given, str) else np.dtype(given).str
    code = name.lstrip("<>=|")
    name_or_code = _DTYPE_OF_CODE.get(code, code)
    if name_or_code not in _DTYPE_OF_CODE.values():
        raise InvalidInputError(
            f"{path}: {printable(name)!r} is no sample type; those read are "
            f"{', '.join(READ_DTYPES)}",
            path=str(path),
            dtype=printable(name),
        )
    return require_dtype(name_or_code, path), options.big_endian or name.startswith(">")
