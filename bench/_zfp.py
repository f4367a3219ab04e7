"""zfp beside our codecs, through imagecodecs: at a fixed rate and at a fixed accuracy."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

# zfp takes 32-bit samples; its authors advise to fill them.
_SHIFT = {1: 22, 2: 14}


def inputs(voxels: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """What zfp can be given for these voxels: float32, and for integers a shifted int32."""
    given: dict[str, NDArray[Any]] = {"float32": np.ascontiguousarray(voxels, np.float32)}
    if voxels.dtype.kind != "f":
        given["int32"] = voxels.astype(np.int32) << _SHIFT[voxels.dtype.itemsize]
    return given


def encode_rate(given: NDArray[Any], bits_per_voxel: float) -> bytes:
    """The code at a fixed rate."""
    return _encode(given, bits_per_voxel, "FIXED_RATE")


def encode_accuracy(given: NDArray[Any], tolerance: float) -> bytes:
    """The code whose errors are below a tolerance."""
    return _encode(given, tolerance, "FIXED_ACCURACY")


def _encode(given: NDArray[Any], level: Any, mode: str) -> bytes:
    import imagecodecs

    return bytes(imagecodecs.zfp_encode(given, level=level, mode=imagecodecs.ZFP.MODE[mode]))


def decode(code: bytes) -> NDArray[Any]:
    """What zfp was given, more or less."""
    import imagecodecs

    decoded: NDArray[Any] = imagecodecs.zfp_decode(code)
    return decoded


def as_samples(decoded: NDArray[Any], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Decoded voxels in their own type, rounded and clipped as our codecs do."""
    if dtype.kind == "f":
        return decoded.astype(dtype)
    values = decoded.astype(np.float64)
    if decoded.dtype == np.int32:
        values /= 1 << _SHIFT[dtype.itemsize]
    info = np.iinfo(dtype)
    return np.clip(np.floor(values + 0.5), info.min, info.max).astype(dtype)
