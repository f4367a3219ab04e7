"""Our codes, to be compared with others': S3Dc in three forms, zerobit, and lossless bricks."""

from __future__ import annotations

import itertools
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from _peers_method import (
    Calls,
    Method,
    NotPossibleError,
    Voxels,
    behind_zstd,
    contiguous,
    value_range,
)

from octobrick.codec import S3dc, Zerobit
from octobrick.codec.errors import InvalidInputError

SMALL, LARGE = (4, 4, 4), (8, 8, 8)
BRICK = 64
BOUNDS = (0.04, 0.01, 0.0025)
"""Greatest errors as shares of the range, at which peers are measured too."""

FINE_BOUND = 0.0006
"""One more for us, so that there is something between the last of these and no loss at all."""


class _Codec:
    """A codec of octobrick.codec on one thread, the whole volume as one code."""

    def __init__(self, codec: S3dc | Zerobit, voxels: Voxels) -> None:
        self._codec, self._voxels = codec, voxels

    def encode(self) -> bytes:
        try:
            return self._codec.encode(self._voxels, threads=1)
        except InvalidInputError as error:
            raise NotPossibleError("end points and tables alone take more bits") from error

    def decode(self, code: bytes) -> Voxels:
        return self._codec.decode(code, self._voxels.shape, self._voxels.dtype, threads=1)

    def voxels(self, decoded: Voxels) -> Voxels:
        return decoded

    def sizes(self, code: bytes) -> tuple[int, int]:
        return len(code), behind_zstd(code)


class _LosslessBricks:
    """Bricks of 64³ voxels as a lossless volume stores them: padded, each behind zstd."""

    def __init__(self, voxels: Voxels) -> None:
        self._voxels = voxels

    def encode(self) -> list[bytes]:
        squeeze = zstandard.ZstdCompressor(level=3, write_checksum=True).compress
        codes = []
        for box in self._boxes():
            brick = self._voxels[box]
            padding = [(0, BRICK - n) for n in brick.shape]
            codes.append(squeeze(np.pad(brick, padding, mode="edge").tobytes()))
        return codes

    def decode(self, code: list[bytes]) -> Voxels:
        expand = zstandard.ZstdDecompressor().decompress
        out = np.empty_like(self._voxels)
        for box, stored in zip(self._boxes(), code, strict=True):
            brick = np.frombuffer(expand(stored), out.dtype).reshape((BRICK,) * 3)
            nz, ny, nx = out[box].shape
            out[box] = brick[:nz, :ny, :nx]
        return out

    def voxels(self, decoded: Voxels) -> Voxels:
        return decoded

    def sizes(self, code: list[bytes]) -> tuple[int, int]:
        return self._voxels.nbytes, sum(map(len, code))

    def _boxes(self) -> list[tuple[slice, ...]]:
        along = [[slice(at, at + BRICK) for at in range(0, n, BRICK)] for n in self._voxels.shape]
        return list(itertools.product(*along))


def _ready(codec: Any, voxels: Voxels, _: Path) -> Calls:
    return _Codec(codec, contiguous(voxels))


def _ready_bound(share: float, voxels: Voxels, _: Path) -> Calls:
    return _Codec(S3dc(SMALL, max_error=share * value_range(voxels)), contiguous(voxels))


def _ready_bricks(voxels: Voxels, _: Path) -> Calls:
    return _LosslessBricks(contiguous(voxels))


def methods() -> list[Method]:
    """All of ours."""
    found = [
        Method(f"S3Dc fixed {bits}", "S3Dc fixed", "voxel", partial(_ready, S3dc(LARGE, bits)))
        for bits in (2, 4)
    ]
    for bits in (1, 2, 4):
        codec = S3dc(SMALL, bits_per_voxel=bits)
        found.append(Method(f"S3Dc widths {bits}", "S3Dc widths", "voxel", partial(_ready, codec)))
    for share in (*BOUNDS, FINE_BOUND, 0):
        name = f"S3Dc bound {100 * share:g} %"
        found.append(Method(name, "S3Dc bound", "voxel", partial(_ready_bound, share)))
    for ratio in (0.02, 0.05):
        ready = partial(_ready, Zerobit(ratio))
        found.append(Method(f"zerobit {ratio:.0%}".replace("%", " %"), "zerobit", "voxel", ready))
    lossless = Method("lossless, zstd 3", "octobrick lossless", "brick 64³", _ready_bricks)
    return [*found, lossless]
