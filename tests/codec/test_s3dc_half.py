"""float16 voxels are coded as float32, which holds them exactly, and rounded when decoded."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from octobrick.codec import S3dc, deblock, metrics, reduce

halves = hnp.arrays(
    np.float16,
    hnp.array_shapes(min_dims=3, max_dims=3, max_side=9),
    elements=st.floats(width=16, allow_nan=False, allow_infinity=False),
)
LARGEST = np.float16(65504)


@given(halves, st.integers(1, 8))
@settings(max_examples=80, deadline=None)
def test_a_half_code_is_that_of_the_floats_and_decodes_to_their_rounding(
    array: NDArray[Any], bits: int
) -> None:
    codec, floats = S3dc((4, 4, 4), bits), array.astype(np.float32)
    code = codec.encode(array)
    assert code == codec.encode(floats)
    decoded = codec.decode(code, array.shape, np.float16)
    assert decoded.dtype == np.float16
    rounded = codec.decode(code, array.shape, np.float32).astype(np.float16)
    np.testing.assert_array_equal(decoded, rounded)
    assert metrics.max_error(array, decoded) == codec.error_bound(array)


@given(halves, st.floats(0, 1e5), st.booleans())
@settings(max_examples=150, deadline=None)
def test_a_bound_holds_after_rounding_to_half(
    array: NDArray[Any], bound: float, predicted: bool
) -> None:
    codec = S3dc((4, 4, 4), max_error=bound)
    prediction = array[::-1].copy() if predicted else None
    code = codec.encode(array, prediction=prediction)
    decoded = codec.decode(code, array.shape, np.float16, prediction=prediction)
    assert np.isfinite(decoded).all()
    assert metrics.max_error(array, decoded) <= bound


def test_full_range_and_denormal_halves_are_lossless_with_enough_bits() -> None:
    tiny = np.arange(64).reshape(4, 4, 4).astype(np.uint16).view(np.float16)
    wide = np.full((4, 4, 4), LARGEST)
    wide[::2] = -LARGEST
    for array in (tiny, wide):
        for codec in (S3dc(max_error=0), S3dc(bits_per_voxel=60)):
            decoded = codec.decode(codec.encode(array), array.shape, array.dtype)
            np.testing.assert_array_equal(decoded, array)


def test_halves_that_are_not_finite_are_named() -> None:
    array = np.zeros((2, 3, 4), np.float16)
    array[1, 2, 3] = np.inf
    for codec in (S3dc(), S3dc(max_error=1)):
        with pytest.raises(ValueError, match=r"\(1, 2, 3\) is inf"):
            codec.encode(array)
        assert codec.encode(array, replace_nonfinite=0)


def test_halves_are_reduced_upsampled_and_bounded() -> None:
    array = np.random.default_rng(1).normal(size=(9, 10, 11)).astype(np.float16)
    coarse = reduce.mean2(array)
    assert coarse.dtype == np.float16
    np.testing.assert_array_equal(coarse, reduce.mean2(array.astype(np.float32)).astype(np.float16))
    assert reduce.upsample2(coarse, array.shape).dtype == np.float16
    codec = S3dc((4, 4, 4), 3)
    bounds = deblock.s3dc_bounds(codec, codec.encode(array), array.shape, np.float16)
    ranges = codec.block_ranges(array)
    assert ranges.dtype == np.float16
    widest = (ranges[..., 1].astype(np.float32) - ranges[..., 0]) / 14
    np.testing.assert_allclose(bounds, widest, rtol=1e-6)
    assert codec.compression_ratio((64, 64, 64), np.float16) < 4 + 1
