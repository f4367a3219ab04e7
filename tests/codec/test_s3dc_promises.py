"""What S3Dc guarantees of any data: bound, exactness, sizes; and the figures of the paper."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import FrozenInstanceError
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from octobrick.codec import S3dc, metrics
from octobrick.codec.errors import InvalidInputError

FLOAT_MAX = np.finfo(np.float32).max
FLOAT_TINY = np.finfo(np.float32).smallest_subnormal

any_float = st.floats(allow_nan=False, allow_infinity=False, width=32)
any_array = st.sampled_from(["uint8", "int8", "uint16", "int16", "float32"]).flatmap(
    lambda dtype: hnp.arrays(
        dtype,
        hnp.array_shapes(min_dims=3, max_dims=3, max_side=7),
        elements=any_float if dtype == "float32" else hnp.from_dtype(np.dtype(dtype)),
    )
)
codecs = st.builds(
    S3dc, block=st.tuples(*[st.integers(1, 8)] * 3), bits=st.integers(1, 8)
)  # fmt: skip


def round_trip(codec: S3dc, array: NDArray[Any]) -> NDArray[Any]:
    return codec.decode(codec.encode(array), array.shape, array.dtype)


@given(codecs, any_array)
@settings(max_examples=200, deadline=None)
def test_no_voxel_is_further_off_than_the_bound(codec: S3dc, array: NDArray[Any]) -> None:
    decoded = round_trip(codec, array)
    assert metrics.max_error(array, decoded) <= codec.error_bound(array)


@given(codecs, any_array)
@settings(max_examples=100, deadline=None)
def test_the_bound_is_no_looser_than_half_a_step(codec: S3dc, array: NDArray[Any]) -> None:
    """(max − min)/(2L) of the widest block, and one rounding to the sample type."""
    step = (float(array.max()) - float(array.min())) / (2**codec.bits - 1)
    greatest = max(abs(float(array.min())), abs(float(array.max())))
    rounding = greatest * 2.0**-23 + FLOAT_TINY if array.dtype.kind == "f" else 0.5
    assert codec.error_bound(array) <= step / 2 + rounding


@given(codecs, any_array)
@settings(max_examples=100, deadline=None)
def test_least_and_greatest_voxel_of_each_block_are_exact(codec: S3dc, array: NDArray[Any]) -> None:
    decoded = round_trip(codec, array)
    assert decoded.min() == array.min()
    assert decoded.max() == array.max()


@pytest.mark.parametrize("bits", range(1, 9))
def test_the_greatest_voxel_is_exact_where_the_range_of_a_block_is_rounded(bits: int) -> None:
    """A block of −2^53 and 1 once gave back 0 for the 1: its range has 54 bits."""
    array = np.full((2, 3, 4), -(2.0**53), np.float32)
    array[1, 2, 3] = 1
    assert round_trip(S3dc((8, 8, 8), bits), array).max() == 1


@pytest.mark.parametrize(
    ("bits", "edge", "ratio"),
    [
        (2, 2, 2.667), (2, 4, 6.395), (2, 8, 7.757), (2, 16, 7.968),
        (2, 32, 7.996), (2, 64, 7.999), (2, 128, 8.000),
        (4, 2, 2.000), (4, 4, 3.554), (4, 8, 3.938), (4, 16, 3.992),
        (4, 32, 3.999), (4, 64, 4.000), (4, 128, 4.000),
    ],
)  # fmt: skip
def test_table_1_compression_ratios_of_the_paper(bits: int, edge: int, ratio: float) -> None:
    codec = S3dc((edge, edge, edge), bits)
    assert codec.compression_ratio((486, 512, 512), "uint16") == pytest.approx(ratio, abs=0.0005)


def test_equation_6_of_the_paper_for_8_bit_samples_and_2_bits() -> None:
    """ceil(255 / (2·3)) is 43; whole numbers between levels 85 apart are at most 42 away."""
    array = np.arange(256, dtype=np.uint8).reshape(1, 16, 16)
    codec = S3dc((1, 16, 16), 2)
    assert codec.error_bound(array) == 43
    assert metrics.max_error(array, round_trip(codec, array)) == 42


@pytest.mark.parametrize("dtype", ["uint8", "int8"])
def test_8_bits_keep_8_bit_samples_exactly(noise: Any, dtype: str) -> None:
    array = noise((9, 17, 70), dtype)
    codec = S3dc((4, 4, 4), 8)
    assert codec.error_bound(array) == 0
    np.testing.assert_array_equal(round_trip(codec, array), array)


@pytest.mark.parametrize("dtype", ["uint8", "int8", "uint16", "int16"])
@pytest.mark.parametrize("bits", range(1, 9))
def test_the_full_range_of_integers_does_not_wrap(dtype: str, bits: int) -> None:
    info = np.iinfo(dtype)
    array = np.array([info.min, info.max, 0, info.max - 1, info.min + 1], dtype).reshape(1, 1, 5)
    codec = S3dc(bits=bits)
    error = metrics.max_error(array, round_trip(codec, array))
    assert error <= codec.error_bound(array) <= (int(info.max) - int(info.min)) / 2 + 1


def test_a_constant_block_is_exact(dtype: Any) -> None:
    for value in (0, 1, 97):
        array = np.full((3, 9, 65), value, dtype)
        codec = S3dc(bits=1)
        assert codec.error_bound(array) == 0
        np.testing.assert_array_equal(round_trip(codec, array), array)


@pytest.mark.parametrize("bits", range(1, 9))
def test_ranges_wider_than_float32_can_hold(bits: int) -> None:
    array = np.array([-FLOAT_MAX, FLOAT_MAX, 0, 1, -1e38], np.float32).reshape(1, 1, 5)
    codec = S3dc(bits=bits)
    decoded = round_trip(codec, array)
    assert np.isfinite(decoded).all()
    assert (decoded[0, 0, 0], decoded[0, 0, 1]) == (-FLOAT_MAX, FLOAT_MAX)
    assert metrics.max_error(array, decoded) <= codec.error_bound(array) < math.inf


def test_denormal_samples_keep_their_order_and_bound() -> None:
    array = (np.arange(8, dtype=np.float32) * FLOAT_TINY).reshape(1, 1, 8)
    assert np.count_nonzero(array) == 7
    np.testing.assert_array_equal(round_trip(S3dc(bits=3), array), array)


def test_a_maximum_far_smaller_than_the_minimum_is_not_exceeded() -> None:
    """max − min is rounded to −min here, so only the clamp keeps the result from being 0."""
    array = np.array([-1e30, -1e-30], np.float32).reshape(1, 1, 2)
    np.testing.assert_array_equal(round_trip(S3dc(bits=1), array), array)


@pytest.mark.parametrize("codec", [S3dc(), S3dc(max_error=0), S3dc(bits=2, fitted=True)], ids=str)
def test_the_caller_may_say_what_replaces_voxels_that_are_not_finite(codec: S3dc) -> None:
    """And one NaN does not spoil the end points of its block."""
    array = np.linspace(-3, 5, 60, dtype=np.float32).reshape(3, 4, 5)
    array[0, 1, 2], array[1, 0, 0], array[2, 3, 4] = np.nan, np.inf, -np.inf
    clean = np.where(np.isfinite(array), array, np.float32(-1))
    assert codec.encode(array, replace_nonfinite=-1) == codec.encode(clean)
    with pytest.raises(InvalidInputError, match="replace_nonfinite is nan"):
        codec.encode(array, replace_nonfinite=math.nan)
    integers = np.arange(8, dtype=np.int16).reshape(2, 2, 2)
    assert codec.encode(integers, replace_nonfinite=5) == codec.encode(integers)


def test_negative_zero_decodes_as_zero() -> None:
    array = np.array([-0.0, 0.0, -0.0], np.float32).reshape(1, 1, 3)
    decoded = round_trip(S3dc(), array)
    assert not decoded.any()
    assert not np.signbit(decoded).any()


@given(codecs, hnp.array_shapes(min_dims=3, max_dims=3, max_side=70),
       st.sampled_from(["uint8", "int16", "float32"]))  # fmt: skip
def test_sizes_are_those_of_the_layout(
    codec: S3dc, shape: tuple[int, int, int], dtype: str
) -> None:
    blocks = math.prod(-(-n // b) for n, b in zip(shape, codec.block, strict=True))
    end_points_nbytes = 2 * blocks * np.dtype(dtype).itemsize
    rows_nbytes = shape[0] * shape[1] * 2 * math.ceil(shape[2] * codec.bits / 16)
    assert codec.end_points_nbytes(shape, dtype) == end_points_nbytes
    assert codec.encoded_nbytes(shape, dtype) == end_points_nbytes + rows_nbytes


def test_blocks_larger_than_any_volume_are_one_block(noise: Any) -> None:
    array = noise((3, 4, 5), "uint16")
    huge, whole = S3dc((2**40, 2**62, 2**33)), S3dc((3, 4, 5))
    assert huge.encode(array) == whole.encode(array)
    np.testing.assert_array_equal(round_trip(huge, array), round_trip(whole, array))


def test_many_threads_share_one_codec(noise: Any) -> None:
    arrays = [noise((16, 16, 80), "uint16", seed) for seed in range(24)]
    codec = S3dc()
    expected = [codec.encode(a) for a in arrays]
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(codec.encode, arrays)) == expected


def test_a_codec_is_an_immutable_value() -> None:
    assert S3dc() == S3dc(block=(8, 8, 8), bits=4)
    assert hash(S3dc([4, 4, 4], 2)) == hash(S3dc((4, 4, 4), np.uint8(2)))  # type: ignore[arg-type]
    with pytest.raises(FrozenInstanceError):
        S3dc().bits = 2  # type: ignore[misc]
