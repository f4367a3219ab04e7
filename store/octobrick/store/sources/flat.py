"""Flat voxels: one sample after another, from which a box is read run by run.

The bytes of a box of a C-order array are runs of ``nx`` samples at a regular stride:

    row (z, y) of the box begins at sample ((z0 + z) * NY + (y0 + y)) * NX + x0 of the file

Runs that touch are read as one (a box of whole planes is a single run). Rows that are cut in x are
read whole into a small stage and cut there, unless so much of them is unwanted that many small
reads are faster.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from octobrick.codec.errors import ResourceError
from octobrick.store.box import Box, Zyx
from octobrick.store.sources.base import Description, Source

# Large enough that a system call does not matter, small beside any slab.
_STAGE_NBYTES = 1 << 20
# What a read of its own costs, as bytes that could have been copied in the same time.
_READ_COST_NBYTES = 1 << 13


@dataclass(frozen=True, slots=True)
class Layout:
    """Where the voxels of a volume lie.

    Attributes:
        path: the file that holds them.
        offset_nbytes: position of the first sample; in compressed data, after decompression.
        dtype: sample type with the byte order of the file.
        z_fastest: whether z varies fastest (a Fortran-order array) and not x.
        stream_offset_nbytes: where compressed data begin in the file.
    """

    path: Path
    offset_nbytes: int
    dtype: np.dtype[Any]
    z_fastest: bool = False
    stream_offset_nbytes: int = 0


class FlatSource(Source):
    """A source whose voxels are flat; subclasses say how bytes are got from the file."""

    #: Whether skipping bytes saves nothing, because they have to be decoded anyway.
    _skips_cost = False

    def __init__(self, path: Path, description: Description, layout: Layout) -> None:
        super().__init__(path, description)
        self._layout = layout
        # From here on an array of the file's own axis order, slowest first.
        nz, ny, nx = description.shape_zyx
        self._file_shape: Zyx = (nx, ny, nz) if layout.z_fastest else (nz, ny, nx)

    @property
    def files(self) -> tuple[Path, ...]:
        """The header, and the file of the voxels where it is another."""
        voxels = self._layout.path
        return (self.path,) if voxels == self.path else (self.path, voxels)

    @abstractmethod
    def _read_at(self, position: int, into: memoryview) -> None:
        """Fill ``into`` with bytes from ``position`` of the (decompressed) file."""

    def _read(self, box: Box, t: int, c: int) -> npt.NDArray[Any]:  # noqa: ARG002
        out = _empty(box.shape_zyx, self.dtype, self.path)
        if self._layout.z_fastest:
            self._read_transposed(box, out)
        else:
            self._read_runs(box.start_zyx, out)
        if not self._layout.dtype.isnative:
            out.byteswap(inplace=True)
        if out.dtype == np.bool_:  # any other byte than 0 and 1 would upset numpy
            np.not_equal(out.view(np.uint8), 0, out=out)
        return out

    def _read_transposed(self, box: Box, out: npt.NDArray[Any]) -> None:
        """Read a box of a z-fastest file by parts of a bounded size, each turned over at once."""
        nz, ny, nx = out.shape
        thickness = max(1, _STAGE_NBYTES // (nz * ny * out.itemsize))
        z0, y0, x0 = box.start_zyx
        for x in range(0, nx, thickness):
            part = np.empty((min(thickness, nx - x), ny, nz), out.dtype)
            self._read_runs((x0 + x, y0, z0), part)
            out[:, :, x : x + thickness] = part.T

    def _read_runs(self, start: Zyx, out: npt.NDArray[Any]) -> None:
        """Fill ``out`` from voxel ``start``, both in the axis order of the file."""
        (_, file_ny, file_nx), (nz, ny, nx) = self._file_shape, out.shape
        if nx == file_nx and ny == file_ny:
            self._read_at(self._position(start), _bytes_of(out))
            return
        z0, y0, x0 = start
        for z in range(nz):
            if nx == file_nx:
                self._read_at(self._position((z0 + z, y0, 0)), _bytes_of(out[z]))
            elif self._stage_pays(nx):
                self._read_rows_staged((z0 + z, y0, x0), out[z])
            else:
                for y in range(ny):
                    self._read_at(self._position((z0 + z, y0 + y, x0)), _bytes_of(out[z, y]))

    def _stage_pays(self, nx: int) -> bool:
        row_nbytes = self._file_shape[2] * self.dtype.itemsize
        unwanted_nbytes = row_nbytes - nx * self.dtype.itemsize
        pays = self._skips_cost or unwanted_nbytes <= _READ_COST_NBYTES
        return pays and row_nbytes <= _STAGE_NBYTES

    def _read_rows_staged(self, start: Zyx, plane: npt.NDArray[Any]) -> None:
        """Fill one plane of a box from whole rows, as many at a time as the stage holds."""
        file_nx = self._file_shape[2]
        (ny, nx), (z, y0, x0) = plane.shape, start
        nrows = min(ny, _STAGE_NBYTES // (file_nx * self.dtype.itemsize))
        stage = np.empty((nrows, file_nx), self.dtype)
        for y in range(0, ny, nrows):
            rows = stage[: min(nrows, ny - y)]
            self._read_at(self._position((z, y0 + y, 0)), _bytes_of(rows))
            plane[y : y + nrows] = rows[:, x0 : x0 + nx]

    def _position(self, voxel: Zyx) -> int:
        """The byte at which a voxel begins, given in the axis order of the file."""
        (_, ny, nx), (z, y, x) = self._file_shape, voxel
        return self._layout.offset_nbytes + ((z * ny + y) * nx + x) * self.dtype.itemsize


def _empty(shape: Zyx, dtype: np.dtype[Any], path: Path) -> npt.NDArray[Any]:
    try:
        return np.empty(shape, dtype)
    except MemoryError as error:
        nbytes = Box.of_shape(shape).nvoxels * dtype.itemsize
        raise ResourceError(
            f"{path}: a box of {shape} voxels (z, y, x) takes {nbytes} bytes of memory, "
            "which cannot be had; read a smaller box",
            path=str(path),
            nbytes=nbytes,
        ) from error


def _bytes_of(array: npt.NDArray[Any]) -> memoryview:
    """The memory of a C-contiguous array."""
    return array.data.cast("B")
