"""What tests of S3Dc draw: volumes of any shape, strides and character, and predictions."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

DTYPES = ("uint8", "int8", "uint16", "int16", "float32")

dtypes = st.sampled_from(DTYPES)
blocks = st.one_of(st.sampled_from([(4, 4, 4), (8, 8, 8)]), st.tuples(*[st.integers(1, 9)] * 3))
extents = st.one_of(st.integers(1, 12), st.integers(1, 70))


@st.composite
def volumes(draw: st.DrawFn, most_voxels: int = 20000) -> NDArray[Any]:
    """A volume of 1 to 70 voxels per axis: noise, waves, steps, or nearly nothing; any strides."""
    shape = draw(st.tuples(extents, extents, extents).filter(lambda s: np.prod(s) <= most_voxels))
    dtype = np.dtype(draw(dtypes))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    wide = tuple(n + draw(st.integers(0, 2)) for n in shape)
    z, y, x = np.indices(wide)
    match draw(st.sampled_from(["noise", "waves", "steps", "sparse"])):
        case "noise":
            values = rng.uniform(-1, 1, wide)
        case "waves":
            values = np.sin(z / 5 + y / 7 + x / 9) + rng.normal(0, 0.02, wide)
        case "steps":
            values = ((z // 3 + y // 4 + x // 5) % 5) / 2 - 1 + rng.normal(0, 0.001, wide)
        case _:
            values = np.where(rng.uniform(size=wide) > 0.999, rng.uniform(-1, 1, wide), 0.0)
    if dtype.kind == "f":
        array = (values * 10.0 ** draw(st.integers(-30, 30))).astype(dtype)
    else:
        info = np.iinfo(dtype)
        middle, half = (info.max + info.min) / 2, (info.max - info.min) / 2
        scale = draw(st.sampled_from([1.0, 0.2, 0.01]))
        array = np.clip(middle + values * half * scale, info.min, info.max).astype(dtype)
    flips = tuple(slice(None, None, draw(st.sampled_from([1, -1]))) for _ in range(3))
    return array[tuple(slice(0, n) for n in shape)][flips]


@st.composite
def predictions(draw: st.DrawFn, array: NDArray[Any]) -> NDArray[Any] | None:
    """None, or something near to the volume, far from it, or the volume itself."""
    match draw(st.sampled_from(["none", "near", "same", "far"])):
        case "none":
            return None
        case "near":
            return np.roll(array, 1, axis=draw(st.integers(0, 2)))
        case "same":
            return array
    return array[::-1, ::-1, ::-1].copy()
