"""How far S3Dc keeps its bounds."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import S3dc, metrics
from octobrick.measure.extremes.search import Promise

_BOUND = "|error| ≤ (max − min) / (2·(2^bits − 1)) of each block, and one rounding"
_FLOAT_MAX = float(np.finfo(np.float32).max)
_TINY = 2.0**-149


def s3dc_promises(seed: int) -> Iterator[Promise]:
    """What is searched of S3Dc at a fixed rate, and with a bound."""
    unit = np.random.default_rng(seed).uniform(-1, 1, (16, 16, 16))
    fixed = partial(Promise, "S3Dc", "C++")
    for bits in (1, 4, 8):
        yield fixed(
            f"float32 range, {bits} bits", f"{_BOUND}; relative to that bound", 1.0,
            partial(_of_range, unit, S3dc(bits=bits)), 1.0, _TINY, _FLOAT_MAX,
        )  # fmt: skip
    yield fixed(
        "offset ÷ range, 4 bits", f"{_BOUND}; relative to that bound", 1.0,
        partial(_of_offset, unit, S3dc(bits=4)), 1.0, 1e-30, 1e30,
    )  # fmt: skip
    yield fixed(
        "voxels along x, 17 × 13 × n", f"{_BOUND}; relative to that bound", 1.0,
        partial(_of_length, seed), 20, 1, 2000, "whole",
    )  # fmt: skip
    for name in ("uint8", "int16", "uint16"):
        info = np.iinfo(name)
        yield fixed(
            f"{name} range, 3 bits", f"{_BOUND}; relative to that bound", 1.0,
            partial(_of_integers, unit, name), 9, 0, float(info.max) - info.min, "whole",
        )  # fmt: skip
    bounded = partial(Promise, "S3Dc, bounded", "C++")
    for name in ("int16", "float32"):
        yield bounded(
            f"max_error ÷ range, {name}", "no voxel is further off than max_error", 1.0,
            partial(_of_bound, unit, name), 1e-2, 1e-12, 1e6,
        )  # fmt: skip


def _worst(codec: S3dc, array: NDArray[Any], bound: float) -> float:
    """The largest error, relative to a bound."""
    decoded = codec.decode(codec.encode(array), array.shape, array.dtype)
    if not np.isfinite(decoded.astype(np.float64)).all():
        return float("inf")
    error = metrics.max_error(array, decoded)
    return error / bound if bound > 0 else (0.0 if error == 0 else float("inf"))


def _stated(codec: S3dc, array: NDArray[Any]) -> float:
    """The bound as the paper's equations have it for the widest block, found here from blocks."""
    assert codec.bits is not None
    levels, largest = 2**codec.bits - 1, 0.0
    for z, y, x in np.ndindex(*(-(-n // 8) for n in array.shape)):
        block = array[8 * z : 8 * z + 8, 8 * y : 8 * y + 8, 8 * x : 8 * x + 8].astype(np.float64)
        reach = float(block.max() - block.min())
        if array.dtype.kind == "f":
            rounding = float(np.abs(block).max()) * 2.0**-24 + _TINY
        else:
            rounding = 0.5 if reach > levels else -reach
        largest = max(largest, reach / (2 * levels) + rounding if reach > 0 else 0.0)
    return max(largest, 0.0)


def _of_range(unit: NDArray[np.float64], codec: S3dc, size: float) -> float:
    array = (unit * size).astype(np.float32)
    return _worst(codec, array, _stated(codec, array))


def _of_offset(unit: NDArray[np.float64], codec: S3dc, ratio: float) -> float:
    array = (ratio + unit).astype(np.float32) if ratio < 1e30 else (1e30 + unit).astype(np.float32)
    return _worst(codec, array, _stated(codec, array))


def _of_length(seed: int, length: float) -> float:
    shape = (17, 13, int(length))
    array = np.random.default_rng(seed).integers(0, 65536, shape).astype(np.uint16)
    codec = S3dc(bits=3)
    return _worst(codec, array, _stated(codec, array))


def _of_integers(unit: NDArray[np.float64], name: str, reach: float) -> float:
    low = np.iinfo(name).min
    array = np.rint(low + (unit + 1) / 2 * reach).astype(name)
    codec = S3dc(bits=3)
    return _worst(codec, array, _stated(codec, array))


def _of_bound(unit: NDArray[np.float64], name: str, relative: float) -> float:
    reach = 65535.0 if name == "int16" else 200.0
    array = (unit * reach / 2).astype(name)
    return _worst(S3dc(max_error=relative * reach), array, relative * reach)
