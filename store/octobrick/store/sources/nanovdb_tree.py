"""The tree of a NanoVDB grid: boxes of it, made dense from the nodes that they meet.

Below the root are nodes of 32³ children, nodes of 16³ and leaves of 8³ voxels. Where a node has no
child it has a tile, one value for all of its voxels. Every number is checked before it is used:
nodes lie inside the grid, and no two parents share a child, so that work is bounded by its size.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from octobrick.store.sources.nanovdb_file import GRID_NBYTES, GridFile
from octobrick.store.sources.nanovdb_leaves import Leaves
from octobrick.store.sources.nanovdb_values import Values
from octobrick.store.sources.vdb_grid import Xyz

_TREE_NBYTES = 64
_UPPER_LOG2, _LOWER_LOG2, _LEAF_LOG2 = 5, 4, 3
_ROOT_SIDE = 1 << _UPPER_LOG2 + _LOWER_LOG2 + _LEAF_LOG2
_LOWER_SIDE = 1 << _LOWER_LOG2 + _LEAF_LOG2
_LEAF_SIDE = 1 << _LEAF_LOG2
# A root covers 4096³ voxels with each tile: more are no grid that anyone has.
_MOST_TILES = 1 << 18
_UPPERS_KEPT, _LOWERS_KEPT = 4, 128

Voxels = npt.NDArray[Any]


class Span(NamedTuple):
    """A box of voxels in index space: from start up to, not including, stop."""

    start: Xyz
    stop: Xyz

    def within(self, origin: Xyz, side: int) -> Span:
        """The part of it inside a cube."""
        start = tuple(max(a, o) for a, o in zip(self.start, origin, strict=True))
        stop = tuple(min(b, o + side) for b, o in zip(self.stop, origin, strict=True))
        return Span(start, stop)  # type: ignore[arg-type]

    def cells(self, origin: Xyz, side: int) -> tuple[slice, slice, slice]:
        """Which cells of a node that begins at ``origin`` it meets, along x, y and z."""
        x, y, z = (
            slice((a - o) // side, (b - 1 - o) // side + 1)
            for a, b, o in zip(self.start, self.stop, origin, strict=True)
        )
        return x, y, z

    @property
    def nvoxels(self) -> int:
        """How many voxels it has."""
        x, y, z = (b - a for a, b in zip(self.start, self.stop, strict=True))
        return x * y * z


class _Node(NamedTuple):
    """An inner node: for each cell whether it is a child, its value, and where the child is."""

    is_child: npt.NDArray[np.bool_]
    values: Voxels
    children: npt.NDArray[np.int64]


class Tree:
    """The tree of a grid.

    Args:
        grid: the bytes of the grid.
        values: what its values are.

    Raises:
        SourceError: the grid is damaged.
    """

    def __init__(self, grid: GridFile, values: Values) -> None:
        self._grid, self._values = grid, values
        offsets = np.frombuffer(grid.read(GRID_NBYTES, _TREE_NBYTES), "<u8", 4)
        self._root = GRID_NBYTES + int(offsets[3])
        root = grid.read(self._root, values.root_nbytes)
        box = [int(at) for at in np.frombuffer(root, "<i4", 6)]
        #: First and last active voxel (x, y, z); the last before the first where there is none.
        self.active = (box[:3], box[3:])
        at = values.root_background
        stored = np.frombuffer(root, values.sample, values.components, at)
        #: The value of space without nodes, one for each component.
        self.background: Voxels = stored.astype(values.dtype)
        self._read_tiles(int.from_bytes(root[24:28], "little"))
        self._upper = lru_cache(_UPPERS_KEPT)(lambda at: self._node(at, _UPPER_LOG2))
        self._lower = lru_cache(_LOWERS_KEPT)(lambda at: self._node(at, _LOWER_LOG2))
        self._leaves = Leaves(grid, values)
        self._require_tree()

    def fill(self, out: Voxels, start: Xyz, components: slice) -> None:
        """Write a box into an array (component, z, y, x), from an index (x, y, z) on."""
        _, nz, ny, nx = out.shape
        x, y, z = start
        box = Span(start, (x + nx, y + ny, z + nz))
        out[...] = self.background[components, np.newaxis, np.newaxis, np.newaxis]
        canvas = _Canvas(out, start, components)
        for tile in self._tiles_in(box):
            origin = self._origin(tile)
            part = box.within(origin, _ROOT_SIDE)
            if not self._children[tile]:
                canvas.put(part, self._tile_values[tile])
                continue
            upper = self._upper(self._root + int(self._children[tile]))
            self._fill_cells(canvas, upper, part, origin, _LOWER_SIDE)
            for corner, lower_at in _children_in(upper, part, origin, _LOWER_SIDE):
                lower, inner = self._lower(lower_at), part.within(corner, _LOWER_SIDE)
                self._fill_cells(canvas, lower, inner, corner, _LEAF_SIDE)
                found = list(_children_in(lower, inner, corner, _LEAF_SIDE))
                for leaf_origin, voxels in self._leaves.decoded(found):
                    canvas.put_leaf(leaf_origin, voxels)

    def constant(self, box: Span, component: int) -> float | None:
        """The value of all voxels of a box that meets no leaf and has one value; None otherwise."""
        found: float | None = None
        for values in self._values_in(box):
            if values is None:
                return None
            some = values[..., component]
            if found is None:
                found = some.flat[0].item()
            if not (some == found).all():
                return None
        return found

    def _values_in(self, box: Span) -> Iterator[Voxels | None]:
        """The values that a box meets, above the leaves; None for a leaf."""
        covered = 0
        for tile in self._tiles_in(box):
            origin = self._origin(tile)
            part = box.within(origin, _ROOT_SIDE)
            covered += part.nvoxels
            if not self._children[tile]:
                yield self._tile_values[tile]
                continue
            upper = self._upper(self._root + int(self._children[tile]))
            yield from _tiles(upper, part.cells(origin, _LOWER_SIDE))
            for corner, lower_at in _children_in(upper, part, origin, _LOWER_SIDE):
                lower = self._lower(lower_at)
                cells = part.within(corner, _LOWER_SIDE).cells(corner, _LEAF_SIDE)
                if lower.is_child[cells].any():
                    yield None
                yield from _tiles(lower, cells)
        if covered < box.nvoxels:
            yield self.background

    def _fill_cells(self, canvas: _Canvas, node: _Node, part: Span, origin: Xyz, side: int) -> None:
        """Write the tiles of a node; where it has children, something that they write over."""
        cells = part.cells(origin, side)
        values, is_child = node.values[cells], node.is_child[cells]
        if is_child.all():
            return
        tiles = values[~is_child]
        if (tiles == tiles[0]).all():
            canvas.put(part, tiles[0])
            return
        x, y, z = (
            (np.arange(a, b) - o) // side - cell.start
            for a, b, o, cell in zip(part.start, part.stop, origin, cells, strict=True)
        )
        for cell_z in range(values.shape[2]):
            planes = np.flatnonzero(z == cell_z)
            start = (*part.start[:2], part.start[2] + int(planes[0]))
            stop = (*part.stop[:2], start[2] + len(planes))
            canvas.put(Span(start, stop), values[np.ix_(x, y, [cell_z])])

    def _read_tiles(self, count: int) -> None:
        if count > _MOST_TILES:
            raise self._grid.damaged(f"its root has {count} tiles")
        dtype = self._values.root_tile
        data = self._grid.read(self._root + self._values.root_nbytes, count * dtype.itemsize)
        tiles = np.frombuffer(data, dtype)
        keys = tiles["key"]
        axes = [(keys >> np.uint64(shift)) & np.uint64(0xFFFFF) for shift in (42, 21, 0)]
        # The keys hold the upper 20 bits of each index, whose sign is the topmost of them.
        corners = (np.stack(axes, axis=-1).astype(np.int64) ^ 0x80000) - 0x80000
        self._corners = corners * _ROOT_SIDE
        self._children = tiles["child"].astype(np.int64)
        self._tile_values = tiles["value"].astype(self._values.dtype)
        if len(np.unique(self._corners, axis=0)) != count:
            raise self._grid.damaged("two tiles of its root are at one place")

    def _require_tree(self) -> None:
        """No two parents share a child, and active voxels lie below tiles of the root."""
        first, last = self.active
        if count := len(self._corners):
            low, high = self._corners.min(axis=0), self._corners.max(axis=0) + _ROOT_SIDE
            is_inside = bool((low <= first).all() and (last < high).all())
            if not is_inside and all(a <= b for a, b in zip(first, last, strict=True)):
                raise self._grid.damaged(
                    f"its active voxels {first} to {last} are not those of its {count} root tiles"
                )
        held = self._children[self._children != 0]
        if (np.abs(held) >= self._grid.nbytes).any() or (held == np.iinfo(np.int64).min).any():
            raise self._grid.damaged("a child of the root lies outside of it")
        uppers = self._root + held
        upper_nbytes = self._values.node(_UPPER_LOG2).itemsize
        self._require_apart([(uppers, upper_nbytes)])
        lowers = [node.children[node.is_child] for node in map(self._upper, uppers.tolist())]
        lower_nbytes = self._values.node(_LOWER_LOG2).itemsize
        self._require_apart(
            [(uppers, upper_nbytes), *((places, lower_nbytes) for places in lowers)]
        )

    def _require_apart(self, nodes: list[tuple[npt.NDArray[np.int64], int]]) -> None:
        """Nodes of given places and sizes lie inside the grid, and none upon another."""
        starts = np.concatenate([places for places, _ in nodes])
        stops = np.concatenate([places + nbytes for places, nbytes in nodes])
        order = np.argsort(starts)
        starts, stops = starts[order], stops[order]
        if len(starts) and (starts[0] < 0 or (stops > self._grid.nbytes).any()):
            raise self._grid.damaged("a node lies outside of it")
        if (stops[:-1] > starts[1:]).any():
            raise self._grid.damaged("two nodes lie upon each other")

    def _node(self, at: int, log2_side: int) -> _Node:
        dtype = self._values.node(log2_side)
        data = self._grid.read(at, dtype.itemsize)
        node = np.frombuffer(data, dtype)[0]
        shape = (1 << log2_side,) * 3
        is_child = np.unpackbits(node["children"], bitorder="little").astype(bool).reshape(shape)
        values = node["table"]["value"].astype(self._values.dtype)
        children = node["table"]["child"].reshape(shape)
        held = children[is_child]
        if ((held <= -self._grid.nbytes) | (held >= self._grid.nbytes)).any():
            raise self._grid.damaged(f"a child of the node at byte {at} lies outside of it")
        places = np.where(is_child, children, 0) + at
        return _Node(is_child, values.reshape(*shape, self._values.components), places)

    def _tiles_in(self, box: Span) -> list[int]:
        meets = (self._corners < box.stop) & (self._corners + _ROOT_SIDE > box.start)
        return np.flatnonzero(meets.all(axis=1)).tolist()

    def _origin(self, tile: int) -> Xyz:
        x, y, z = self._corners[tile].tolist()
        return (x, y, z)


class _Canvas:
    """What a box is written into: an array (component, z, y, x) that begins at an index."""

    def __init__(self, out: Voxels, start: Xyz, components: slice) -> None:
        self._out, self._start, self._components = out, start, components

    def put(self, part: Span, values: Voxels) -> None:
        """Write values (x, y, z, component), or one value, into a part of the box."""
        values = values[..., self._components]
        if values.ndim > 1:
            values = values.transpose(3, 2, 1, 0)
        else:
            values = values[:, np.newaxis, np.newaxis, np.newaxis]
        self._out[(slice(None), *self._slices(part))] = values

    def put_leaf(self, origin: Xyz, voxels: Voxels) -> None:
        """Write the part of a leaf that is inside the box; voxels (x, y, z, component)."""
        _, nz, ny, nx = self._out.shape
        x, y, z = (a - b for a, b in zip(origin, self._start, strict=True))
        x0, y0, z0 = max(x, 0), max(y, 0), max(z, 0)
        x1, y1, z1 = min(x + _LEAF_SIDE, nx), min(y + _LEAF_SIDE, ny), min(z + _LEAF_SIDE, nz)
        part = voxels[x0 - x : x1 - x, y0 - y : y1 - y, z0 - z : z1 - z, self._components]
        self._out[:, z0:z1, y0:y1, x0:x1] = part.transpose(3, 2, 1, 0)

    def _slices(self, part: Span) -> tuple[slice, ...]:
        zipped = zip(part.start, part.stop, self._start, strict=True)
        return tuple(slice(a - s, b - s) for a, b, s in zipped)[::-1]


def _tiles(node: _Node, cells: tuple[slice, slice, slice]) -> Iterator[Voxels]:
    tiles = node.values[cells][~node.is_child[cells]]
    if len(tiles):
        yield tiles


def _children_in(node: _Node, part: Span, origin: Xyz, side: int) -> Iterator[tuple[Xyz, int]]:
    """The corner and the place of each child of a node that a part of it meets."""
    cells = part.cells(origin, side)
    where = np.argwhere(node.is_child[cells])
    first = [cell.start for cell in cells]
    corners = ((where + first) * side + origin).tolist()
    places = node.children[cells][tuple(where.T)].tolist()
    return (((x, y, z), place) for (x, y, z), place in zip(corners, places, strict=True))
