"""MetaImage: ``.mhd`` that names the file of the data, or ``.mha`` with the data behind the header.

Source: https://itk.org/Wiki/ITK/MetaIO/Documentation.
"""

from __future__ import annotations

import re
from pathlib import Path

from octobrick.store.errors import SourceError, TruncatedSourceError, UnsupportedSourceError
from octobrick.store.sources.axes import Axes, axes_of
from octobrick.store.sources.base import Description, Direction, Source, Vector
from octobrick.store.sources.flat import Layout
from octobrick.store.sources.gzip_stream import GzipSource
from octobrick.store.sources.head import (
    HEADER_LIMIT_NBYTES,
    locate_data,
    parsing,
    printable,
    read_head,
    require_file,
)
from octobrick.store.sources.raw import RawSource
from octobrick.store.sources.voxels import (
    clean_origin,
    clean_spacing,
    direction_of,
    require_dtype,
    require_shape,
)

_DTYPE_OF_TYPE = {
    "MET_UCHAR": "uint8",
    "MET_CHAR": "int8",
    "MET_USHORT": "uint16",
    "MET_SHORT": "int16",
    "MET_UINT": "uint32",
    "MET_INT": "int32",
    "MET_ULONG_LONG": "uint64",
    "MET_LONG_LONG": "int64",
    "MET_FLOAT": "float32",
    "MET_DOUBLE": "float64",
}
_UNIT_OF_NAME = {"mm": "millimeter", "um": "micrometer", "cm": "centimeter"}
_LOCAL = ("LOCAL", "Local", "local")

Fields = dict[str, str]


def is_metaimage(head: bytes) -> bool:
    """Whether bytes begin the text header of a MetaImage."""
    return re.match(rb"\s*(ObjectType\s*[=:]\s*Image|NDims\s*[=:])", head) is not None


def open_metaimage(path: Path) -> Source:
    """A MetaImage; its world is LPS, as ITK has it.

    Raises:
        SourceError: the header is damaged or describes more than the file holds.
        UnsupportedSourceError: text data, several files, another number of axes than three (and
            one of time), or a sample type that is not read.
        SourceNotFoundError: the data file does not exist.
    """
    fields, header_nbytes = _parse(read_head(path), path)
    with parsing(path, "MetaImage"):
        axes = _axes(fields, path)
        description = _describe(fields, axes, path)
        nbytes = description.nbytes * axes.nt * axes.nc
        data_path, start = _locate(fields, header_nbytes, nbytes, path)
        stored = description.dtype.newbyteorder(">" if _is_msb(fields) else "<")
        compressed = _flag(fields, "CompressedData")
        if compressed and "CompressedDataSize" in fields:
            _require_compressed(data_path, start, int(fields["CompressedDataSize"]))
    layout = Layout(data_path, 0 if compressed else start, stored, strides=axes.strides())
    if compressed:
        return GzipSource(path, description, layout.in_stream(start))
    return RawSource(path, description, layout)


def _parse(head: bytes, path: Path) -> tuple[Fields, int]:
    """The fields of the header, whose last is ElementDataFile, and where the header ends."""
    fields: Fields = {}
    position = 0
    for line in head.splitlines(keepends=True):
        position += len(line)
        key, *rest = re.split("[=:]", line.decode("utf-8", "replace"), maxsplit=1)
        if rest:
            fields[key.strip()] = rest[0].strip()
        elif key.strip():
            raise SourceError(
                f"{path}: the MetaImage header has a line that is no 'Key = Value': "
                f"{printable(key.strip())!r}; correct it or export the file again",
                path=str(path),
            )
        if key.strip() == "ElementDataFile":
            return fields, position
    raise SourceError(
        f"{path}: no ElementDataFile ends the MetaImage header within {HEADER_LIMIT_NBYTES} bytes; "
        "export the file again",
        path=str(path),
    )


def _axes(fields: Fields, path: Path) -> Axes:
    """The axes: x, y, z and perhaps time; the channels of a voxel lie beside each other."""
    for key in ("DimSize", "ElementType"):
        if key not in fields:
            raise SourceError(
                f"{path}: the MetaImage header lacks {key}; correct it or export the file again",
                path=str(path),
            )
    sizes = [int(size) for size in fields["DimSize"].split()]
    if int(fields.get("NDims", len(sizes))) != len(sizes):
        raise ValueError(f"NDims is {fields['NDims']} but DimSize has {len(sizes)} sizes")
    if not 3 <= len(sizes) <= 4:
        require_shape(sizes, path)  # says what was found
    nc = int(fields.get("ElementNumberOfChannels", 1))
    # Nothing tells colours from vectors; three or four bytes are what programs write for colours.
    is_colour = nc in (3, 4) and _dtype_name(fields) == "uint8"
    letters = ("s" if is_colour else "c") + "xyzt"[: len(sizes)]
    return axes_of([nc, *sizes][::-1], letters[::-1], path)


def _dtype_name(fields: Fields) -> str:
    """Our name of the sample type, or MetaImage's own for one that is not read."""
    kind = fields["ElementType"]
    return _DTYPE_OF_TYPE.get(kind.removesuffix("_ARRAY"), kind)


def _describe(fields: Fields, axes: Axes, path: Path) -> Description:
    if not _flag(fields, "BinaryData", default=True):
        raise UnsupportedSourceError(
            f"{path}: the voxels are text (BinaryData = False); save them as binary data",
            path=str(path),
        )
    notes: list[str] = []
    ndim = len(axes.sizes) - 1
    spacing_zyx = clean_spacing(_spacing_xyz(fields, ndim), notes)
    direction = _direction(fields, ndim, notes)
    origin_xyz = _origin(fields, ndim, notes)
    return Description(
        "metaimage",
        axes.shape_zyx,
        require_dtype(_dtype_name(fields), path),
        spacing_zyx,
        _UNIT_OF_NAME.get(fields.get("DistanceUnits", "").lower()),
        direction,
        None,
        tuple(notes),
        origin_xyz,
        axes.nt,
        axes.nc,
        axes.channels,
    )


def _spacing_xyz(fields: Fields, ndim: int) -> list[float]:
    text = fields.get("ElementSpacing", fields.get("ElementSize"))
    return [1.0] * 3 if text is None else _floats(text, ndim, "ElementSpacing")[:3]


def _direction(fields: Fields, ndim: int, notes: list[str]) -> Direction | None:
    """As many numbers as axes for each axis in turn: the columns of the matrix."""
    for key in ("TransformMatrix", "Orientation", "Rotation"):
        if key in fields:
            numbers = _floats(fields[key], ndim * ndim, key)
            return direction_of([numbers[i * ndim : i * ndim + 3] for i in range(3)], notes)
    return None


def _origin(fields: Fields, ndim: int, notes: list[str]) -> Vector:
    for key in ("Offset", "Position", "Origin"):
        if key in fields:
            return clean_origin(_floats(fields[key], ndim, key)[:3], notes)
    return (0.0, 0.0, 0.0)


def _floats(text: str, count: int, key: str) -> list[float]:
    numbers = [float(word) for word in text.split()]
    if len(numbers) != count:
        raise ValueError(f"{key} has {len(numbers)} numbers, not {count}")
    return numbers


def _locate(fields: Fields, header_nbytes: int, nbytes: int, path: Path) -> tuple[Path, int]:
    """The file of the voxels and where they begin in it."""
    name = fields["ElementDataFile"]
    if name.split()[:1] == ["LIST"] or re.search(r"%\d*d", name):
        raise UnsupportedSourceError(
            f"{path}: the voxels are in several files (ElementDataFile = {printable(name)}); "
            "one data file is read for now; join them into one .mha",
            path=str(path),
        )
    if name in _LOCAL:
        data_path, size, start = path, require_file(path), header_nbytes
    else:
        (data_path, size), start = locate_data(path, name), 0
    skip = int(fields.get("HeaderSize", 0))
    if skip == -1 and not _flag(fields, "CompressedData"):
        return data_path, max(start, size - nbytes)  # RawSource says if that is too short
    if skip < 0 or 0 < skip < start:
        raise ValueError(f"HeaderSize {skip} is no place where these data can begin")
    return data_path, skip or start


def _require_compressed(path: Path, start: int, nbytes: int) -> None:
    have = require_file(path) - start
    if have < nbytes:
        raise TruncatedSourceError(
            f"{path}: compressed data end after {have} of {nbytes} bytes (CompressedDataSize); "
            "copy or export the file again",
            path=str(path),
            expected_nbytes=nbytes,
            actual_nbytes=have,
        )


def _is_msb(fields: Fields) -> bool:
    return _flag(fields, "BinaryDataByteOrderMSB") or _flag(fields, "ElementByteOrderMSB")


def _flag(fields: Fields, key: str, *, default: bool = False) -> bool:
    value = fields.get(key)
    return default if value is None else value[:1] in "TtYy1" and value != ""
