"""OpenVDB (``.vdb``): one grid, kept in memory as the sparse tree that it is."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from octobrick.codec.errors import InvalidInputError
from octobrick.store.box import Box
from octobrick.store.errors import SourceError, TruncatedSourceError, UnsupportedSourceError
from octobrick.store.openvdb import import_vdb
from octobrick.store.sources.base import Description, Pick, Source
from octobrick.store.sources.head import printable, require_file
from octobrick.store.sources.vdb_grid import (
    Xyz,
    choose_grid,
    finite_background,
    no_active_voxel,
    place_of,
    vector_channels,
)
from octobrick.store.sources.voxels import require_shape

if TYPE_CHECKING:
    from octobrick.store._vdb import Grid, GridInfo

MAGIC = b" BDV\0\0\0\0"


class OpenvdbSource(Source):
    """One grid of a ``.vdb`` file: the smallest box around its active voxels.

    The tree is read when the file is opened and stays in memory until the source is closed; space
    without voxels is never made dense beyond the box that is asked for. Voxels that are not active
    have the values that the tree gives them: the background, or minus that inside a level set.
    """

    def __init__(self, path: Path, description: Description, grid: Grid, start_xyz: Xyz) -> None:
        super().__init__(path, description)
        self._grid: Grid | None = grid
        self._start_xyz = start_xyz

    def _read(self, box: Box, t: int, c: int) -> npt.NDArray[Any]:  # noqa: ARG002
        voxels = np.empty(box.shape_zyx, self.dtype)
        self._open_grid.fill(voxels, self._index_xyz(box), c)
        return voxels

    def _read_channels(self, box: Box, t: int) -> npt.NDArray[Any]:  # noqa: ARG002
        voxels = np.empty((self.nc, *box.shape_zyx), self.dtype)
        for c in range(self.nc):
            self._open_grid.fill(voxels[c], self._index_xyz(box), c)
        return voxels

    def _constant(self, box: Box, t: int, c: int) -> float | None:  # noqa: ARG002
        nz, ny, nx = box.shape_zyx
        return self._open_grid.constant(self._index_xyz(box), (nx, ny, nz), c)

    def _index_xyz(self, box: Box) -> Xyz:
        """Where a box of voxels begins in the index space of the grid."""
        (z, y, x), (x0, y0, z0) = box.start_zyx, self._start_xyz
        return (x0 + x, y0 + y, z0 + z)

    @property
    def _open_grid(self) -> Grid:
        assert self._grid is not None
        return self._grid

    def _close(self) -> None:
        self._grid = None


def open_openvdb(path: Path, pick: Pick) -> Source:
    """A grid of a ``.vdb`` file, of float, half, double, int32, int64, bool or Vec3 values.

    Args:
        path: the file.
        pick: ``dataset`` is the name of the grid; a file that holds only one needs none.

    Raises:
        SourceError: the file is damaged or cut short, or no voxel of the grid is active.
        UnsupportedSourceError: a kind of values, transform or file that is not read.
        InvalidInputError: several grids and none named, or no grid of that name.
        ResourceError: octobrick was built without OpenVDB.
    """
    if pick.axes is not None:
        raise InvalidInputError(
            f"{path}: OpenVDB names its axes; leave out --axes", path=str(path), options=["--axes"]
        )
    require_file(path)
    vdb = import_vdb(f"{path}: reading this format")
    with _reading(path, vdb):
        file = vdb.list_grids(str(path))
        grids = [(grid.name, grid.value_type) for grid in file.grids]
        index = choose_grid(grids, pick.dataset, path)
        info = file.grids[index]
        _require_readable(info, path)
        grid = vdb.load_grid(str(path), file, index)
        active = grid.active_box()
    if active is None:
        raise no_active_voxel(info.name, path)
    start_xyz, shape_xyz = active
    return OpenvdbSource(path, _describe(info, grid, start_xyz, shape_xyz, path), grid, start_xyz)


def _require_readable(info: GridInfo, path: Path) -> None:
    if info.sample_type is None:
        raise UnsupportedSourceError(
            f"{path}: the values of grid {printable(info.name)!r} are "
            f"{printable(info.value_type)}; those read are float, half, double, int32, int64, "
            "bool and Vec3; convert it to one of these",
            path=str(path),
            dtype=info.value_type,
        )
    if not info.transform.is_linear:
        raise UnsupportedSourceError(
            f"{path}: grid {printable(info.name)!r} has a {printable(info.transform.kind)}, whose "
            "voxels differ in size; resample it to a linear transform",
            path=str(path),
            transform=info.transform.kind,
        )


def _describe(
    info: GridInfo, grid: Grid, start_xyz: Xyz, shape_xyz: Xyz, path: Path
) -> Description:
    notes: list[str] = []
    transform = info.transform
    place = place_of(transform.linear, transform.translation, start_xyz, notes)
    is_vector = grid.components == 3
    return Description(
        "openvdb",
        require_shape(shape_xyz, path),
        np.dtype(grid.sample_type),
        place.spacing_zyx,
        direction=place.direction,
        origin_xyz=place.origin_xyz,
        nc=grid.components,
        channels=vector_channels(info.name) if is_vector else (),
        background=0 if is_vector else finite_background(grid.background(), notes),
        warnings=tuple(notes),
    )


@contextmanager
def _reading(path: Path, vdb: ModuleType) -> Iterator[None]:
    """Turn what the extension raises into errors that name the file."""
    try:
        yield
    except vdb.TruncatedError as error:
        raise TruncatedSourceError(
            f"{path}: ends too early: {printable(str(error))}; copy or export it again",
            path=str(path),
            reason=str(error),
        ) from error
    except vdb.UnsupportedError as error:
        raise UnsupportedSourceError(
            f"{path}: cannot be read: {printable(str(error))}; open it in an application that "
            "uses OpenVDB and save it again",
            path=str(path),
            reason=str(error),
        ) from error
    except (RuntimeError, UnicodeDecodeError) as error:  # also what OpenVDB itself throws
        raise SourceError(
            f"{path}: is damaged: {printable(str(error))}; copy or export it again",
            path=str(path),
            reason=str(error),
        ) from error
