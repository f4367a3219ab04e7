"""Volumes whose codes the GPU does not decode, as volumes of raw bricks."""

from __future__ import annotations

from typing import Any, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import S3dc, Zerobit
from octobrick.renderer.brick_source import BlockCode, BrickSource
from octobrick.store.box import Zyx


class _Decoding(BrickSource, Protocol):
    def brick(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> NDArray[Any]:
        """The decoded voxels of a brick."""


class DecodedBricks:
    """Decodes bricks on the CPU as they are uploaded, at levels where the GPU does not.

    These then take as much GPU memory as raw ones. All else is the volume's.
    """

    def __init__(self, volume: _Decoding) -> None:
        self._volume = volume
        self.revision = f"{volume.revision} decoded"  # other bytes under the same addresses

    def __getattr__(self, name: str) -> Any:
        if name == "brick_codes":  # these are decoded one by one
            raise AttributeError(name)
        return getattr(self._volume, name)

    def level_codec(self, level: int) -> object:
        """The codec of a level whose bricks come as they are stored; None for raw voxels."""
        codec = self._volume.level_codec(level)
        return codec if is_drawn(codec) else None

    def brick_code(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> bytes | None:
        """A brick as it is stored, or its raw voxels, little-endian; None for an absent one."""
        code = self._volume.brick_code(level, zyx, t, c)
        codec = self._volume.level_codec(level)
        if code is None or codec is None or is_drawn(codec):
            return code
        voxels = self._volume.brick(level, zyx, t, c)
        return np.ascontiguousarray(voxels, voxels.dtype.newbyteorder("<")).tobytes()


def is_drawn(codec: object) -> bool:
    """Whether the GPU decodes codes of this codec: all forms of S3Dc, and zerobit of scalars."""
    if isinstance(codec, (S3dc, Zerobit)):
        return True
    return isinstance(codec, BlockCode) and codec.bits is not None and codec.scale == "linear"


def drawable(volume: BrickSource) -> BrickSource:
    """The volume itself where the GPU decodes its bricks, else one that the CPU decodes."""
    codecs = [volume.level_codec(i) for i in range(len(volume.levels))]
    if all(codec is None or is_drawn(codec) for codec in codecs):
        return volume
    if not hasattr(volume, "brick"):
        return volume  # which the code layout refuses, naming the codec
    return cast("BrickSource", DecodedBricks(cast("_Decoding", volume)))
