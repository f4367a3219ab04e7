"""Flat voxels: one sample after another, from which a box is read run by run.

Where a sample lies is told by one stride for each axis, whatever the order of the axes:

    sample (t, c, z, y, x) is number t·st + c·sc + z·sz + y·sy + x·sx of the file

Samples of a box that touch are read as one (a box of whole planes is a single run). Others are
read with what lies between them into a small stage and picked there, unless so much of that is
unwanted that many small reads are faster.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import as_strided

from octobrick.codec.errors import ResourceError
from octobrick.store.box import Box
from octobrick.store.sources.axes import Strides
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
        stream_offset_nbytes: where compressed data begin in the file.
        strides: distances of neighbours; None where x varies fastest, then y, z, c and t.
        deflate_crc32: where compressed data are plain deflate, as in zip archives, which have no
            checksum behind them: the checksum that they shall have.
    """

    path: Path
    offset_nbytes: int
    dtype: np.dtype[Any]
    stream_offset_nbytes: int = 0
    strides: Strides | None = None
    deflate_crc32: int | None = None

    def in_stream(self, start_nbytes: int, *, deflate_crc32: int | None = None) -> Layout:
        """The same voxels inside compressed data that begin at a byte of the file."""
        return replace(self, stream_offset_nbytes=start_nbytes, deflate_crc32=deflate_crc32)

    def strides_of(self, description: Description) -> Strides:
        """The strides, also where the layout leaves them to the shape."""
        if self.strides is not None:
            return self.strides
        nz, ny, nx = description.shape_zyx
        nvoxels = nz * ny * nx
        return Strides(description.nc * nvoxels, nvoxels, ny * nx, nx, 1)

    def nbytes_of(self, description: Description) -> int:
        """Bytes from the first sample up to the last, of all time steps and channels."""
        sizes = (description.nt, description.nc, *description.shape_zyx)
        return _extent(_axes_of(sizes, self.strides_of(description))) * self.dtype.itemsize


class _Axis(NamedTuple):
    """One axis of what is read: how many samples, and how far they are from each other."""

    size: int
    stride: int


class FlatSource(Source):
    """A source whose voxels are flat; subclasses say how bytes are got from the file."""

    #: Whether skipping bytes saves nothing, because they have to be decoded anyway.
    _skips_cost = False
    path: Path

    def __init__(self, path: Path, description: Description, layout: Layout) -> None:
        super().__init__(path, description)
        self._layout = layout
        self._strides = layout.strides_of(description)

    @property
    def files(self) -> tuple[Path, ...]:
        """The header, and the file of the voxels where it is another."""
        voxels = self._layout.path
        return (self.path,) if voxels == self.path else (self.path, voxels)

    @abstractmethod
    def _read_at(self, position: int, into: memoryview) -> None:
        """Fill ``into`` with bytes from ``position`` of the (decompressed) file."""

    def _read(self, box: Box, t: int, c: int) -> npt.NDArray[Any]:
        voxels: npt.NDArray[Any] = self._read_samples(box, t, c, 1)[0]
        return voxels

    def _read_channels(self, box: Box, t: int) -> npt.NDArray[Any]:
        return self._read_samples(box, t, 0, self.nc)

    def _read_samples(self, box: Box, t: int, c: int, nc: int) -> npt.NDArray[Any]:
        """A box of ``nc`` channels from channel ``c`` on, (c, z, y, x)."""
        out = _empty((nc, *box.shape_zyx), self.dtype, self.path)
        start = (t, c, *box.start_zyx)
        first = sum(at * stride for at, stride in zip(start, self._strides, strict=True))
        axes = _axes_of(out.shape, self._strides[1:])
        order = sorted(range(4), key=lambda axis: axes[axis].stride, reverse=True)
        order = [axis for axis in order if axes[axis].size > 1] or [3]  # [3]: a single sample
        rest = tuple(slice(None) if axis in order else 0 for axis in range(4))
        kept = sorted(order)
        picked = out[rest].transpose([kept.index(axis) for axis in order])
        self._gather(first, [axes[axis] for axis in order], picked)
        if not self._layout.dtype.isnative:
            out.byteswap(inplace=True)
        if out.dtype == np.bool_:  # any other byte than 0 and 1 would upset numpy
            np.not_equal(out.view(np.uint8), 0, out=out)
        return out

    def _gather(self, first: int, axes: Sequence[_Axis], out: npt.NDArray[Any]) -> None:
        """Fill ``out``, whose axes are those of the file, slowest first, from sample ``first``."""
        itemsize = self.dtype.itemsize
        if _extent(axes) == out.size and out.flags.c_contiguous:
            self._read_at(self._position(first), _bytes_of(out))
            return
        (size, stride), inner = axes[0], axes[1:]
        nsteps = 1 + (_STAGE_NBYTES // itemsize - _extent(inner)) // max(1, stride)
        nsteps = min(size, nsteps)
        if inner and (nsteps < 1 or not self._stage_pays([_Axis(nsteps, stride), *inner])):
            for step in range(size):
                self._gather(first + step * stride, inner, out[step])
            return
        if not inner and not self._stage_pays([_Axis(nsteps, stride)]):
            nsteps = 1  # samples so far apart that each is read alone
        for step in range(0, size, max(1, nsteps)):
            part = out[step : step + max(1, nsteps)]
            self._pick(first + step * stride, [_Axis(len(part), stride), *inner], part)

    def _pick(self, first: int, axes: Sequence[_Axis], out: npt.NDArray[Any]) -> None:
        """Fill ``out`` from a stage that holds its samples and all that lies between them."""
        stage = np.empty(_extent(axes), self.dtype)
        self._read_at(self._position(first), _bytes_of(stage))
        strides = [axis.stride * stage.itemsize for axis in axes]
        out[...] = as_strided(stage, out.shape, strides, writeable=False)

    def _stage_pays(self, axes: Sequence[_Axis]) -> bool:
        """Whether reading all that lies between samples costs less than reading around it."""
        if self._skips_cost:
            return True
        run, nreads, nsamples = 1, 1, 1
        for size, stride in reversed(axes):
            if stride == run:
                run *= size
            else:
                nreads *= size
            nsamples *= size
        unwanted_nbytes = (_extent(axes) - nsamples) * self.dtype.itemsize
        return unwanted_nbytes <= _READ_COST_NBYTES * nreads

    def _position(self, sample: int) -> int:
        return self._layout.offset_nbytes + sample * self.dtype.itemsize


def _axes_of(sizes: Sequence[int], strides: Sequence[int]) -> list[_Axis]:
    return [_Axis(*axis) for axis in zip(sizes, strides, strict=True)]


def _extent(axes: Sequence[_Axis]) -> int:
    """How many samples there are from the first to the last, both included."""
    return 1 + sum((size - 1) * stride for size, stride in axes)


def _empty(shape: tuple[int, ...], dtype: np.dtype[Any], path: Path) -> npt.NDArray[Any]:
    try:
        return np.empty(shape, dtype)
    except (MemoryError, ValueError) as error:
        nbytes = Box.of_shape((shape[-3], shape[-2], shape[-1])).nvoxels * dtype.itemsize
        raise ResourceError(
            f"{path}: a box of {shape[-3:]} voxels (z, y, x) takes {nbytes} bytes of memory, "
            "which cannot be had; read a smaller box",
            path=str(path),
            nbytes=nbytes,
        ) from error


def _bytes_of(array: npt.NDArray[Any]) -> memoryview:
    """The memory of a C-contiguous array."""
    return array.data.cast("B")
