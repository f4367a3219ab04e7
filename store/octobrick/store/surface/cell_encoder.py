"""Encodes the cells of a brick that a surface touches, and nothing of the others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import Zerobit, metrics
from octobrick.store import brick_codec
from octobrick.store import frame as zstd_frame
from octobrick.store.box import Zyx
from octobrick.store.brick_encoder import BrickEncoder, EncodedBrick, pad_to
from octobrick.store.surface.selection import CELL, CellMask, LevelSelection

Voxels = NDArray[Any]


@dataclass(frozen=True, slots=True)
class CellEncoder:
    """What `BrickEncoder` is, for one brick of which only some cells are kept.

    All other voxels are stored as 0; a brick that keeps none is absent. Errors are those of the
    kept voxels, and a zerobit code's share of details counts these only.

    Args:
        encoder: whose codec is used.
        selection: of the brick's level.
        brick_zyx: which brick.
    """

    encoder: BrickEncoder
    selection: LevelSelection
    brick_zyx: Zyx

    @property
    def brick(self) -> int:
        """Voxels per brick and axis."""
        return self.encoder.brick

    def encode(self, voxels: Voxels, low: Any, high: Any) -> EncodedBrick:
        """See `BrickEncoder.encode`."""
        zero = voxels.dtype.type(0)
        mask = self.selection.of_brick(self.brick_zyx)
        if not mask.any():
            # One voxel around may belong to a brick that keeps some.
            is_near = self.selection.is_near(self.brick_zyx)
            bounds = (min(low, zero), max(high, zero)) if is_near else (zero, zero)
            return EncodedBrick(None, *bounds)
        if mask.all():
            return self.encoder.encode(voxels, min(low, zero), max(high, zero))
        codec = self.encoder.codec
        kept = enlarged(mask)
        padded = np.where(kept, pad_to(voxels, kept.shape), zero)
        if isinstance(codec, Zerobit):
            code = codec.encode(padded, wanted=mask)
        else:
            code = brick_codec.encode(codec, padded)
        nz, ny, nx = voxels.shape
        own = kept[:nz, :ny, :nx]
        decoded = brick_codec.decode(codec, code, padded.shape, padded.dtype)[:nz, :ny, :nx]
        errors = metrics.compare(voxels[own], decoded[own])
        frame = zstd_frame.compress(code, self.encoder.zstd_level)
        return EncodedBrick(frame, min(low, zero), max(high, zero), errors)


def enlarged(mask: CellMask) -> NDArray[np.bool_]:
    """Which voxels lie in the cells of a mask."""
    return mask.repeat(CELL, 0).repeat(CELL, 1).repeat(CELL, 2)
