"""NRRD: header and data in one ``.nrrd`` file, or ``.nhdr`` that names the file of the data.

pynrrd takes the header apart; the voxels are read by our own readers, so that memory stays
bounded. Source: https://teem.sourceforge.net/nrrd/format.html.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from octobrick.codec.errors import InvalidInputError
from octobrick.store.errors import SourceError, UnsupportedSourceError
from octobrick.store.sources.axes import Axes, axes_of
from octobrick.store.sources.base import Description, Direction, Pick, Source, Vector
from octobrick.store.sources.flat import Layout
from octobrick.store.sources.gzip_stream import GzipSource
from octobrick.store.sources.head import (
    HEADER_LIMIT_NBYTES,
    locate_data,
    missing_package,
    open_file,
    parsing,
    printable,
    read_head,
    require_file,
)
from octobrick.store.sources.nrrd_axes import letters_of
from octobrick.store.sources.raw import RawSource
from octobrick.store.sources.voxels import (
    LPS_OF_RAS,
    clean_origin,
    clean_spacing,
    direction_of,
    require_dtype,
)

MAGIC = b"NRRD000"

_DTYPES = {
    "int8": ("signed char", "int8", "int8_t"),
    "uint8": ("uchar", "unsigned char", "uint8", "uint8_t"),
    "int16": ("short", "short int", "signed short", "signed short int", "int16", "int16_t"),
    "uint16": ("ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"),
    "int32": ("int", "signed int", "int32", "int32_t"),
    "uint32": ("uint", "unsigned int", "uint32", "uint32_t"),
    "int64": ("longlong", "long long", "long long int", "signed long long", "int64", "int64_t"),
    "uint64": ("ulonglong", "unsigned long long", "unsigned long long int", "uint64", "uint64_t"),
    "float32": ("float",),
    "float64": ("double",),
}
_DTYPE_OF_TYPE = {name: dtype for dtype, names in _DTYPES.items() for name in names}
_UNITS = {
    "millimeter": ("mm", "millimeter", "millimeters"),
    "micrometer": ("um", "µm", "micron", "microns", "micrometer", "micrometers"),
    "nanometer": ("nm", "nanometer", "nanometers"),
    "centimeter": ("cm", "centimeter", "centimeters"),
    "meter": ("m", "meter", "meters"),
}
_UNIT_OF_NAME = {name: unit for unit, names in _UNITS.items() for name in names}
_LPS = ("left-posterior-superior", "lps")
_RAS = ("right-anterior-superior", "ras")
_LAS = ("left-anterior-superior", "las")
_IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_MOST_AXES = 16  # of the format
_SKIP_NBYTES = 1 << 16


def open_nrrd(path: Path, pick: Pick) -> Source:
    """A NRRD file; spacing and direction from space directions, or else spacing from spacings.

    Args:
        path: the file.
        pick: ``axes`` names the axes, slowest first, where kinds and space directions do not.

    Raises:
        SourceError: the header is damaged or describes more than the file holds.
        UnsupportedSourceError: another encoding than raw and gzip, several data files, two axes
            of channels or of time, or a sample type that is not read.
        InvalidInputError: axes that do not fit, or none where the header leaves them open; a
            dataset.
        SourceNotFoundError: the data file does not exist.
        ResourceError: pynrrd is not installed.
    """
    if pick.dataset is not None:
        raise InvalidInputError(
            f"{path}: holds one array; leave out --dataset",
            path=str(path),
            dataset=printable(pick.dataset),
        )
    lines, header_nbytes = _header_lines(path)
    header = _parse(lines, path)
    axes, description = _describe(header, pick.axes, path)
    data_path, start = path, header_nbytes
    if (name := _get(header, "data file")) is not None:
        data_path, start = locate_data(path, name)[0], 0
    elif header_nbytes == 0:
        raise SourceError(
            f"{path}: no blank line ends the header within {HEADER_LIMIT_NBYTES} bytes and it "
            "names no data file; export the file again",
            path=str(path),
        )
    start = _skip_lines(data_path, start, _skip(header, "line skip", 0, path))
    stored = description.dtype.newbyteorder(_byte_order(header, description.dtype, path))
    skip = _skip(header, "byte skip", -1, path)
    if _is_gzip(header, path):
        if skip < 0:
            raise UnsupportedSourceError(
                f"{path}: byte skip -1 counts from the end, which compressed data do not allow; "
                "leave it out of the header",
                path=str(path),
            )
        layout = Layout(data_path, skip, stored, strides=axes.strides())
        return GzipSource(path, description, layout.in_stream(start))
    if skip < 0:
        nbytes = description.nbytes * axes.nt * axes.nc
        # Never before where data can begin: then they are too short, and RawSource says so.
        start, skip = max(start, require_file(data_path) - nbytes), 0
    return RawSource(
        path, description, Layout(data_path, start + skip, stored, strides=axes.strides())
    )


def _header_lines(path: Path) -> tuple[list[bytes], int]:
    """The lines of the header and where data can begin; 0 if no blank line ends it."""
    head = read_head(path)
    if not head.startswith(MAGIC):
        raise SourceError(
            f"{path}: not a NRRD file: it begins with {head[:8]!r}, not {MAGIC!r}; "
            "export the file again",
            path=str(path),
        )
    end = re.search(rb"\r?\n\r?\n", head)
    text = head[: end.start()] if end else head
    lines = text.splitlines(keepends=True)
    for line in lines:
        if re.match(rb"data ?file\s*:\s*(LIST\b|\S*%[0-9]*d)", line):
            raise UnsupportedSourceError(
                f"{path}: the voxels are in several files "
                f"({printable(line.decode('ascii', 'replace').strip())}); "
                "one data file is read for now; join them into one .nrrd",
                path=str(path),
            )
    return lines, end.end() if end else 0


def _parse(lines: list[bytes], path: Path) -> dict[str, Any]:
    """The header as pynrrd has it; only the fields that everything needs are known to exist."""
    try:
        import nrrd  # in the extra "formats"
    except ImportError as error:
        raise missing_package("pynrrd", path) from error
    with parsing(path, "NRRD"):
        header = dict(nrrd.read_header(lines))
    missing = [name for name in ("type", "dimension", "sizes", "encoding") if name not in header]
    problem = None
    if missing:
        problem = f"lacks {', '.join(missing)}"
    elif header["dimension"] != len(header["sizes"]):
        problem = f"gives dimension {header['dimension']} but {len(header['sizes'])} sizes"
    elif header["dimension"] > _MOST_AXES:
        problem = f"gives dimension {header['dimension']}, where {_MOST_AXES} is the most"
    if problem:
        raise SourceError(
            f"{path}: the NRRD header {problem}; correct it or export the file again",
            path=str(path),
        )
    return header


def _describe(header: dict[str, Any], letters: str | None, path: Path) -> tuple[Axes, Description]:
    notes: list[str] = []
    kind = str(header["type"])
    dtype = require_dtype(_DTYPE_OF_TYPE.get(kind.lower(), kind), path)
    with parsing(path, "NRRD"):
        sizes = [int(size) for size in header["sizes"]]
        directions = _directions(header)
        if letters is None:  # fastest first, as the header has them
            letters = letters_of(sizes, header.get("kinds"), directions, path)[::-1]
            # A blank stands for an axis of one sample that means nothing.
            kept = [size for size, letter in zip(sizes, letters[::-1], strict=True) if letter > " "]
            axes = axes_of(kept[::-1], letters.replace(" ", ""), path)
        else:
            axes = axes_of(sizes[::-1], letters, path)
        space = [letters[::-1].index(letter) for letter in "xyz" if letter in letters]
        unit = _unit(header, space, notes)
        spacing_zyx, direction, origin_xyz = _place(header, directions, space, notes)
    return axes, Description(
        "nrrd",
        axes.shape_zyx,
        dtype,
        spacing_zyx,
        unit,
        direction,
        None,
        tuple(notes),
        origin_xyz,
        axes.nt,
        axes.nc,
        axes.channels,
    )


def _place(
    header: dict[str, Any],
    directions: list[list[float]] | None,
    space: Sequence[int],
    notes: list[str],
) -> tuple[Vector, Direction | None, Vector]:
    """Spacing (z, y, x), direction and origin from what the header says of the axes of space."""
    if len(space) < 3:  # a caller says so, and knows what the spacing is
        return (1.0, 1.0, 1.0), None, (0.0, 0.0, 0.0)
    if directions is not None:
        vectors = [directions[axis] for axis in space]
        spacing_zyx = clean_spacing([math.hypot(*vector) for vector in vectors], notes)
        return spacing_zyx, _direction(header, vectors, notes), _origin(header, notes)
    if "spacings" in header:
        spacings = [float(header["spacings"][axis]) for axis in space]
        return clean_spacing(spacings, notes), None, (0.0, 0.0, 0.0)
    return (1.0, 1.0, 1.0), None, (0.0, 0.0, 0.0)


def _directions(header: dict[str, Any]) -> list[list[float]] | None:
    """The vector of each axis in space; NaN for an axis that is not of space (``none``)."""
    given = header.get("space directions")
    if given is None:
        return None
    nowhere = [math.nan] * 3
    rows = [nowhere if row is None else [float(c) for c in row] for row in given]
    if len(rows) != len(header["sizes"]):
        raise ValueError(f"{len(rows)} space directions for {len(header['sizes'])} axes")
    if _has_time(header):  # the fourth component is time; an axis of time alone is none of space
        rows = [row[:3] if any(row[:3]) else nowhere for row in rows]
    return rows


def _has_time(header: dict[str, Any]) -> bool:
    """Whether the space of the file has time as its fourth axis."""
    return str(header.get("space", "")).lower().endswith(("-time", "st"))


def _direction(
    header: dict[str, Any], vectors: list[list[float]], notes: list[str]
) -> Direction | None:
    """The directions in LPS, where the space of the file says how it lies in a body."""
    to_lps = _to_lps(header)
    if to_lps is not None:
        return direction_of(vectors, notes, to_lps=to_lps)
    direction = direction_of(vectors, notes)
    if direction is not None and not np.allclose(direction, _IDENTITY):
        space = printable(_space(header))
        named = f"space {space}" if space else "a space without a name"
        notes.append(f"the directions of the axes are in {named}, not in LPS; they are not used")
    return None


def _origin(header: dict[str, Any], notes: list[str]) -> Vector:
    """Where the first voxel lies, in LPS where the space of the file says how it lies in a body."""
    given = header.get("space origin")
    if given is None:
        return (0.0, 0.0, 0.0)
    return clean_origin(list(given)[:3], notes, to_lps=_to_lps(header) or (1.0, 1.0, 1.0))


def _space(header: dict[str, Any]) -> str:
    return str(header.get("space", "")).lower().removesuffix("-time").removesuffix("t")


def _to_lps(header: dict[str, Any]) -> Vector | None:
    """The sign of each axis that turns the file's world into LPS; None where nobody knows."""
    space = _space(header)
    signs = {_LPS: (1.0, 1.0, 1.0), _RAS: LPS_OF_RAS, _LAS: (1.0, -1.0, 1.0)}
    return next((sign for names, sign in signs.items() if space in names), None)


def _unit(header: dict[str, Any], axes: list[int], notes: list[str]) -> str | None:
    """The one unit of all axes of space."""
    given = header.get("space units")
    if given is not None and _has_time(header):
        given = list(given)[:3]
    if given is None and (units := header.get("units")):
        given = [units[axis] for axis in axes]
    names = sorted({str(name).strip().lower() for name in given or ()} - {"", "???", "none"})
    if not names:
        return None
    unit = _UNIT_OF_NAME.get(names[0])
    if len(names) > 1 or unit is None:
        notes.append(f"no one unit is known for {printable(' and '.join(names))}; none is used")
        return None
    return unit


def _is_gzip(header: dict[str, Any], path: Path) -> bool:
    encoding = printable(str(header["encoding"]).lower())
    if encoding not in ("raw", "gz", "gzip"):
        raise UnsupportedSourceError(
            f"{path}: the data are encoded as {encoding}; raw and gzip are read; "
            "save the file again with one of these, such as by: "
            f"unu save -f nrrd -e gzip -i {path.name} -o out.nrrd",
            path=str(path),
            encoding=encoding,
        )
    return encoding != "raw"


def _byte_order(header: dict[str, Any], dtype: np.dtype[Any], path: Path) -> Literal["<", ">"]:
    endian = str(header.get("endian", "")).lower()
    if endian == "big":
        return ">"
    if endian == "little" or dtype.itemsize == 1:
        return "<"
    raise SourceError(
        f"{path}: samples of {dtype.itemsize} bytes need the field endian: little or big, "
        f"the header has {printable(endian) or 'none'}; add it",
        path=str(path),
    )


def _skip(header: dict[str, Any], field: str, least: int, path: Path) -> int:
    skip = int(_get(header, field) or 0)
    if skip < least:
        raise SourceError(
            f"{path}: {field} is {skip}; at least {least} is expected; correct the header",
            path=str(path),
        )
    return skip


def _skip_lines(path: Path, start: int, count: int) -> int:
    """The byte behind ``count`` more lines, or the end of the file where there are fewer."""
    position = start
    with open_file(path) as file:
        file.seek(start)
        while count:
            data = file.read(_SKIP_NBYTES)
            if not data:
                break
            for newline in re.finditer(rb"\n", data):
                count -= 1
                if count == 0:
                    return position + newline.end()
            position += len(data)
    return position


def _get(header: dict[str, Any], field: str) -> Any:
    """A field whose name is written with or without a space."""
    return header.get(field, header.get(field.replace(" ", "")))
