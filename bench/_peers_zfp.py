"""zfp as a peer: at a fixed rate, and at the accuracy that comes nearest to ours."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path

import _zfp
from _peers_method import Calls, Method, Voxels, behind_zstd, contiguous, value_range
from _peers_ours import BOUNDS, SMALL

from octobrick.codec import S3dc, metrics

_OCTAVES = range(-4, 3)
"""Powers of 2 of the tolerances that are tried; zfp knows no others."""


class _Zfp:
    """One mode of zfp with what it is given; conversion is not timed."""

    def __init__(
        self,
        voxels: Voxels,
        given: Voxels,
        coder: Callable[[Voxels, float], bytes],
        level: float,
        *,
        is_sampled: bool,
    ) -> None:
        self._voxels, self._given, self._coder, self._level = voxels, given, coder, level
        self._is_sampled = is_sampled

    def encode(self) -> bytes:
        return self._coder(self._given, self._level)

    def decode(self, code: bytes) -> Voxels:
        return _zfp.decode(code)

    def voxels(self, decoded: Voxels) -> Voxels:
        return _zfp.as_samples(decoded, self._voxels.dtype)

    def sizes(self, code: bytes) -> tuple[int, int]:
        return len(code) if self._is_sampled else self._voxels.nbytes, behind_zstd(code)

    def errors(self) -> metrics.ErrorStats:
        """Of a first try."""
        return metrics.compare(self._voxels, self.voxels(self.decode(self.encode())))


def _ready_rate(bits: int, voxels: Voxels, _: Path) -> Calls:
    """Of float32 and shifted int32 what is better."""
    voxels = contiguous(voxels)
    tries = [
        _Zfp(voxels, given, _zfp.encode_rate, bits, is_sampled=True)
        for given in _zfp.inputs(voxels).values()
    ]
    return min(tries, key=lambda t: t.errors().rmse)


def _ready_accuracy(share: float, voxels: Voxels, _: Path) -> Calls:
    """With the tolerance whose greatest error is nearest to that of S3Dc with this bound."""
    voxels = contiguous(voxels)
    bound = share * value_range(voxels)
    ours = S3dc(SMALL, max_error=bound).error_bound(voxels) or bound
    given = _zfp.inputs(voxels)["float32"]
    tries = [
        _Zfp(voxels, given, _zfp.encode_accuracy, bound / 2.0**octave, is_sampled=False)
        for octave in _OCTAVES
    ]

    def distance(tried: _Zfp) -> float:
        error = float(tried.errors().max_abs)
        return abs(math.log(error / ours)) if error else math.inf

    return min(tries, key=distance)


def methods() -> list[Method]:
    """Zfp at 1, 2 and 4 bits, and beside each of our bounds."""
    rates = [
        Method(f"zfp rate {bits}", "zfp rate", "block 4³", partial(_ready_rate, bits))
        for bits in (1, 2, 4)
    ]
    return rates + [
        Method(f"zfp ~{100 * share:g} %", "zfp accuracy", "no", partial(_ready_accuracy, share))
        for share in BOUNDS
    ]
