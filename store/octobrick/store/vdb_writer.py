"""Voxels to an OpenVDB file: boxes one after another, of which only active voxels are kept."""

from __future__ import annotations

import contextlib
import math
import os
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from octobrick.codec.errors import InvalidInputError
from octobrick.store.box import Zyx
from octobrick.store.errors import DestinationError
from octobrick.store.openvdb import import_vdb

GridClass = Literal["fog volume", "level set", "unknown"]

# The type of a grid for each type of samples that loses nothing; uint64 has none.
_GRID_DTYPES = {
    "bool": "bool",
    "uint8": "int32",
    "int8": "int32",
    "uint16": "int32",
    "int16": "int32",
    "int32": "int32",
    "uint32": "int64",
    "int64": "int64",
    "float16": "float32",
    "float32": "float32",
    "float64": "float64",
}


def write_vdb(
    path: str | os.PathLike[str],
    boxes: Iterable[tuple[Zyx, npt.NDArray[Any]]],
    *,
    dtype: npt.DTypeLike,
    name: str = "density",
    active: tuple[float, float] | None = None,
    background: float = 0,
    spacing_zyx: tuple[float, float, float] = (1.0, 1.0, 1.0),
    origin_xyz: tuple[float, float, float] = (0.0, 0.0, 0.0),
    grid_class: GridClass = "fog volume",
    half: bool = False,
) -> int:
    """Write a grid of boxes of voxels; the file appears when it is complete, or not at all.

    Memory grows with the active voxels (some 8 bytes each where they are dense), not with the
    boxes, which may be made while they are asked for.

    Args:
        path: the file; one that is there is replaced.
        boxes: pairs of where a box begins (z, y, x; negative too) and its voxels, an array
            (z, y, x); where boxes overlap, the later one counts.
        dtype: sample type of the boxes; decides that of the grid: int32 or int64 for integers
            (of up to 63 bits), float, double or bool. Give ``"float32"`` for a grid that renderers
            take as density.
        name: of the grid.
        active: the lowest and the highest value of active voxels; others, and NaN, are left out
            and read as background. None keeps all.
        background: the value of space that is not stored.
        spacing_zyx: distance of voxels in the world.
        origin_xyz: where voxel (0, 0, 0) lies in the world.
        grid_class: what applications shall take the grid for.
        half: whether floats are stored with 16 bits.

    Returns:
        How many voxels are active.

    Raises:
        InvalidInputError: a type that no grid has, an active range or spacing that makes no
            sense, or an array of another type or number of axes.
        DestinationError: the file cannot be written.
        ResourceError: octobrick was built without OpenVDB.
    """
    path = Path(path)
    grid_dtype = _grid_dtype(np.dtype(dtype), path)
    _require_sense(path, active, spacing_zyx, origin_xyz)
    vdb = import_vdb(f"{path}: writing this format")
    writer = vdb.Writer(grid_dtype.name, float(background))
    for (z, y, x), voxels in boxes:
        if voxels.dtype != np.dtype(dtype) or voxels.ndim != 3:
            raise InvalidInputError(
                f"{path}: a box is {voxels.dtype.name} with {voxels.ndim} axes; expected "
                f"{np.dtype(dtype).name} with the three axes z, y, x",
                path=str(path),
            )
        if not voxels.size:
            continue
        try:
            writer.add(np.ascontiguousarray(voxels, grid_dtype), (int(x), int(y), int(z)), active)
        except (TypeError, ValueError) as error:
            raise InvalidInputError(
                f"{path}: the box at {(z, y, x)} (z, y, x) of {voxels.shape} voxels cannot be in a "
                "grid, whose indices are within 2^30 of 0; move it",
                path=str(path),
            ) from error
    with _replacing(path) as temporary:
        writer.save(
            str(temporary),
            name,
            grid_class,
            tuple(map(float, reversed(spacing_zyx))),
            tuple(map(float, origin_xyz)),
            half and grid_dtype.kind == "f",
        )
        vdb.list_grids(str(temporary))  # a full disk need not be an error to OpenVDB
    return int(writer.active_voxels)


def _grid_dtype(dtype: np.dtype[Any], path: Path) -> np.dtype[Any]:
    if dtype.name not in _GRID_DTYPES:
        raise InvalidInputError(
            f"{path}: no OpenVDB grid holds {dtype.name}; convert it to one of "
            f"{', '.join(_GRID_DTYPES)}",
            path=str(path),
            dtype=dtype.name,
        )
    return np.dtype(_GRID_DTYPES[dtype.name])


def _require_sense(
    path: Path,
    active: tuple[float, float] | None,
    spacing_zyx: tuple[float, float, float],
    origin_xyz: tuple[float, float, float],
) -> None:
    if active is not None and not active[0] <= active[1]:
        raise InvalidInputError(
            f"{path}: active values from {active[0]} to {active[1]} are none; give the lowest "
            "first, then the highest",
            path=str(path),
            active=list(active),
        )
    if not all(math.isfinite(size) and size > 0 for size in spacing_zyx):
        raise InvalidInputError(
            f"{path}: the spacing {spacing_zyx} (z, y, x) needs three finite sizes above 0",
            path=str(path),
            spacing_zyx=list(spacing_zyx),
        )
    if not all(map(math.isfinite, origin_xyz)):
        raise InvalidInputError(
            f"{path}: the origin {origin_xyz} (x, y, z) needs three finite places",
            path=str(path),
            origin_xyz=list(origin_xyz),
        )


@contextlib.contextmanager
def _replacing(path: Path) -> Iterator[Path]:
    """A temporary file beside ``path``, which takes its place if all goes well."""
    temporary: Path | None = None
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".partial", dir=path.parent)
        os.close(handle)
        temporary = Path(name)
        yield temporary
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        temporary.replace(path)
    except (OSError, EOFError, RuntimeError) as error:  # those of OpenVDB, and of the check
        raise DestinationError(
            f"{path}: cannot be written: {error}; check the folder, its permissions and the space "
            "on the disk",
            path=str(path),
            reason=str(error),
        ) from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
