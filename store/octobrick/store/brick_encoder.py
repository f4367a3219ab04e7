"""From voxels to what is stored of one brick: frame, range and fidelity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import metrics
from octobrick.store import brick_codec
from octobrick.store import frame as zstd_frame
from octobrick.store.box import Box, Zyx

Voxels = NDArray[np.generic]


@dataclass(frozen=True, slots=True)
class EncodedBrick:
    """One brick ready to store.

    ``frame`` is None where every voxel is the fill value. ``low`` and ``high`` bound the brick's
    voxels and those one voxel around it. ``errors`` compares decoded with original over the
    voxels that the volume has, without padding.
    """

    frame: bytes | None
    low: float
    high: float
    errors: metrics.ErrorStats


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

    def encode(
        self, window: Voxels, window_box: Box, brick_box: Box, level_box: Box
    ) -> EncodedBrick:
        """Encode the brick that fills ``brick_box`` of a level.

        Args:
            window: voxels around the brick, as far as the level goes on one voxel beyond it.
            window_box: where the window lies in the level.
            brick_box: the brick's full box, which may end beyond the level.
            level_box: the box of the level.
        """
        origin = window_box.start_zyx
        offset = (-origin[0], -origin[1], -origin[2])
        around = window[brick_box.grow(1).intersect(level_box).shift(offset).slices]
        voxels = window[brick_box.intersect(level_box).shift(offset).slices]
        low, high = around.min(), around.max()
        count = voxels.size
        if not voxels.view(f"u{voxels.itemsize}").any():  # bitwise: -0.0 is not the fill value
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


def pad_to(voxels: Voxels, shape_zyx: Zyx) -> Voxels:
    """The voxels, grown to a shape by repeating the last ones, which widens no block's range."""
    if voxels.shape == shape_zyx:
        return voxels
    widths = [(0, n - have) for n, have in zip(shape_zyx, voxels.shape, strict=True)]
    return np.pad(voxels, widths, mode="edge")
