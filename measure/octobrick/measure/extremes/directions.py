"""How far directions of gradients stay within their angle."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import gradients, metrics
from octobrick.measure.extremes.search import Promise

DEGREES = 0.1731
_CODED = "a direction is off by at most 0.1731° after its three bytes; degrees"


def gradient_promises(seed: int) -> Iterator[Promise]:
    """What is searched of gradients."""
    rng = np.random.default_rng(seed)
    unit = rng.normal(size=(4000, 3))
    unit /= np.abs(unit).max(axis=-1, keepdims=True)
    one = partial(Promise, "gradients", "C++")
    yield one(
        "length, float64", _CODED, DEGREES, partial(_of_length, unit), 1.0, 5e-324, 1e308, "log", 9
    )
    yield one(
        "greatest ÷ least component", _CODED, DEGREES,
        partial(_of_flatness, rng.uniform(size=2000)), 1.0, 1.0, 1e300,
    )  # fmt: skip
    volume = rng.uniform(-1, 1, (6, 7, 9))
    yield one(
        "float32 range of the volume", "differences keep their direction; degrees", 1e-2,
        partial(_of_range, volume), 1.0, 1e-38, float(np.finfo(np.float32).max),
    )  # fmt: skip
    yield one(
        "spacing z ÷ x, powers of two", "a plane across (1, 1, 1) keeps its normal; degrees", 1e-3,
        _of_spacing, 1.0, 2.0**-16, 2.0**16,
    )  # fmt: skip


def worst_angle(vectors: NDArray[Any]) -> float:
    """The greatest angle between vectors that are not 0 and their codes, in degrees."""
    decoded = gradients.decode_directions(gradients.encode_directions(vectors))
    live = vectors.any(axis=-1)
    if decoded[~live].any() or not np.isfinite(decoded).all():
        return float("inf")
    return _angle(vectors[live], decoded[live])


def _angle(a: NDArray[Any], b: NDArray[Any]) -> float:
    """Scaled first, as squares of the least are 0 and of the greatest infinite."""
    wide = [v.astype(np.float64) / np.abs(v).max(axis=-1, keepdims=True) for v in (a, b)]
    return float(metrics.angular_error(*wide).max(initial=0.0))


def _of_length(unit: NDArray[np.float64], size: float) -> float:
    return worst_angle(unit * size)


def _of_flatness(other: NDArray[np.float64], ratio: float) -> float:
    vectors = np.stack([np.ones_like(other), other / ratio, np.full_like(other, 1 / ratio)], -1)
    return worst_angle(vectors)


def _of_range(volume: NDArray[np.float64], size: float) -> float:
    array = (volume * size).astype(np.float32)
    found = gradients.central_differences(array)
    z, y, x = np.gradient(array.astype(np.float64), axis=(0, 1, 2))
    exact = np.stack([x, y, z], axis=-1)
    if not np.isfinite(found).all() or not found.any(axis=-1).all():
        return float("inf")
    return _angle(exact, found)


def _of_spacing(ratio: float) -> float:
    """By the nearest power of two, with which voxels of the plane are exact in float32."""
    ratio = 2.0 ** round(math.log2(ratio))
    z, y, x = np.indices((4, 5, 6))
    array = (x + y + z * ratio).astype(np.float32)
    return _angle(np.ones((4, 5, 6, 3)), gradients.central_differences(array, (ratio, 1, 1)))
