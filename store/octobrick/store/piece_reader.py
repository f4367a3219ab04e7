"""The source's planes from one on, in pieces of a bounded size, one piece read ahead of its use."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import NotFiniteError
from octobrick.store.box import Box
from octobrick.store.sources import Source

Voxels = NDArray[np.generic]

# Large enough that a disk streams, small enough that what is read ahead does not count beside the
# slab that is being encoded.
READ_NBYTES = 16 * 2**20


class PieceReader:
    """Reads whole planes of all channels in order.

    Args:
        source: what is read.
        replace_nonfinite: what stands for NaN and ±Inf; None refuses them.
    """

    def __init__(self, source: Source, replace_nonfinite: float | None) -> None:
        self._source = source
        self._replacement = replace_nonfinite
        _, ny, nx = source.shape_zyx
        plane_nbytes = ny * nx * source.dtype.itemsize * source.nc
        step = max(1, READ_NBYTES // plane_nbytes)
        if source.chunk_zyx is not None:  # half a chunk costs as much as all of it
            step = max(step // source.chunk_zyx[0], 1) * source.chunk_zyx[0]
        self._step = step

    def pieces(self, t: int, first_z: int) -> Iterator[Voxels]:
        """The planes (c, z, y, x) of a time step from ``first_z`` on.

        Raises:
            NotFiniteError: with the voxel's position.
            SourceError: the source is damaged.
        """
        nz, ny, nx = self._source.shape_zyx
        starts = [first_z, *range((first_z // self._step + 1) * self._step, nz, self._step)]
        stops = [*starts[1:], nz]
        boxes = [Box((a, 0, 0), (b, ny, nx)) for a, b in zip(starts, stops, strict=True) if a < b]
        if not boxes:
            return
        with ThreadPoolExecutor(1, thread_name_prefix="octobrick-read") as reader:
            ahead = reader.submit(self._read, boxes[0], t)
            try:
                for following in [*boxes[1:], None]:
                    planes = ahead.result()
                    if following is not None:
                        ahead = reader.submit(self._read, following, t)
                    yield planes
            except BaseException:  # nobody waits for what is read ahead, and a server may be silent
                self._source.abandon()
                raise

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
        voxel_zyx = [z + box.start_zyx[0], y, x]
        name = self._source.path.name
        where = f" of time step {t}, channel {c}" if self._source.nt * self._source.nc > 1 else ""
        return NotFiniteError(
            f"{name}: voxel (z, y, x) = {tuple(voxel_zyx)}{where} is {planes[c, z, y, x]}; S3Dc "
            "and the pyramid need finite values, so say what replaces NaN and ±Inf "
            "(--replace-nonfinite VALUE) or clean the data",
            source=name,
            voxel_zyx=voxel_zyx,
        )
