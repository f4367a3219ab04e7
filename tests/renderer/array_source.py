"""An in-memory volume: the smallest thing that fits BrickSource, made from a NumPy array."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import S3dc, Zerobit
from octobrick.codec.reduce import mean2
from octobrick.renderer.brick_source import Xyz
from octobrick.store.box import Box, Zyx, cell_box, grid_of

Voxels = NDArray[Any]


@dataclass(frozen=True)
class ArrayLevel:
    shape_zyx: Zyx
    grid_zyx: Zyx
    spacing_xyz: Xyz
    origin_xyz: Xyz


class ArraySource:
    """Bricks cut from an array on demand, encoded with S3Dc or left raw."""

    nt = nc = 1

    def __init__(
        self,
        array: Voxels,
        *,
        codec: S3dc | Zerobit | None = None,
        brick: int | Zyx = 32,
        spacing_xyz: Xyz = (1.0, 1.0, 1.0),
        nlevels: int | None = None,
        window: tuple[float, float] | None = None,
        fill_value: float = 0,
    ) -> None:
        self.codec = codec
        self.brick_shape_zyx: Zyx = (brick,) * 3 if isinstance(brick, int) else brick
        self.arrays = [np.ascontiguousarray(array)]
        while max(self.arrays[-1].shape) > max(self.brick_shape_zyx) and (
            nlevels is None or len(self.arrays) < nlevels
        ):
            self.arrays.append(mean2(self.arrays[-1]))
        self.dtype = np.dtype(array.dtype)
        self.levels = [self._level(i, a, spacing_xyz) for i, a in enumerate(self.arrays)]
        self.value_range = (float(array.min()), float(array.max()))
        self.window = window or self._default_window()
        self.fill_value = fill_value
        digest = hashlib.blake2b(self.arrays[0].tobytes(), digest_size=8)
        what = f"{array.shape} {self.dtype} {codec} {self.brick_shape_zyx} {fill_value}"
        self.revision = f"{digest.hexdigest()} {what}"
        self.reads = 0
        # Kept, so that a picture's time is the renderer's.
        self.decoded = cache(self._decode_level)
        self._code = cache(self._encode)
        self._ranges = cache(self._ranges_of_level)
        self._errors = cache(self._errors_of_level)

    def _default_window(self) -> tuple[float, float]:
        small = next((a for a in self.arrays if max(a.shape) <= 128), self.arrays[-1])
        low, high = self.value_range
        high = min(high, float(np.percentile(small, 99.9)))
        return (low, high) if high > low else self.value_range

    def _level(self, index: int, array: Voxels, spacing_xyz: Xyz) -> ArrayLevel:
        factor = 2.0**index
        x, y, z = spacing_xyz
        half = (factor - 1) / 2
        nz, ny, nx = array.shape
        return ArrayLevel(
            (nz, ny, nx),
            grid_of((nz, ny, nx), self.brick_shape_zyx),
            (x * factor, y * factor, z * factor),
            (x * half, y * half, z * half),
        )

    def brick(self, level: int, zyx: Zyx) -> Voxels:
        """The original voxels of a brick, edge-padded to the full shape."""
        array = self.arrays[level]
        nz, ny, nx = array.shape
        box = cell_box(zyx, self.brick_shape_zyx)
        voxels = array[box.intersect(Box.of_shape((nz, ny, nx))).slices]
        pad = [(0, b - n) for b, n in zip(self.brick_shape_zyx, voxels.shape, strict=True)]
        return np.ascontiguousarray(np.pad(voxels, pad, mode="edge"))

    def level_codec(self, level: int) -> S3dc | Zerobit | None:
        return self.codec

    def brick_code(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> bytes | None:
        self.reads += 1
        return self._code(level, zyx)

    def _encode(self, level: int, zyx: Zyx) -> bytes | None:
        voxels = self.brick(level, zyx)
        if (voxels == self.fill_value).all():
            return None
        return voxels.tobytes() if self.codec is None else self.codec.encode(voxels)

    def _decode_level(self, level: int) -> Voxels:
        """The level as its bricks decode."""
        out = np.empty_like(self.arrays[level])
        nz, ny, nx = out.shape
        for zyx in np.ndindex(*self.levels[level].grid_zyx):
            z, y, x = zyx
            voxels = self.brick(level, (z, y, x))
            if self.codec is not None and (code := self._code(level, (z, y, x))) is not None:
                voxels = self.codec.decode(code, self.brick_shape_zyx, self.dtype)
            box = cell_box((z, y, x), self.brick_shape_zyx).intersect(Box.of_shape((nz, ny, nx)))
            out[box.slices] = voxels[tuple(slice(0, n) for n in box.shape_zyx)]
        return out

    def ranges(self, level: int, t: int = 0, c: int = 0) -> Voxels:
        return self._ranges(level)

    def _ranges_of_level(self, level: int) -> Voxels:
        array, grid = self.arrays[level], self.levels[level].grid_zyx
        nz, ny, nx = array.shape
        out = np.empty((*grid, 2), self.dtype)
        for zyx in np.ndindex(*grid):
            z, y, x = zyx
            around = cell_box((z, y, x), self.brick_shape_zyx).grow(1)
            part = array[around.intersect(Box.of_shape((nz, ny, nx))).slices]
            out[zyx] = part.min(), part.max()
        return out

    def fidelity(self, level: int, t: int = 0, c: int = 0) -> NDArray[np.float32]:
        return self._errors(level)

    def _errors_of_level(self, level: int) -> NDArray[np.float32]:
        grid = self.levels[level].grid_zyx
        out = np.zeros((*grid, 2), np.float32)
        if self.codec is None:
            return out
        error = self.decoded(level).astype(np.float64) - self.arrays[level].astype(np.float64)
        for zyx in np.ndindex(*grid):
            z, y, x = zyx
            part = error[cell_box((z, y, x), self.brick_shape_zyx).slices]
            largest = np.abs(part).max()
            rounded = np.float32(largest)
            if rounded < largest:  # a bound is never below the truth
                rounded = np.nextafter(rounded, np.float32(np.inf))
            out[zyx] = rounded, np.sqrt((part**2).mean())
        return out


class Channels:
    """Several volumes of one shape as the channels of one."""

    def __init__(self, channels: Sequence[ArraySource]) -> None:
        self._channels = list(channels)
        self.nc = len(self._channels)
        self.revision = " / ".join(channel.revision for channel in self._channels)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._channels[0], name)

    def brick_code(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> bytes | None:
        return self._channels[c].brick_code(level, zyx)

    def ranges(self, level: int, t: int = 0, c: int = 0) -> Voxels:
        return self._channels[c].ranges(level)

    def fidelity(self, level: int, t: int = 0, c: int = 0) -> NDArray[np.float32]:
        return self._channels[c].fidelity(level)


class SlowFirstLevel(ArraySource):
    """Bricks of level 0 come when they are released."""

    def __init__(self, array: Voxels, **options: Any) -> None:
        super().__init__(array, **options)
        self.release = threading.Event()
        self.ncoarse_reads = 0

    def brick_code(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> bytes | None:
        if level == 0:
            assert self.release.wait(30)
        else:
            self.ncoarse_reads += 1
        return super().brick_code(level, zyx, t, c)


class Times:
    """Several volumes of one shape as the time steps of one."""

    def __init__(self, steps: Sequence[ArraySource]) -> None:
        self._steps = list(steps)
        self.nt = len(self._steps)
        self.revision = " > ".join(step.revision for step in self._steps)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._steps[0], name)

    def brick_code(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> bytes | None:
        return self._steps[t].brick_code(level, zyx)

    def ranges(self, level: int, t: int = 0, c: int = 0) -> Voxels:
        return self._steps[t].ranges(level)

    def fidelity(self, level: int, t: int = 0, c: int = 0) -> NDArray[np.float32]:
        return self._steps[t].fidelity(level)
