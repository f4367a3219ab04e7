"""Voxels in the terms of the slab texture, on the CPU: what `shaders/stored.glsl` does. No GL."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class StoredValues:
    """From values of a sample type to what a texture holds.

    Attributes:
        dtype: of the samples.
        low: the value that is stored as 0.
        width: of the range; of integers, that of their type.
    """

    dtype: np.dtype[Any]
    low: float
    width: float

    @classmethod
    def of(cls, dtype: np.dtype[Any], value_range: tuple[float, float]) -> Self:
        """For the samples of a volume; floats are relative to its range, rounded to float32."""
        if dtype.kind != "f":
            info = np.iinfo(dtype)
            return cls(dtype, float(info.min), float(info.max) - float(info.min))
        low, high = (float(np.float32(bound)) for bound in value_range)
        return cls(dtype, low, high - low)

    def store_in_place(self, voxels: NDArray[Any]) -> None:
        """Turn voxels (z, y, x), of any strides, into offset-binary or relative values."""
        if self.dtype.kind == "u":
            return
        if self.dtype.kind == "i":
            unsigned = voxels.view(f"u{self.dtype.itemsize}")
            np.bitwise_xor(unsigned, 1 << (8 * self.dtype.itemsize - 1), out=unsigned)
            return
        for plane in voxels:  # while it is in the cache
            self._relate(plane, plane)

    def of_filtered(self, filtered: NDArray[np.float32]) -> NDArray[Any]:
        """Filtered voxels, float32 (z, y, x): 16-bit normalised, or float32 relative values."""
        if self.dtype.kind == "f":
            out = np.empty(filtered.shape, np.float32)
            for plane, relative in zip(filtered, out, strict=True):
                self._relate(plane, relative)
            return out
        normalised = np.empty(filtered.shape, np.uint16)
        for plane, out in zip(filtered, normalised, strict=True):
            # At most 65535.5, which float32 holds exactly.
            scaled = (plane - np.float32(self.low)) * np.float32(65535 / self.width)
            scaled += np.float32(0.5)
            out[...] = scaled.astype(np.uint16)
        return normalised

    def _relate(self, plane: NDArray[np.float32], out: NDArray[np.float32]) -> None:
        """In double, as the greatest less the least may exceed float32's range."""
        if self.width <= 0:
            out[...] = 0
            return
        doubles = np.subtract(plane, self.low, dtype=np.float64)
        np.divide(doubles, self.width, out=out, casting="same_kind")
