"""What every test of the codec draws from: sample types, blocks, and arrays of awkward shapes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

DTYPES = ("uint8", "int8", "uint16", "int16", "float32")


@pytest.fixture(params=DTYPES)
def dtype(request: pytest.FixtureRequest) -> np.dtype[Any]:
    """Each sample type of the codec."""
    return np.dtype(request.param)


@pytest.fixture
def noise() -> Any:
    """A maker of arrays that use the whole range of their type (float32: about ±100)."""

    def make(shape: tuple[int, ...], dtype: Any, seed: int = 1) -> NDArray[Any]:
        rng, dtype = np.random.default_rng(seed), np.dtype(dtype)
        if dtype.kind == "f":
            return (rng.normal(size=shape) * 30).astype(dtype)
        info = np.iinfo(dtype)
        return rng.integers(info.min, info.max, shape, dtype, endpoint=True)

    return make
