"""The source's voxels from a plane on, in pieces of bounded size, some read ahead of their use."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import NotFiniteError
from octobrick.store.box import Box
from octobrick.store.in_order import in_order
from octobrick.store.sources import Source

Voxels = NDArray[np.generic]

# Large enough that a disk streams, small enough that what is read ahead does not count beside the
# slab that is being encoded.
READ_NBYTES = 16 * 2**20
AHEAD = 4  # pieces, so that a layer of bricks does not wait for the first of the next one's planes


class Piece(NamedTuple):
    """Whole rows of all channels.

    Attributes:
        z: of its first plane.
        y: of its first row.
        voxels: (c, z, y, x).
        stop_z: all planes before this one have been given, with this piece.
    """

    z: int
    y: int
    voxels: Voxels
    stop_z: int


class PieceReader:
    """Reads whole rows of all channels in order, plane after plane, as the source is laid out.

    Args:
        source: what is read.
        replace_nonfinite: what stands for NaN and ±Inf; None refuses them.
        brick: no piece has more planes than a brick, but where the source's chunks have.
        piece_nbytes: the size that pieces should have, `READ_NBYTES` by default; none has less
            than a row of chunks.
    """

    def __init__(
        self,
        source: Source,
        replace_nonfinite: float | None,
        brick: int,
        piece_nbytes: int | None = None,
    ) -> None:
        self._source = source
        self._replacement = replace_nonfinite
        piece_nbytes = piece_nbytes or READ_NBYTES
        nz, ny, nx = source.shape_zyx
        row_nbytes = nx * source.dtype.itemsize * source.nc
        chunk_nz, chunk_ny, _ = source.chunk_zyx or (1, 1, 1)
        # Half a chunk costs as much as all of it.
        planes = min(max(1, piece_nbytes // (ny * row_nbytes)), brick)
        self.nplanes = min(max(planes // chunk_nz, 1) * chunk_nz, nz)
        rows = max(1, piece_nbytes // (self.nplanes * row_nbytes))
        self._nrows = min(max(rows // chunk_ny, 1) * chunk_ny, ny)

    @property
    def piece_nbytes(self) -> int:
        """Of the largest piece."""
        source = self._source
        row_nbytes = source.shape_zyx[2] * source.dtype.itemsize * source.nc
        return self.nplanes * self._nrows * row_nbytes

    def pieces(self, t: int, first_z: int) -> Iterator[Piece]:
        """All of a time step from plane ``first_z`` on.

        Raises:
            NotFiniteError: with the voxel's position.
            SourceError: the source is damaged.
        """
        calls = (partial(self._piece, box, t) for box in self._boxes(first_z))
        with ThreadPoolExecutor(1, thread_name_prefix="octobrick-read") as reader:
            try:
                yield from in_order(reader, calls, AHEAD)
            except BaseException:  # nobody waits for what is read ahead, and a server may be silent
                self._source.abandon()
                raise

    def _piece(self, box: Box, t: int) -> Piece:
        (z, y, _), (stop_z, stop_y, _) = box.start_zyx, box.stop_zyx
        is_last = stop_y == self._source.shape_zyx[1]
        return Piece(z, y, self._read(box, t), stop_z if is_last else z)

    def _boxes(self, first_z: int) -> Iterator[Box]:
        nz, ny, nx = self._source.shape_zyx
        start_z = first_z
        while start_z < nz:
            stop_z = min((start_z // self.nplanes + 1) * self.nplanes, nz)
            for start_y in range(0, ny, self._nrows):
                yield Box((start_z, start_y, 0), (stop_z, min(start_y + self._nrows, ny), nx))
            start_z = stop_z

    def _read(self, box: Box, t: int) -> Voxels:
        planes = self._constant(box, t)
        if planes is None:
            planes = self._source.read_channels(box, t)
        if planes.dtype.kind != "f":
            return planes
        finite = np.isfinite(planes)
        if finite.all():
            return planes
        if self._replacement is None:
            raise self._not_finite(planes, finite, box, t)
        return np.where(finite, planes, planes.dtype.type(self._replacement))

    def _constant(self, box: Box, t: int) -> Voxels | None:
        """The planes of space that a sparse source knows to be empty, without reading them."""
        source = self._source
        values = [source.constant(box, t, c) for c in range(source.nc)]
        if any(value is None for value in values):
            return None
        planes = np.empty((source.nc, *box.shape_zyx), source.dtype)
        planes[...] = np.array(values, source.dtype)[:, np.newaxis, np.newaxis, np.newaxis]
        return planes

    def _not_finite(
        self, planes: Voxels, finite: NDArray[np.bool_], box: Box, t: int
    ) -> NotFiniteError:
        c, z, y, x = (int(i) for i in np.argwhere(~finite)[0])
        voxel_zyx = [z + box.start_zyx[0], y + box.start_zyx[1], x]
        name = self._source.path.name
        where = f" of time step {t}, channel {c}" if self._source.nt * self._source.nc > 1 else ""
        return NotFiniteError(
            f"{name}: voxel (z, y, x) = {tuple(voxel_zyx)}{where} is {planes[c, z, y, x]}; S3Dc "
            "and the pyramid need finite values, so say what replaces NaN and ±Inf "
            "(--replace-nonfinite VALUE) or clean the data",
            source=name,
            voxel_zyx=voxel_zyx,
        )
