"""What one setting does to one brick, and, added up, to all that the bricks stand for."""

from __future__ import annotations

import dataclasses
import math
import statistics
import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import metrics
from octobrick.measure.brick_pass import BRICK
from octobrick.measure.measurement import CodeRow, Setting
from octobrick.store import brick_codec
from octobrick.store import frame as zstd_frame
from octobrick.store.brick_encoder import is_fill, pad_to
from octobrick.store.ingest_options import default_zstd_level

Voxels = NDArray[Any]

_SSIM_SIDE = 40  # of a brick's middle that SSIM looks at; all of it would take as long as all codes


@dataclass(frozen=True, slots=True)
class CodedBrick:
    """One brick, coded and decoded again.

    Attributes:
        nvoxels: of the volume's, without padding.
        coded_nvoxels: with padding; 0 where the brick is absent, as nothing was coded.
        resident_nbytes: of the code.
        disk_nbytes: of the code behind zstd.
        errors: of decoded against original voxels, without padding.
        histogram: of their absolute differences.
        ssim: of the windows in the brick's middle.
        encode_seconds, decode_seconds: without zstd.
    """

    nvoxels: int
    coded_nvoxels: int
    resident_nbytes: int
    disk_nbytes: int
    errors: metrics.ErrorStats
    histogram: metrics.Histogram
    ssim: metrics.SsimStats
    encode_seconds: float
    decode_seconds: float


def code_brick(codec: brick_codec.BrickCodec, voxels: Voxels, peak: float) -> CodedBrick:
    """Do with a brick what an ingest does, and look at what became of it.

    Args:
        codec: of the brick.
        voxels: its own, without padding.
        peak: of the whole volume, for SSIM.
    """
    none = metrics.ErrorStats(voxels.size, 0.0, 0.0)
    if is_fill(voxels):  # absent: no bytes, no error
        exact = _exact(voxels)
        return CodedBrick(voxels.size, 0, 0, 0, none, *exact, 0.0, 0.0)
    padded = pad_to(voxels, (BRICK,) * 3)
    start = time.perf_counter()
    code = brick_codec.encode(codec, padded)
    encoded = time.perf_counter()
    decoded = brick_codec.decode(codec, code, padded.shape, padded.dtype)
    end = time.perf_counter()
    frame = zstd_frame.compress(code, default_zstd_level(codec))
    nz, ny, nx = voxels.shape
    decoded = decoded[:nz, :ny, :nx]
    errors = none if codec is None else metrics.compare(voxels, decoded)
    if errors.max_abs == 0:
        histogram, ssim = _exact(voxels)
    else:
        histogram = _differences(voxels, decoded, errors.max_abs)
        middle = _middle(voxels.shape)
        ssim = metrics.ssim_stats(voxels[middle], decoded[middle], peak)
    return CodedBrick(
        nvoxels=voxels.size,
        coded_nvoxels=padded.size,
        resident_nbytes=len(code),
        disk_nbytes=len(frame),
        errors=errors,
        histogram=histogram,
        ssim=ssim,
        encode_seconds=encoded - start,
        decode_seconds=end - encoded,
    )


@dataclass(slots=True)
class CodeTally:
    """Adds up bricks, each by its weight.

    Args:
        setting: that they were coded by.
    """

    setting: Setting
    _nvoxels: float = 0.0
    _resident_nbytes: float = 0.0
    _disk_nbytes: float = 0.0
    _sum_squared: float = 0.0
    _max_abs: float = 0.0
    _ssim: float = 0.0
    _ssim_weight: float = 0.0
    _histogram: metrics.Histogram = field(default_factory=metrics.Histogram)
    _encode: list[float] = field(default_factory=list)
    _decode: list[float] = field(default_factory=list)

    def add(self, brick: CodedBrick, weight: float, *, timed: bool) -> None:
        """Take note of a brick that counts so many times.

        Args:
            brick: coded.
            weight: how often it counts.
            timed: whether nothing else ran meanwhile, so that its times are those of one thread.
        """
        self._nvoxels += weight * brick.nvoxels
        self._resident_nbytes += weight * brick.resident_nbytes
        self._disk_nbytes += weight * brick.disk_nbytes
        self._sum_squared += weight * brick.errors.sum_squared
        self._max_abs = max(self._max_abs, brick.errors.max_abs)
        self._histogram += _weighted(brick.histogram, weight)
        if brick.ssim.count:
            self._ssim += weight * brick.nvoxels * brick.ssim.mean
            self._ssim_weight += weight * brick.nvoxels
        if timed and brick.coded_nvoxels:
            self._encode.append(brick.coded_nvoxels / max(brick.encode_seconds, 1e-9))
            self._decode.append(brick.coded_nvoxels / max(brick.decode_seconds, 1e-9))

    def row(self, peak: float, index_nbytes: int) -> CodeRow:
        """The figures of all bricks.

        Args:
            peak: of the whole volume.
            index_nbytes: of the indexes of level 0's shards, which count as bytes on disk.
        """
        errors = metrics.ErrorStats(round(self._nvoxels), self._max_abs, self._sum_squared)
        return CodeRow(
            setting=self.setting,
            resident_bits=8 * self._resident_nbytes / self._nvoxels,
            disk_bits=8 * (self._disk_nbytes + index_nbytes) / self._nvoxels,
            psnr_db=None if errors.max_abs == 0 else errors.psnr(peak),
            ssim=self._ssim / self._ssim_weight if self._ssim_weight else math.nan,
            max_error=float(errors.max_abs),
            rmse=errors.rmse,
            errors=self._histogram,
            encode_voxels_per_second=statistics.median(self._encode) if self._encode else 0.0,
            decode_voxels_per_second=statistics.median(self._decode) if self._decode else 0.0,
        )


def _exact(voxels: Voxels) -> tuple[metrics.Histogram, metrics.SsimStats]:
    """Differences and similarity where nothing was lost."""
    count = np.array([voxels.size], np.uint64)
    windows = 1 if min(voxels.shape) >= 11 else 0  # of SSIM, of which one mean is what counts
    return metrics.Histogram(0, 0, count), metrics.SsimStats(windows, float(windows))


def _differences(a: Voxels, b: Voxels, greatest: float) -> metrics.Histogram:
    """How often each absolute difference occurs; of whole numbers exactly."""
    if a.dtype.kind in "iu":
        wide = np.abs(a.astype(np.int32) - b.astype(np.int32)).astype(np.uint16)
        return metrics.histogram(wide, 0, greatest)
    floats = np.abs(a.astype(np.float64) - b.astype(np.float64)).astype(np.float32)
    return metrics.histogram(floats, 0, float(floats.max()))


def _middle(shape: tuple[int, ...]) -> tuple[slice, ...]:
    starts = [max(0, (n - _SSIM_SIDE) // 2) for n in shape]
    return tuple(slice(s, s + min(n, _SSIM_SIDE)) for s, n in zip(starts, shape, strict=True))


def _weighted(histogram: metrics.Histogram, weight: float) -> metrics.Histogram:
    if weight == 1:
        return histogram
    counts = np.rint(histogram.counts * weight).astype(np.uint64)
    return dataclasses.replace(histogram, counts=counts)
