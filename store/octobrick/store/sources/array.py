"""Arrays of any axes in a library's hands (HDF5, Zarr), read as boxes of z, y, x."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from octobrick.codec.errors import OctobrickError, ResourceError
from octobrick.store.box import Box, Zyx
from octobrick.store.errors import SourceError, UnsupportedSourceError
from octobrick.store.sources.axes import Axes
from octobrick.store.sources.base import Description, Source
from octobrick.store.sources.head import printable
from octobrick.store.sources.location import Location

# What is turned to another order of axes at once, unless a single chunk is larger.
_PART_NBYTES = 1 << 22
# A chunk is decoded whole, whatever is asked of it.
_CHUNK_LIMIT_NBYTES = 1 << 30


class ArraySource(Source):
    """A source that is one array of a library; subclasses say how an index selects from it."""

    def __init__(self, path: Location, description: Description, axes: Axes) -> None:
        super().__init__(path, description)
        self._axes = axes

    @abstractmethod
    def _select(self, index: tuple[int | slice, ...]) -> npt.NDArray[Any]:
        """The elements that an index selects, in the order of the array."""

    def _read(self, box: Box, t: int, c: int) -> npt.NDArray[Any]:
        if self._axes.is_zyx:
            return self._contiguous(self._axes.to_zyx(self._selected(box, t, c)))
        with self._failing(box):
            out = np.empty(box.shape_zyx, self.dtype)
        for part in self._parts(box):
            at = part.shift((-box.start_zyx[0], 0, 0))
            out[at.start_zyx[0] : at.stop_zyx[0]] = self._axes.to_zyx(self._selected(part, t, c))
        return out

    def _read_channels(self, box: Box, t: int) -> npt.NDArray[Any]:
        return self._contiguous(self._axes.to_czyx(self._selected(box, t, None)))

    def _contiguous(self, part: npt.NDArray[Any]) -> npt.NDArray[Any]:
        return np.ascontiguousarray(part, dtype=self.dtype)

    def _selected(self, box: Box, t: int, c: int | None) -> npt.NDArray[Any]:
        with self._failing(box):
            return self._select(self._axes.index(box, t, c))

    def _parts(self, box: Box) -> Iterator[Box]:
        """The box in slices along z of a bounded size, no thinner than a chunk."""
        (z0, y0, x0), (z1, y1, x1) = box.start_zyx, box.stop_zyx
        plane_nbytes = (y1 - y0) * (x1 - x0) * self.dtype.itemsize
        step = self.chunk_zyx[0] if self.chunk_zyx else 1
        nz = max(step, _PART_NBYTES // plane_nbytes // step * step)
        for start in range(z0 // step * step, z1, nz):
            yield Box((max(z0, start), y0, x0), (min(z1, start + nz), y1, x1))

    def _failing(self, box: Box) -> _Failing:
        return _Failing(self.path, box)


class _Failing:
    """Turns whatever a library raises for a box into our errors; it says nothing of warnings."""

    def __init__(self, path: Location, box: Box) -> None:
        self._path, self._box = path, box

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: object, error: BaseException | None, traceback: object) -> None:
        if not isinstance(error, Exception) or isinstance(error, OctobrickError):
            return
        where = f"box {self._box.start_zyx} to {self._box.stop_zyx} (z, y, x)"
        if isinstance(error, MemoryError):
            raise ResourceError(
                f"{self._path}: there is no memory for {where}; read a smaller box",
                path=str(self._path),
            ) from error
        reason = printable(str(error) or type(error).__name__)
        raise SourceError(
            f"{self._path}: {where} cannot be read: {reason}; copy or export the data again",
            path=str(self._path),
            reason=reason,
        ) from error


def require_chunk(
    chunk: tuple[int, ...] | None, dtype: np.dtype[Any], axes: Axes, path: Location
) -> Zyx | None:
    """The chunk of an array as (z, y, x), no larger than the volume; None where there is none.

    Raises:
        UnsupportedSourceError: a chunk that takes more memory than any sensible one.
    """
    if chunk is None:
        return None
    nbytes = dtype.itemsize
    for size in chunk:
        nbytes *= int(size)
    if nbytes > _CHUNK_LIMIT_NBYTES:
        raise UnsupportedSourceError(
            f"{path}: its chunks of {list(chunk)} elements take {nbytes} bytes each; "
            f"{_CHUNK_LIMIT_NBYTES} is the most that is read; save the array in smaller chunks",
            path=str(path),
            chunk_nbytes=nbytes,
        )
    z, y, x = axes.of_zyx(chunk, 1)
    nz, ny, nx = axes.shape_zyx
    return (min(int(z), nz), min(int(y), ny), min(int(x), nx))
