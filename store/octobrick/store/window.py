"""The planes of one level that something still needs: in memory, or in a scratch file."""

from __future__ import annotations

import os
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Voxels = NDArray[Any]

SCRATCH_PREFIX = ".scratch-"
Columns = Callable[[int, int], Voxels]
"""Gives columns from the first up to, and without, the second, (z, y, x[, 3])."""

_PIECE_NBYTES = 16 * 2**20  # of held planes, read at a time for a checkpoint


class Window(ABC):
    """Planes ``first_z`` up to ``stop_z`` of a level, and room for some behind them.

    Positions are those of the level. Rows may be put in any order; whoever puts them says by
    `complete_to` how far all planes are there.

    Args:
        nplanes: how many there is room for.
        row_shape: (ny, nx), or (ny, nx, 3) for vectors.
        dtype: sample type.
    """

    def __init__(self, nplanes: int, row_shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
        self._nplanes = nplanes
        self._row_shape = row_shape
        self._dtype = dtype
        self.first_z = 0
        self.stop_z = 0

    @property
    def room_stop_z(self) -> int:
        """Behind the last plane that can be put."""
        return self.first_z + self._nplanes

    def complete_to(self, z: int) -> None:
        """All planes before ``z`` are there."""
        self.stop_z = z

    @abstractmethod
    def put(self, z: int, y: int, rows: Voxels) -> None:
        """Take whole rows (nz, ny, nx[, 3]) from (z, y) on."""

    def put_blocks(self, z: int, y: int, blocks: Sequence[Voxels]) -> None:
        """Take rows from (z, y) on, given as blocks beside each other along x."""
        self.put(z, y, np.concatenate(blocks, axis=2))

    @abstractmethod
    def rows(self, start_z: int, stop_z: int, start_y: int, stop_y: int) -> Columns:
        """These rows, of which any thread may take columns until they are dropped."""

    @abstractmethod
    def drop_to(self, z: int) -> None:
        """Forget the planes before ``z``."""

    def held(self) -> Iterator[Voxels]:
        """The planes that are complete, (z, y, x[, 3]), as pieces of bounded size, in order."""
        for z0, z1, y0, y1 in pieces_of(self.held_shape, self._dtype):
            columns = self.rows(self.first_z + z0, self.first_z + z1, y0, y1)
            yield columns(0, self._row_shape[1])

    @property
    def held_shape(self) -> tuple[int, ...]:
        """Of all that `held` gives together."""
        return (self.stop_z - self.first_z, *self._row_shape)

    @property
    def dtype(self) -> np.dtype[Any]:
        """Sample type."""
        return self._dtype

    def begin_at(self, first_z: int) -> None:
        """Be empty, the next plane being ``first_z``."""
        self.first_z = self.stop_z = first_z

    @property
    def _plane_nbytes(self) -> int:
        return int(np.prod(self._row_shape)) * self._dtype.itemsize


def pieces_of(shape: tuple[int, ...], dtype: np.dtype[Any]) -> Iterator[tuple[int, int, int, int]]:
    """First and last but one plane and row of pieces of an array that follow each other in memory.

    They are of a bounded size; either of whole planes, or of rows of one.
    """
    nz, ny = shape[:2]
    row_nbytes = max(int(np.prod(shape[2:])) * dtype.itemsize, 1)
    nplanes = max(1, _PIECE_NBYTES // (row_nbytes * max(ny, 1)))
    nrows = ny if nplanes > 1 else min(max(1, _PIECE_NBYTES // row_nbytes), ny)
    for z in range(0, nz, nplanes):
        for y in range(0, ny, nrows):
            yield z, min(z + nplanes, nz), y, min(y + nrows, ny)


class MemoryWindow(Window):
    """A window in memory."""

    def __init__(self, nplanes: int, row_shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
        super().__init__(nplanes, row_shape, dtype)
        self._planes = np.empty((nplanes, *row_shape), dtype)

    def put(self, z: int, y: int, rows: Voxels) -> None:
        """See `Window.put`."""
        self.put_blocks(z, y, [rows])

    def put_blocks(self, z: int, y: int, blocks: Sequence[Voxels]) -> None:
        """See `Window.put_blocks`."""
        x, (nz, ny) = 0, blocks[0].shape[:2]
        rows = self._planes[z - self.first_z : z - self.first_z + nz, y : y + ny]
        for block in blocks:
            rows[:, :, x : x + block.shape[2]] = block
            x += block.shape[2]

    def rows(self, start_z: int, stop_z: int, start_y: int, stop_y: int) -> Columns:
        """See `Window.rows`."""
        rows = self._planes[start_z - self.first_z : stop_z - self.first_z, start_y:stop_y]
        return partial(_columns, rows)

    def drop_to(self, z: int) -> None:
        """See `Window.drop_to`."""
        step, nheld = z - self.first_z, self.stop_z - self.first_z
        for at in range(step, nheld, max(step, 1)):  # as many as can move without meeting
            moved = self._planes[at : min(at + step, nheld)]
            self._planes[at - step : at - step + len(moved)] = moved
        self.first_z = z


class PieceWindow(Window):
    """A window that keeps what was put as it is: of that nothing is copied but by who takes it."""

    def __init__(self, nplanes: int, row_shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
        super().__init__(nplanes, row_shape, dtype)
        self._pieces: list[tuple[int, int, Voxels]] = []  # first plane, first row, rows

    def put(self, z: int, y: int, rows: Voxels) -> None:
        """See `Window.put`; nobody may write into the rows any more."""
        self._pieces.append((z, y, rows))

    def rows(self, start_z: int, stop_z: int, start_y: int, stop_y: int) -> Columns:
        """See `Window.rows`."""
        parts = []
        for z, y, rows in self._pieces:
            z0, z1 = max(start_z, z), min(stop_z, z + rows.shape[0])
            y0, y1 = max(start_y, y), min(stop_y, y + rows.shape[1])
            if z0 < z1 and y0 < y1:
                at = (slice(z0 - start_z, z1 - start_z), slice(y0 - start_y, y1 - start_y))
                parts.append((at, rows[z0 - z : z1 - z, y0 - y : y1 - y]))
        shape = (stop_z - start_z, stop_y - start_y)
        return partial(_gathered, tuple(parts), shape, self._row_shape[2:], self._dtype)

    def drop_to(self, z: int) -> None:
        """See `Window.drop_to`."""
        self._pieces = [piece for piece in self._pieces if piece[0] + piece[2].shape[0] > z]
        self.first_z = z


class ScratchWindow(Window):
    """A window in a file without a name, which vanishes with the process, however that ends.

    Rows are written and read by system calls, not mapped: what the system caches of the file does
    not count as this process's memory.
    """

    def __init__(
        self, nplanes: int, row_shape: tuple[int, ...], dtype: np.dtype[Any], folder: Path
    ) -> None:
        super().__init__(nplanes, row_shape, dtype)
        self._descriptor, name = tempfile.mkstemp(prefix=SCRATCH_PREFIX, dir=folder)
        Path(name).unlink()

    def __del__(self) -> None:
        # Windows go with their pyramid, whether it came to its end or not.
        if hasattr(self, "_descriptor"):
            os.close(self._descriptor)

    def put(self, z: int, y: int, rows: Voxels) -> None:
        """See `Window.put`."""
        rows = np.ascontiguousarray(rows, self._dtype)
        for i, plane in enumerate(rows):
            _write_all(self._descriptor, plane, self._offset(z + i, y))

    def rows(self, start_z: int, stop_z: int, start_y: int, stop_y: int) -> Columns:
        """See `Window.rows`; read here, for all that takes columns."""
        shape = (stop_z - start_z, stop_y - start_y, *self._row_shape[1:])
        out = np.empty(shape, self._dtype)
        for i, plane in enumerate(out):
            _read_all(self._descriptor, plane, self._offset(start_z + i, start_y))
        return partial(_columns, out)

    def drop_to(self, z: int) -> None:
        """See `Window.drop_to`."""
        self.first_z = z  # planes lie in a ring

    def _offset(self, z: int, y: int) -> int:
        row_nbytes = self._plane_nbytes // self._row_shape[0]
        return (z % self._nplanes) * self._plane_nbytes + y * row_nbytes


def _columns(rows: Voxels, start_x: int, stop_x: int) -> Voxels:
    return rows[:, :, start_x:stop_x]


def _gathered(
    parts: tuple[tuple[tuple[slice, slice], Voxels], ...],
    shape: tuple[int, int],
    vector: tuple[int, ...],
    dtype: np.dtype[Any],
    start_x: int,
    stop_x: int,
) -> Voxels:
    out = np.empty((*shape, stop_x - start_x, *vector), dtype)
    for at, rows in parts:
        out[at] = rows[:, :, start_x:stop_x]
    return out


def _write_all(descriptor: int, array: Voxels, offset: int) -> None:
    data = array.data.cast("B")
    while data:
        nbytes = os.pwrite(descriptor, data, offset)
        data, offset = data[nbytes:], offset + nbytes


def _read_all(descriptor: int, array: Voxels, offset: int) -> None:
    data = array.data.cast("B")
    while data:
        nbytes = os.preadv(descriptor, [data], offset)
        if nbytes == 0:
            raise OSError(f"the scratch file ends at {offset}, {len(data)} bytes are missing")
        data, offset = data[nbytes:], offset + nbytes


class WindowShape(NamedTuple):
    """What a window is made of."""

    nplanes: int
    row_shape: tuple[int, ...]
    dtype: np.dtype[Any]

    @property
    def nbytes(self) -> int:
        """Of all planes."""
        return self.nplanes * int(np.prod(self.row_shape)) * self.dtype.itemsize


MakeWindow = Callable[[str, WindowShape], Window]
"""The window of an array, by its path below the volume."""


def memory_window(array: str, shape: WindowShape) -> Window:
    """The window of an array, in memory; that of level 0 keeps the pieces of the source."""
    return PieceWindow(*shape) if array == "0" else MemoryWindow(*shape)
