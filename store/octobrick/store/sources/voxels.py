"""What the voxels of a source may be: sample types, shapes, spacings and directions.

Headers come from strangers. Sizes and sample types that cannot be read are refused; spacings and
directions that make no sense are replaced, and a note tells of it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from octobrick.store.box import Zyx
from octobrick.store.errors import SourceError, UnsupportedSourceError
from octobrick.store.sources.base import Direction, Vector
from octobrick.store.sources.head import printable
from octobrick.store.sources.location import Location

READ_DTYPES = (
    "uint8",
    "int8",
    "uint16",
    "int16",
    "float32",
    "bool",
    "uint32",
    "int32",
    "uint64",
    "int64",
    "float16",
    "float64",
)

_QUOTED_AXES = 8
LPS_OF_RAS = (-1.0, -1.0, 1.0)


def require_dtype(dtype: np.dtype[Any] | str, path: Location) -> np.dtype[Any]:
    """The sample type in native byte order, if it is one that is read.

    Args:
        dtype: a numpy type, or the name that a format has for one that numpy lacks.
        path: the file, for the message.

    Raises:
        UnsupportedSourceError: naming the type and those that are read.
    """
    name = printable(dtype) if isinstance(dtype, str) else dtype.name
    if name in READ_DTYPES:
        return np.dtype(name)
    raise UnsupportedSourceError(
        f"{path}: voxels are {name}; those read are {', '.join(READ_DTYPES)}; extract one scalar "
        "component and convert it to one of these",
        path=str(path),
        dtype=name,
    )


def require_shape(sizes_xyz: Sequence[int], path: Location) -> Zyx:
    """The shape ``(z, y, x)`` of three sizes ``(x, y, z)`` that a header gives.

    Raises:
        UnsupportedSourceError: there are not three axes.
        SourceError: an axis has no voxels, or fewer.
    """
    sizes = [int(size) for size in sizes_xyz]
    if len(sizes) != 3:
        raise UnsupportedSourceError(
            f"{path}: the header describes {len(sizes)} axes of {sizes[:_QUOTED_AXES]} samples "
            "(fastest first); a volume has three of space; extract one volume and save it on "
            "its own",
            path=str(path),
            sizes=sizes[:_QUOTED_AXES],
        )
    for axis, size in zip("xyz", sizes, strict=True):
        if size <= 0:
            raise SourceError(
                f"{path}: the header gives axis {axis} a size of {size} voxels (x, y, z: {sizes}); "
                "every axis needs at least 1; export the file again or correct its header",
                path=str(path),
                axis=axis,
                sizes_xyz=sizes,
            )
    nx, ny, nz = sizes
    return (nz, ny, nx)


def clean_spacing(spacing_xyz: Iterable[float], notes: list[str]) -> Vector:
    """A usable spacing ``(z, y, x)``: sizes without sign, 1 for what is no size at all."""
    cleaned = []
    for axis, given in zip("xyz", spacing_xyz, strict=True):
        size = abs(float(given))
        if not math.isfinite(size) or size == 0:
            size = 1.0
        if size != given:
            notes.append(
                f"spacing along {axis} is {float(given):g} in the header; {size:g} is used"
            )
        cleaned.append(size)
    x, y, z = cleaned
    return (z, y, x)


def clean_origin(
    given_xyz: Sequence[float], notes: list[str], *, to_lps: Vector = (1.0, 1.0, 1.0)
) -> Vector:
    """A usable origin: its components turned to LPS, or 0 with a note where they are no numbers."""
    turned = [sign * float(size) + 0.0 for sign, size in zip(to_lps, given_xyz, strict=True)]
    if not all(map(math.isfinite, turned)):
        notes.append("the origin in the header is no position; 0 is used")
        return (0.0, 0.0, 0.0)
    x, y, z = turned
    return (x, y, z)


def direction_of(
    columns: Sequence[Sequence[float]], notes: list[str], *, to_lps: Vector = (1.0, 1.0, 1.0)
) -> Direction | None:
    """Unit direction of each voxel axis, from vectors of any length.

    Args:
        columns: for each axis of (x, y, z) its vector in the world of the file.
        notes: takes a sentence where the vectors are of no use.
        to_lps: sign of each world axis that turns the file's world into LPS.

    Returns:
        The matrix whose columns are the unit vectors; None if they span no space.
    """
    matrix = np.array(columns, dtype=np.float64).T * np.array(to_lps)[:, np.newaxis]
    with np.errstate(all="ignore"):
        # Scaled first: the squares of tiny or huge components would leave the range of a double.
        matrix = matrix / np.abs(matrix).max(axis=0)
        matrix = matrix / np.linalg.norm(matrix, axis=0)
        spans = bool(np.isfinite(matrix).all()) and abs(np.linalg.det(matrix)) > 1e-6
    if not spans:
        notes.append("the directions of the axes in the header span no space; they are not used")
        return None
    x, y, z = ((float(row[0]), float(row[1]), float(row[2])) for row in matrix + 0.0)  # no -0.0
    return (x, y, z)


def direction_of_ras(columns: Sequence[Sequence[float]], notes: list[str]) -> Direction | None:
    """`direction_of` for a world whose axes point right, anterior and superior."""
    return direction_of(columns, notes, to_lps=LPS_OF_RAS)
