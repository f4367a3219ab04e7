"""Volumes that the tests of Zerobit draw from."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

KINDS = (
    ("uint8", 1), ("int8", 1), ("uint16", 1), ("int16", 1), ("float32", 1),
    ("uint8", 3), ("uint16", 3),
)  # fmt: skip
"""Sample types and channels that have a code."""


def scene(shape: tuple[int, ...], dtype: str, channels: int = 1, seed: int = 1) -> NDArray[Any]:
    """Waves with a little noise over an empty background: (z, y, x), or (z, y, x, 3)."""
    rng = np.random.default_rng(seed)
    z, y, x = np.indices(shape)
    waves = np.stack(
        [np.sin(z / 5 + c + seed) + np.cos(y / 7 - c) + np.sin(x / 6) for c in range(channels)],
        axis=-1,
    )
    level = np.clip((waves + 3) / 6 + rng.normal(size=waves.shape) * 0.02, 0, 1)
    level[level < 0.4] = 0
    if dtype == "float32":
        image = (level * 100 - 20).astype(np.float32)
    else:
        info = np.iinfo(dtype)
        image = (info.min + level * (int(info.max) - int(info.min))).astype(dtype)
    return image if channels > 1 else image[..., 0]


def with_channels(array: NDArray[Any]) -> NDArray[Any]:
    """(z, y, x, C), as the reference takes it."""
    return array if array.ndim == 4 else array[..., None]
