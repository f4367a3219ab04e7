"""Compressors of any bytes as peers: zstd alone, and Blosc2."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from _peers_method import Calls, Method, NotPossibleError, Voxels, contiguous

MANTISSA_BITS = (4, 8)
"""What Blosc2's truncation leaves of 23."""


class _Zstd:
    """The whole volume as one frame."""

    def __init__(self, level: int, voxels: Voxels) -> None:
        self._level, self._voxels = level, voxels

    def encode(self) -> bytes:
        return zstandard.ZstdCompressor(level=self._level).compress(self._voxels.data.cast("B"))

    def decode(self, code: bytes) -> bytes:
        return zstandard.ZstdDecompressor().decompress(code)

    def voxels(self, decoded: bytes) -> Voxels:
        return np.frombuffer(decoded, self._voxels.dtype).reshape(self._voxels.shape)

    def sizes(self, code: bytes) -> tuple[int, int]:
        return self._voxels.nbytes, len(code)


class _Blosc2:
    """An array in chunks that Blosc2 chooses, on one thread."""

    def __init__(self, codec: str, filters: list[str], meta: list[int], voxels: Voxels) -> None:
        import blosc2

        self._voxels = voxels
        self._parameters = {
            "codec": blosc2.Codec[codec],
            "clevel": 5,
            "filters": [blosc2.Filter[name] for name in filters],
            "filters_meta": meta,
            "nthreads": 1,
        }

    def encode(self) -> bytes:
        import blosc2

        made = blosc2.asarray(self._voxels, cparams=self._parameters, dparams={"nthreads": 1})
        return bytes(made.to_cframe())

    def decode(self, code: bytes) -> Voxels:
        import blosc2

        opened: Any = blosc2.ndarray_from_cframe(code)
        decoded: Voxels = opened[...]
        return decoded

    def voxels(self, decoded: Voxels) -> Voxels:
        return decoded

    def sizes(self, code: bytes) -> tuple[int, int]:
        return self._voxels.nbytes, len(code)


def _ready_zstd(level: int, voxels: Voxels, _: Path) -> Calls:
    return _Zstd(level, contiguous(voxels))


def _ready_blosc2(codec: str, filter_: str, voxels: Voxels, _: Path) -> Calls:
    return _Blosc2(codec, [filter_], [0], contiguous(voxels))


def _ready_truncated(bits: int, voxels: Voxels, _: Path) -> Calls:
    if voxels.dtype != np.float32:
        raise NotPossibleError("its truncation is of floats")
    return _Blosc2("ZSTD", ["TRUNC_PREC", "BITSHUFFLE"], [bits, 0], contiguous(voxels))


def methods() -> list[Method]:
    """Zstd at three levels, Blosc2 with two codecs and two filters, and with truncation."""
    found = [
        Method(f"zstd {level}", "zstd", "no", partial(_ready_zstd, level), is_slow=level > 9)
        for level in (1, 3, 19)
    ]
    for codec in ("ZSTD", "LZ4"):
        for filter_ in ("SHUFFLE", "BITSHUFFLE"):
            name = f"blosc2 {codec.lower()} {filter_.lower()}"
            ready = partial(_ready_blosc2, codec, filter_)
            found.append(Method(name, "blosc2", "chunk", ready))
    for bits in MANTISSA_BITS:
        name = f"blosc2 zstd trunc {bits}"
        found.append(Method(name, "blosc2 truncated", "chunk", partial(_ready_truncated, bits)))
    return found
