"""From voxels to what is stored of one brick: frame, range and fidelity."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import metrics
from octobrick.store import brick_codec
from octobrick.store import frame as zstd_frame
from octobrick.store.box import Zyx

Voxels = NDArray[np.generic]
DirectionCodes = NDArray[np.uint8]

NO_DIRECTION = 128
"""The code of the zero vector, in each of its three bytes."""


@dataclass(frozen=True, slots=True)
class EncodedBrick:
    """One brick ready to store.

    ``frame`` is None where every voxel is the fill value. ``low`` and ``high`` bound the brick's
    voxels and those one voxel around it. ``errors`` compares decoded with original over the
    voxels that the volume has, without padding.
    """

    frame: bytes | None
    low: Any = 0.0
    high: Any = 0.0
    errors: metrics.ErrorStats = field(default_factory=metrics.ErrorStats)


@dataclass(frozen=True, slots=True)
class BrickEncoder:
    """Encodes bricks of one level. Immutable, so many threads can share one.

    Args:
        codec: of the bricks, or None to store voxels as they are.
        brick: voxels per axis.
        zstd_level: of the entropy layer.
    """

    codec: brick_codec.BrickCodec
    brick: int
    zstd_level: int

    def encode(self, voxels: Voxels, low: Any, high: Any) -> EncodedBrick:
        """Encode one brick.

        Args:
            voxels: of the brick, as many as the level has.
            low: the least of them and those one voxel around them.
            high: the greatest.
        """
        count = voxels.size
        if low <= 0 <= high and is_fill(voxels):
            return EncodedBrick(None, low, high, metrics.ErrorStats(count, 0.0, 0.0))
        padded = pad_to(voxels, (self.brick,) * 3)
        code = brick_codec.encode(self.codec, padded)
        if self.codec is None:
            errors = metrics.ErrorStats(count, 0.0, 0.0)
        else:
            decoded = brick_codec.decode(self.codec, code, padded.shape, padded.dtype)
            nz, ny, nx = voxels.shape
            errors = metrics.compare(voxels, decoded[:nz, :ny, :nx])
        return EncodedBrick(zstd_frame.compress(code, self.zstd_level), low, high, errors)


@dataclass(frozen=True, slots=True)
class DirectionEncoder:
    """Stores bricks of gradient directions, coded in three bytes each.

    Args:
        brick: voxels per axis.
        zstd_level: of the entropy layer.
    """

    brick: int
    zstd_level: int

    def encode(self, codes: DirectionCodes) -> EncodedBrick:
        """Encode one brick of codes (z, y, x, 3); absent where no voxel has a direction."""
        if (codes == NO_DIRECTION).all():
            return EncodedBrick(None)
        padded = pad_to(codes, (self.brick,) * 3)
        return EncodedBrick(zstd_frame.compress(padded.tobytes(), self.zstd_level))


def is_fill(voxels: Voxels) -> bool:
    """Whether every voxel is the fill value, so that the brick is absent."""
    # Bitwise: -0.0 is not the fill value.
    return not voxels.view(f"u{voxels.itemsize}").any()


def pad_to(voxels: Voxels, shape_zyx: Zyx) -> Voxels:
    """The voxels, grown to a shape by repeating the last ones, which widens no block's range.

    Axes behind the third stay as they are.
    """
    if voxels.shape[:3] == shape_zyx:
        return voxels
    widths = [(0, n - have) for n, have in zip(shape_zyx, voxels.shape, strict=False)]
    return np.pad(voxels, [*widths, *[(0, 0)] * (voxels.ndim - 3)], mode="edge")
