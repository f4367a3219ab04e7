"""Planes that are decoded tile by tile, from which boxes are put together.

A tile is a piece of one plane (z, t) with all samples that are interleaved in it: a tile or strip
of a TIFF page, a whole PNG file, a DICOM frame. What was decoded last is kept, so that boxes that
share tiles do not decode them again.
"""

from __future__ import annotations

import threading
from abc import abstractmethod
from collections import OrderedDict
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from octobrick.codec.errors import ResourceError
from octobrick.store.box import Box, ceil_div
from octobrick.store.errors import SourceError
from octobrick.store.sources.base import Description, Source

# Enough for the planes of a slab of a common size; small beside an ingest's own memory.
_CACHE_NBYTES = 1 << 26


class Tile(NamedTuple):
    """Where a tile lies: time step, group of interleaved channels, plane, row and column of it."""

    t: int
    group: int
    z: int
    iy: int
    ix: int


class PlaneSource(Source):
    """A source of planes that are cut into tiles of equal size, from the first row and column on.

    Args:
        path: the file, folder or pattern.
        description: with ``chunk_zyx`` one plane high: the size of a tile.
        nsamples: how many channels are interleaved in one tile.
    """

    path: Path

    def __init__(self, path: Path, description: Description, nsamples: int = 1) -> None:
        super().__init__(path, description)
        _, ny, nx = description.shape_zyx
        self._tile_yx = description.chunk_zyx[1:] if description.chunk_zyx else (ny, nx)
        self._nsamples = nsamples
        self._cache: OrderedDict[Tile, npt.NDArray[Any]] = OrderedDict()
        self._cached_nbytes = 0
        self._lock = threading.Lock()

    @abstractmethod
    def _decode(self, tile: Tile) -> npt.NDArray[Any]:
        """The samples of a tile, (y, x, samples); more rows and columns than the plane may come."""

    def _read(self, box: Box, t: int, c: int) -> npt.NDArray[Any]:
        group, sample = divmod(c, self._nsamples)
        out = _empty(box.shape_zyx, self.dtype, self.path)
        for tile, inside, outside in self._tiles(box, t, group):
            out[outside] = self._tile(tile)[inside][..., sample]
        return out

    def _read_channels(self, box: Box, t: int) -> npt.NDArray[Any]:
        out = _empty((self.nc, *box.shape_zyx), self.dtype, self.path)
        for group in range(self.nc // self._nsamples):
            first = group * self._nsamples
            channels = out[first : first + self._nsamples]
            for tile, inside, outside in self._tiles(box, t, group):
                channels[(slice(None), *outside)] = np.moveaxis(self._tile(tile)[inside], -1, 0)
        return out

    def _tiles(
        self, box: Box, t: int, group: int
    ) -> Iterator[tuple[Tile, tuple[slice, slice], tuple[int, slice, slice]]]:
        """Every tile that a box touches, the part of it, and where that lies in the box."""
        (z0, y0, x0), (z1, y1, x1) = box.start_zyx, box.stop_zyx
        tile_ny, tile_nx = self._tile_yx
        for z in range(z0, z1):
            for iy in range(y0 // tile_ny, ceil_div(y1, tile_ny)):
                inside_y, outside_y = _overlap(iy * tile_ny, tile_ny, y0, y1)
                for ix in range(x0 // tile_nx, ceil_div(x1, tile_nx)):
                    inside_x, outside_x = _overlap(ix * tile_nx, tile_nx, x0, x1)
                    yield (
                        Tile(t, group, z, iy, ix),
                        (inside_y, inside_x),
                        (z - z0, outside_y, outside_x),
                    )

    def _tile(self, tile: Tile) -> npt.NDArray[Any]:
        """A tile, decoded or kept; two threads that want the same may both decode it."""
        with self._lock:
            kept = self._cache.get(tile)
            if kept is not None:
                self._cache.move_to_end(tile)
                return kept
        samples = self._checked(self._decode(tile), tile)
        with self._lock:
            if tile not in self._cache:
                self._cache[tile] = samples
                self._cached_nbytes += samples.nbytes
            while self._cached_nbytes > _CACHE_NBYTES and len(self._cache) > 1:
                self._cached_nbytes -= self._cache.popitem(last=False)[1].nbytes
        return samples

    def _checked(self, samples: npt.NDArray[Any], tile: Tile) -> npt.NDArray[Any]:
        """What a decoder gave, if it is what the description promises."""
        _, ny, nx = self.shape_zyx
        tile_ny, tile_nx = self._tile_yx
        want_y = min(tile_ny, ny - tile.iy * tile_ny)
        want_x = min(tile_nx, nx - tile.ix * tile_nx)
        fits = (
            samples.ndim == 3
            and samples.shape[0] >= want_y
            and samples.shape[1] >= want_x
            and samples.shape[2] == self._nsamples
            and samples.dtype == self.dtype
        )
        if not fits:
            raise SourceError(
                f"{self.path}: plane {tile.z} decodes to {samples.shape} samples of "
                f"{samples.dtype} (y, x, samples), but ({want_y}, {want_x}, {self._nsamples}) of "
                f"{self.dtype} are described; copy or export the file again",
                path=str(self.path),
                z=tile.z,
                t=tile.t,
            )
        return samples

    def _close(self) -> None:
        self._cache.clear()


def _overlap(start: int, size: int, low: int, high: int) -> tuple[slice, slice]:
    """The part of ``[start, start + size)`` in ``[low, high)``: in a tile, and in a box."""
    first, last = max(start, low), min(start + size, high)
    return slice(first - start, last - start), slice(first - low, last - low)


def _empty(shape: tuple[int, ...], dtype: np.dtype[Any], path: Path) -> npt.NDArray[Any]:
    try:
        return np.empty(shape, dtype)
    except MemoryError as error:
        raise ResourceError(
            f"{path}: a box of {shape} voxels of {dtype} takes more memory than can be had; "
            "read a smaller box",
            path=str(path),
        ) from error
