"""What is exported: a box of one level, where it lies in the world, and its voxels as a stream."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import InvalidInputError
from octobrick.store.box import Box, Zyx
from octobrick.store.level import Xyz
from octobrick.store.progress import ProgressMeter
from octobrick.store.volume import Volume

Voxels = NDArray[Any]
Matrix = NDArray[np.float64]

# A layer of bricks is decoded once if it fits; of wider volumes thinner slabs are, several times.
_SLAB_NBYTES = 512 * 2**20


class Region:
    """A box of voxels of one level, time step and channel.

    Args:
        volume: open, and left open.
        level: which level.
        box: in voxels of that level; by default all of it.
        t: time step.
        c: channel.
        workers: threads that decode; by default one per processor.
        meter: takes note of the voxels that were handed out.

    Raises:
        InvalidInputError: no such level, time step or channel, or a box that leaves the level.
    """

    def __init__(
        self,
        volume: Volume,
        level: int,
        box: Box | None,
        t: int,
        c: int,
        *,
        workers: int | None = None,
        meter: ProgressMeter | None = None,
    ) -> None:
        self.volume = volume
        self.level = volume.level(level)
        self.box = box or Box.of_shape(self.level.shape_zyx)
        self.box.require_within(self.level.shape_zyx, f"exporting {volume.name} level {level}")
        if not (0 <= t < volume.nt and 0 <= c < volume.nc):
            raise InvalidInputError(
                f"{volume.name}: no time step {t} with channel {c}; there are {volume.nt} time "
                f"steps and {volume.nc} channels, counted from 0",
                t=t,
                c=c,
            )
        self.t = t
        self.c = c
        self.meter = meter
        self._workers = workers or len(os.sched_getaffinity(0))
        self._source = volume.metadata().get("source") or {}

    @property
    def dtype(self) -> np.dtype[Any]:
        """Sample type."""
        return self.volume.dtype

    @property
    def shape_zyx(self) -> Zyx:
        """Voxels along each axis."""
        return self.box.shape_zyx

    @property
    def nbytes(self) -> int:
        """Bytes of all voxels, uncompressed."""
        return self.box.nvoxels * self.dtype.itemsize

    @property
    def unit(self) -> str | None:
        """World unit by its UDUNITS name, or None."""
        return self.volume.unit

    @property
    def spacing_xyz(self) -> Xyz:
        """World size of a voxel."""
        return self.level.spacing_xyz

    @cached_property
    def direction(self) -> Matrix | None:
        """3×3, column i the unit vector of voxel axis i of (x, y, z) in LPS world; or None."""
        matrix = _numbers(self._source.get("direction"), (3, 3))
        # Metadata come from a file: a matrix that spans no space is none.
        return matrix if matrix is not None and abs(np.linalg.det(matrix)) > 1e-6 else None

    @property
    def offset_xyz(self) -> Xyz:
        """The first voxel's centre, along the voxel axes, from that of the source's first voxel."""
        steps = reversed(self.box.start_zyx)
        x, y, z = (
            o + n * s
            for o, n, s in zip(self.level.origin_xyz, steps, self.spacing_xyz, strict=True)
        )
        return (x, y, z)

    @property
    def origin_xyz(self) -> Xyz:
        """World position of the centre of the first voxel."""
        source_xyz = _numbers(self._source.get("origin_xyz"), (3,))
        turned = self._axes @ np.array(self.offset_xyz)
        return _xyz(turned if source_xyz is None else turned + source_xyz)

    @property
    def aligned_origin_xyz(self) -> Xyz:
        """`origin_xyz` measured along the voxel axes, for formats without directions."""
        return _xyz(np.linalg.solve(self._axes, np.array(self.origin_xyz)))

    @property
    def rescale(self) -> tuple[float, float] | None:
        """Slope and intercept from samples to the values they stand for, or None."""
        given = self._source.get("rescale")
        if not isinstance(given, dict):
            return None
        pair = _numbers([given.get("slope"), given.get("intercept")], (2,))
        return None if pair is None or pair[0] == 0 else (float(pair[0]), float(pair[1]))

    def coarser(self) -> Region | None:
        """The same region one level on, with the voxels that it touches; None at the last level."""
        index = self.level.index + 1
        if index == len(self.volume.levels):
            return None
        (z0, y0, x0), (z1, y1, x1) = self.box.start_zyx, self.box.stop_zyx
        start = (z0 // 2, y0 // 2, x0 // 2)
        stop = ((z1 + 1) // 2, (y1 + 1) // 2, (x1 + 1) // 2)
        return Region(
            self.volume,
            index,
            Box(start, stop),
            self.t,
            self.c,
            workers=self._workers,
            meter=self.meter,
        )

    def read(self, box: Box) -> Voxels:
        """The voxels of a box whose corner (0, 0, 0) is the region's."""
        return self.volume.read(self.level.index, box.shift(self.box.start_zyx), self.t, self.c)

    def slabs(self) -> Iterator[Voxels]:
        """All voxels, some planes at a time, in memory for one layer of bricks (at most 512 MiB).

        Raises:
            CorruptBrickError: naming the file and the brick.
        """
        nz, ny, nx = self.shape_zyx
        brick_z, brick_y, _ = self.volume.brick_shape_zyx
        start_z, start_y, _ = self.box.start_zyx
        rows = _edges(start_y, ny, brick_y)
        fits = max(1, _SLAB_NBYTES // (ny * nx * self.dtype.itemsize))
        with ThreadPoolExecutor(self._workers, thread_name_prefix="octobrick-export") as executor:
            for z0, z1 in _edges(start_z, nz, min(brick_z, fits)):
                slab: Voxels = np.empty((z1 - z0, ny, nx), self.dtype)

                def fill(row: tuple[int, int], slab: Voxels = slab, z: Any = (z0, z1)) -> None:
                    box = Box((z[0], row[0], 0), (z[1], row[1], nx))
                    slab[:, row[0] : row[1]] = self.read(box)

                list(executor.map(fill, rows))
                yield slab
                self.advance(slab.size)

    def advance(self, nvoxels: int) -> None:
        """Take note that so many voxels have been written."""
        if self.meter is not None:
            self.meter.advance(nvoxels, "export")

    @property
    def _axes(self) -> Matrix:
        return np.eye(3) if self.direction is None else self.direction


def _edges(start: int, n: int, step: int) -> list[tuple[int, int]]:
    """The pieces of n voxels from ``start`` that whole cells of ``step`` voxels cut, from 0."""
    cuts = [0, *range(step - start % step, n, step), n]
    return list(itertools.pairwise(cuts))


def _numbers(value: Any, shape: tuple[int, ...]) -> Matrix | None:
    """Finite numbers of this shape out of JSON, or None."""
    try:
        numbers = np.array(value, np.float64)
    except (TypeError, ValueError):
        return None
    return numbers if numbers.shape == shape and np.isfinite(numbers).all() else None


def _xyz(vector: Matrix) -> Xyz:
    x, y, z = (float(v) + 0.0 for v in vector)  # no -0.0
    assert all(map(math.isfinite, (x, y, z)))
    return (x, y, z)
