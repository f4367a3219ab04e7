"""NanoVDB (``.nvdb``): one grid, of which only the nodes that a box meets are read."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from octobrick.codec.errors import InvalidInputError
from octobrick.store.box import Box
from octobrick.store.errors import UnsupportedSourceError
from octobrick.store.sources.base import RGBA, Channel, Description, Pick, Source
from octobrick.store.sources.head import printable
from octobrick.store.sources.nanovdb_file import (
    GRID_NBYTES,
    MAGICS,
    Entry,
    GridFile,
    list_grids,
    require_version,
)
from octobrick.store.sources.nanovdb_tree import Span, Tree
from octobrick.store.sources.nanovdb_values import READ, READ_NAMES, Values, kind_name
from octobrick.store.sources.vdb_grid import (
    Xyz,
    choose_grid,
    finite_background,
    no_active_voxel,
    place_of,
    vector_channels,
)
from octobrick.store.sources.voxels import require_shape

# The matrix and the translation of the map, in double precision.
_MATRIX, _TRANSLATION = 296 + 88, 296 + 232
_CLASS_AND_KIND = struct.Struct("<II")
_POINT_CLASSES = (4, 5)


class NanovdbSource(Source):
    """One grid of a ``.nvdb`` file: the box around its active voxels, as the grid tells it.

    Nodes are read when a box meets them, and a few are kept. Voxels that are not active have the
    values that the tree gives them: the background, or minus that inside a level set.
    """

    def __init__(
        self, path: Path, description: Description, grid: GridFile, tree: Tree, start_xyz: Xyz
    ) -> None:
        super().__init__(path, description)
        self._grid, self._tree, self._start_xyz = grid, tree, start_xyz

    def _read(self, box: Box, t: int, c: int) -> npt.NDArray[Any]:  # noqa: ARG002
        voxels: npt.NDArray[Any] = self._filled(box, slice(c, c + 1))[0]
        return voxels

    def _read_channels(self, box: Box, t: int) -> npt.NDArray[Any]:  # noqa: ARG002
        return self._filled(box, slice(0, self.nc))

    def _filled(self, box: Box, components: slice) -> npt.NDArray[Any]:
        shape = (components.stop - components.start, *box.shape_zyx)
        voxels = np.empty(shape, self.dtype)
        self._tree.fill(voxels, self._index_xyz(box), components)
        return voxels

    def _constant(self, box: Box, t: int, c: int) -> float | None:  # noqa: ARG002
        x, y, z = self._index_xyz(box)
        nz, ny, nx = box.shape_zyx
        return self._tree.constant(Span((x, y, z), (x + nx, y + ny, z + nz)), c)

    def _index_xyz(self, box: Box) -> Xyz:
        """Where a box of voxels begins in the index space of the grid."""
        (z, y, x), (x0, y0, z0) = box.start_zyx, self._start_xyz
        return (x0 + x, y0 + y, z0 + z)

    def _close(self) -> None:
        self._grid.close()


def is_nanovdb(head: bytes) -> bool:
    """Whether bytes begin a NanoVDB file."""
    return head.startswith(MAGICS)


def open_nanovdb(path: Path, pick: Pick) -> Source:
    """A grid of a ``.nvdb`` file of version 32.

    Args:
        path: the file.
        pick: ``dataset`` is the name of the grid; a file that holds only one needs none.

    Raises:
        SourceError: the file is damaged or cut short, or no voxel of the grid is active.
        UnsupportedSourceError: a kind of values or a version that is not read.
        InvalidInputError: several grids and none named, or no grid of that name.
        ResourceError: there is no room to unpack the grid, or no numcodecs for one of blosc.
    """
    if pick.axes is not None:
        raise InvalidInputError(
            f"{path}: NanoVDB names its axes; leave out --axes", path=str(path), options=["--axes"]
        )
    entries = list_grids(path)
    grids = [(entry.name, kind_name(entry.kind)) for entry in entries]
    entry = entries[choose_grid(grids, pick.dataset, path)]
    values = _require_values(entry, path)
    grid = GridFile(path, entry)
    try:
        head = grid.read(0, GRID_NBYTES)
        _require_grid(head, entry, grid, path)
        tree = Tree(grid, values)
        first, last = tree.active
        if any(a > b for a, b in zip(first, last, strict=True)):
            raise no_active_voxel(entry.name, path)
        description = _describe(head, entry.name, values, tree, path)
    except BaseException:
        grid.close()
        raise
    x, y, z = first
    return NanovdbSource(path, description, grid, tree, (x, y, z))


def _require_values(entry: Entry, path: Path) -> Values:
    if entry.kind in READ:
        return READ[entry.kind]
    raise UnsupportedSourceError(
        f"{path}: the values of grid {printable(entry.name)!r} are {kind_name(entry.kind)}; "
        f"those read are {', '.join(READ_NAMES)}; convert it to one of these",
        path=str(path),
        dtype=kind_name(entry.kind),
    )


def _require_grid(head: bytes, entry: Entry, grid: GridFile, path: Path) -> None:
    """The description in the grid itself must be that of the file."""
    if head[:8] not in MAGICS:
        raise grid.damaged(f"it begins with {head[:8]!r}")
    require_version(int.from_bytes(head[16:20], "little"), path)
    grid_class, kind = _CLASS_AND_KIND.unpack_from(head, 632)
    if kind != entry.kind:
        raise grid.damaged(f"its values are {kind_name(kind)}, not {kind_name(entry.kind)}")
    if grid_class in _POINT_CLASSES:
        raise UnsupportedSourceError(
            f"{path}: grid {printable(entry.name)!r} holds points, not voxels; "
            "make a density of them first",
            path=str(path),
            grid=entry.name,
        )


def _describe(head: bytes, name: str, values: Values, tree: Tree, path: Path) -> Description:
    notes: list[str] = []
    first, last = tree.active
    shape_xyz = [b - a + 1 for a, b in zip(first, last, strict=True)]
    matrix = np.frombuffer(head, "<f8", 9, _MATRIX).reshape(3, 3)
    translation = np.frombuffer(head, "<f8", 3, _TRANSLATION)
    x, y, z = first
    place = place_of(matrix.T.tolist(), translation.tolist(), (x, y, z), notes)
    is_scalar = values.components == 1
    return Description(
        "nanovdb",
        require_shape(shape_xyz, path),
        np.dtype(values.dtype),
        place.spacing_zyx,
        direction=place.direction,
        origin_xyz=place.origin_xyz,
        nc=values.components,
        channels=_channels(name, values.components),
        background=finite_background(float(tree.background[0]), notes) if is_scalar else 0,
        warnings=tuple(notes),
    )


def _channels(name: str, components: int) -> tuple[Channel, ...]:
    return {3: vector_channels(name), 4: RGBA}.get(components, ())
