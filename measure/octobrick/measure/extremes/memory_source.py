"""A volume of one level in memory, as the renderer takes volumes."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import S3dc
from octobrick.renderer.brick_source import Xyz
from octobrick.store.box import Box, Zyx, cell_box, grid_of

BRICK: Zyx = (16, 16, 16)


@dataclass(frozen=True, slots=True)
class OneLevel:
    """A level's place in the world."""

    shape_zyx: Zyx
    grid_zyx: Zyx
    spacing_xyz: Xyz
    origin_xyz: Xyz = (0.0, 0.0, 0.0)


class MemorySource:
    """Bricks cut from an array (z, y, x), coded with S3Dc or raw. No brick is absent."""

    nt = nc = 1
    brick_shape_zyx = BRICK

    def __init__(
        self, array: NDArray[Any], codec: S3dc | None = None, spacing_xyz: Xyz = (1.0, 1.0, 1.0)
    ) -> None:
        nz, ny, nx = array.shape
        self._array, self._codec = array, codec
        self.levels = (OneLevel((nz, ny, nx), grid_of((nz, ny, nx), BRICK), spacing_xyz),)
        self.dtype = array.dtype
        self.value_range = self.window = (float(array.min()), float(array.max()))
        self.fill_value = 0.0
        content = hashlib.blake2b(array.tobytes(), digest_size=8).hexdigest()
        self.revision = f"{content} {array.shape} {array.dtype} {codec}"

    def level_codec(self, level: int) -> S3dc | None:  # noqa: ARG002
        """The codec of all bricks; None for raw voxels."""
        return self._codec

    def brick_code(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> bytes:  # noqa: ARG002
        """A brick's code or raw voxels, padded by its last voxels."""
        part = self._array[self._box(zyx).slices]
        pad = [(0, b - n) for b, n in zip(BRICK, part.shape, strict=True)]
        voxels = np.ascontiguousarray(np.pad(part, pad, mode="edge"))
        return voxels.tobytes() if self._codec is None else self._codec.encode(voxels)

    def ranges(self, level: int, t: int = 0, c: int = 0) -> NDArray[Any]:  # noqa: ARG002
        """Of each brick, the range of all voxels: dropping bricks is not what is searched."""
        low_high = np.array([self._array.min(), self._array.max()], self.dtype)
        return np.broadcast_to(low_high, (*self.levels[0].grid_zyx, 2)).copy()

    def fidelity(self, level: int, t: int = 0, c: int = 0) -> NDArray[np.float32]:  # noqa: ARG002
        """Errors are not what is searched."""
        return np.zeros((*self.levels[0].grid_zyx, 2), np.float32)

    def _box(self, zyx: Zyx) -> Box:
        return cell_box(zyx, BRICK).intersect(Box.of_shape(self.levels[0].shape_zyx))
