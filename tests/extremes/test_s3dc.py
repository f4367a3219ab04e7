"""S3Dc at the extremes: the bound of each block, in numpy, in C++ and in shaders."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from octobrick.codec import S3dc, _native, metrics, reference_deblock
from octobrick.codec.errors import InvalidInputError, NotFiniteError, UnsupportedError

from .table import holds
from .ways_to_code import TYPES, S3dcWay

INTEGERS = ["uint8", "int8", "uint16", "int16"]
THIN = [(1, 1, 1), (1, 1, 9), (1, 7, 1), (2, 1, 1), (1, 5, 18)]
UNEVEN = [(9, 13, 11), (2, 49, 3), (1, 3, 17)]
FLOAT_MAX = np.finfo(np.float32).max
TINY = np.finfo(np.float32).smallest_subnormal


def require_bound(way: S3dcWay, array: NDArray[Any], codec: S3dc) -> NDArray[Any]:
    """|error| <= R/(2L) in every block, + 1/2 for integers, or one rounding to float32."""
    decoded = way.round_trip(array, codec)
    assert decoded.shape == array.shape
    assert codec.bits is not None
    wide, levels = array.astype(np.float64), 2**codec.bits - 1
    ranges = reference_deblock.block_ranges(wide, codec.block)
    if array.dtype.kind == "f":
        ends = max(abs(wide.min()), abs(wide.max()))
        bound = ranges / (2 * levels) + np.where(ranges > 0, 2.0**-24 * ends + TINY, 0)
    else:
        bound = np.where(ranges <= levels, 0, np.floor(ranges / (2 * levels) + 0.5))
    error = np.abs(decoded.astype(np.float64) - wide)
    assert (error <= bound + way.slack(array)).all()
    assert error.max() <= codec.error_bound(array) + way.slack(array)
    return decoded


# ---- Shapes ----------------------------------------------------------------------------------


@pytest.mark.parametrize("codec", [S3dc(), S3dc(max_error=1), S3dc(bits_per_voxel=2)], ids=str)
@holds("s3dc", "empty-input", "cpp")
def test_no_voxels_are_refused_with_their_shape(implementation: str, codec: S3dc) -> None:
    for shape in ((0, 4, 4), (4, 0, 4), (4, 4, 0), (0,)):
        with pytest.raises(InvalidInputError) as caught:
            codec.encode(np.empty(shape, np.uint8))
        assert str(shape) in caught.value.message
    with pytest.raises(InvalidInputError, match="shape"):
        codec.decode(b"", (0, 4, 4), np.uint8)


@holds("s3dc", "one-voxel", "numpy", "cpp", "glsl", "direct")
def test_less_than_a_block_has_the_ends_of_the_voxels_that_exist(s3dc: S3dcWay, noise: Any) -> None:
    for shape, dtype in itertools.product(THIN, s3dc.types[::2]):
        array = noise(shape, dtype)
        decoded = require_bound(s3dc, array, S3dc(bits=2))
        slack = s3dc.slack(array)
        assert abs(float(decoded.min()) - float(array.min())) <= slack
        assert abs(float(decoded.max()) - float(array.max())) <= slack


@pytest.mark.parametrize("bits", [1, 8])
@holds("s3dc", "uneven", "numpy", "cpp", "glsl", "direct")
def test_a_block_at_the_face_has_the_range_of_the_voxels_that_exist(
    s3dc: S3dcWay, noise: Any, bits: int
) -> None:
    """Were it padded, by zeros for one, its ends would not be those of its voxels."""
    for shape, dtype in zip(UNEVEN, ("uint8", "int16", "float32"), strict=True):
        array = noise(shape, dtype)
        if dtype == "uint8":
            array = array // 2 + np.uint8(90)  # away from 0
        decoded, slack = require_bound(s3dc, array, S3dc(bits=bits)), s3dc.slack(array)
        for start in np.ndindex(*(-(-n // 8) for n in shape)):
            block = tuple(slice(8 * s, 8 * s + 8) for s in start)
            for end in (np.min, np.max):
                assert abs(float(end(decoded[block])) - float(end(array[block]))) <= slack


# ---- Values ----------------------------------------------------------------------------------


@holds("s3dc", "constant", "numpy", "cpp", "glsl", "direct")
def test_blocks_of_one_value_are_exact(s3dc: S3dcWay) -> None:
    for dtype in s3dc.types:
        values = [np.iinfo(dtype).min, np.iinfo(dtype).max] if dtype in INTEGERS else [-3.4e38, 0.1]
        for value in values:
            array = np.full((2, 8, 10), value, dtype)
            decoded = s3dc.round_trip(array, S3dc(bits=4)).astype(np.float64)
            # A picture of one value spans a window that is 2 wide, or two steps of float32.
            slack = 2 * s3dc.rounding * max(1.0, abs(float(value)) * 2.0**-23)
            assert np.abs(decoded - array.astype(np.float64)).max() <= slack
        array[1, 2, 3] = values[0]  # and beside it a block that varies
        decoded = s3dc.round_trip(array, S3dc(bits=4))
        off = np.abs(decoded[:, :, 8:].astype(np.float64) - float(array[0, 0, 9]))
        assert off.max() <= s3dc.slack(array)


@pytest.mark.parametrize("bits", [1, 4, 7])
@holds("s3dc", "full-range", "numpy", "cpp", "glsl", "direct")
def test_the_whole_range_of_a_type_does_not_wrap(s3dc: S3dcWay, noise: Any, bits: int) -> None:
    for dtype in set(s3dc.types) & set(INTEGERS):
        array, info = noise((2, 8, 16), dtype), np.iinfo(dtype)
        decoded = require_bound(s3dc, array, S3dc(bits=bits))
        slack = s3dc.slack(array)
        assert abs(float(decoded.flat[0]) - info.min) <= slack
        assert abs(float(decoded.flat[-1]) - info.max) <= slack


@pytest.mark.parametrize("dtype", ["uint32", "int32", "uint64", "int64", "float64"])
@holds("s3dc", "wide-integers", "cpp")
def test_wider_types_are_refused_by_name(implementation: str, dtype: str) -> None:
    top = np.iinfo(dtype).max if dtype[0] in "ui" else 1e300
    with pytest.raises(UnsupportedError, match=dtype):
        S3dc().encode(np.full((8, 8, 8), top, dtype))
    with pytest.raises(UnsupportedError, match=dtype):
        S3dc().decode(b"\0" * 1000, (8, 8, 8), dtype)


@pytest.mark.parametrize("bits", [1, 4, 8])
@holds("s3dc", "greatest-floats", "numpy", "cpp", "glsl", "direct")
def test_a_range_beyond_float32_keeps_its_ends_and_its_bound(s3dc: S3dcWay, bits: int) -> None:
    rng = np.random.default_rng(2)
    array = (rng.uniform(-1, 1, (2, 8, 16)) * FLOAT_MAX).astype(np.float32)
    array[0, 0, 0], array[0, 0, 1] = -FLOAT_MAX, FLOAT_MAX
    decoded = require_bound(s3dc, array, S3dc(bits=bits))
    assert np.isfinite(decoded).all()
    slack = s3dc.slack(array)
    assert abs(float(decoded[0, 0, 0]) + float(FLOAT_MAX)) <= slack
    assert abs(float(decoded[0, 0, 1]) - float(FLOAT_MAX)) <= slack


@pytest.mark.parametrize("bits", [1, 3, 8])
@holds("s3dc", "denormals", "numpy", "cpp", "glsl")
def test_denormals_keep_their_order_and_their_bound(s3dc: S3dcWay, bits: int) -> None:
    """On a GPU that flushes to zero the shader's row is a known limitation: docs/limitations.md."""
    steps = np.arange(8 * 8 * 8).reshape(8, 8, 8) % 8
    array = (steps * np.float64(TINY)).astype(np.float32)
    decoded = require_bound(s3dc, array, S3dc(bits=bits)).astype(np.float64)
    assert decoded.min() == 0
    assert abs(decoded.max() - 7 * float(TINY)) <= float(TINY) / 2
    if bits == 8:
        np.testing.assert_array_equal(np.rint(decoded / float(TINY)), steps)


@holds("s3dc", "signed-zero", "numpy", "cpp", "glsl")
def test_minus_zero_is_zero(s3dc: S3dcWay) -> None:
    array = np.where(np.indices((8, 8, 8)).sum(axis=0) % 2, np.float32(-0.0), np.float32(0.0))
    decoded = s3dc.round_trip(array, S3dc(bits=2))
    np.testing.assert_array_equal(decoded, 0)
    assert not np.signbit(decoded).any()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@holds("s3dc", "not-finite", "cpp")
def test_what_is_not_finite_is_named_or_replaced_and_poisons_nothing(
    implementation: str, noise: Any, bad: float
) -> None:
    array = noise((8, 8, 24), "float32")
    array[3, 4, 5] = bad
    for codec in (S3dc(bits=4), S3dc(max_error=0.5), S3dc(bits_per_voxel=3)):
        with pytest.raises(NotFiniteError) as caught:
            codec.encode(array)
        assert "(3, 4, 5)" in caught.value.message
        code = codec.encode(array, replace_nonfinite=0.0)
        decoded = codec.decode(code, array.shape, array.dtype)
        clean = np.where(np.isfinite(array), array, np.float32(0))
        assert np.isfinite(decoded).all()
        assert metrics.max_error(clean, decoded) <= codec.error_bound(clean)


@pytest.mark.parametrize("bits", [1, 4, 8])
@holds("s3dc", "tiny-range", "numpy", "cpp", "glsl")
def test_a_range_of_a_few_steps_on_a_large_offset_keeps_its_bound(s3dc: S3dcWay, bits: int) -> None:
    rng = np.random.default_rng(3)
    for deviation in (1e-3, 8.0, 40.0):  # float32 steps by 8 there
        array = (1e8 + rng.normal(size=(9, 10, 11)) * deviation).astype(np.float32)
        decoded = require_bound(s3dc, array, S3dc(bits=bits))
        if deviation < 1:
            np.testing.assert_array_equal(decoded, np.float32(1e8))


# ---- Parameters ------------------------------------------------------------------------------


@holds("s3dc", "one-bit", "numpy", "cpp", "glsl", "direct")
def test_one_bit_has_the_ends_of_each_block_and_nothing_between(s3dc: S3dcWay, noise: Any) -> None:
    for dtype, part in itertools.product(s3dc.types, (np.s_[..., :8], np.s_[..., 8:])):
        array = noise((2, 8, 16), dtype)
        decoded, slack = require_bound(s3dc, array, S3dc(bits=1)), s3dc.slack(array)
        before, after = array[part].astype(np.float64), decoded[part].astype(np.float64)
        low, high = before.min(), before.max()
        upper = before > (low + high) / 2
        assert np.abs(after[upper] - high).max() <= slack
        lower = before < (low + high) / 2
        assert np.abs(after[lower] - low).max() <= slack


@holds("s3dc", "one-bit", "numpy", "cpp", "glsl", "direct")
def test_one_bit_of_all_256_values_is_off_by_less_than_128(s3dc: S3dcWay) -> None:
    """Equation 6 of the paper has ceil(127.5); the voxels themselves come to 127."""
    every = np.arange(256, dtype=np.uint8).reshape(1, 16, 16)
    codec = S3dc((1, 16, 16), 1)
    assert codec.error_bound(every) == 128
    decoded = s3dc.round_trip(every, codec).astype(np.float64)
    assert abs(np.abs(decoded - every).max() - 127) <= s3dc.slack(every)


@holds("s3dc", "eight-bits", "numpy", "cpp", "glsl", "direct")
def test_eight_bits_keep_8_bit_samples_exactly(s3dc: S3dcWay, noise: Any) -> None:
    for dtype in set(s3dc.types) & {"uint8", "int8"}:
        array = noise((3, 9, 20), dtype)
        decoded = s3dc.round_trip(array, S3dc(bits=8)).astype(np.float64)
        assert np.abs(decoded - array).max() <= s3dc.slack(array)


@pytest.mark.parametrize("dtype", TYPES)
@holds("s3dc", "bounds", "numpy", "cpp", "glsl")
def test_a_bound_of_nothing_is_lossless_and_none_is_ever_exceeded(
    s3dc: S3dcWay, noise: Any, dtype: str
) -> None:
    array = noise((8, 8, 24), dtype)
    array[:, :, 8:16] = array[0, 0, 8]
    wide, reach = array.astype(np.float64), float(np.ptp(array.astype(np.float64)))
    for bound in (0.0, reach / 1000, reach, 1e300):
        if dtype != "float32":
            bound = float(np.floor(bound))
        decoded = s3dc.round_trip(array, S3dc(max_error=bound)).astype(np.float64)
        assert np.abs(decoded - wide).max() <= bound + s3dc.slack(array)
    assert len(S3dc(max_error=1e300).encode(array)) < len(S3dc(max_error=0).encode(array)) / 8


# ---- Paths -----------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", TYPES)
@holds("s3dc", "threads-and-instructions", "cpp")
def test_neither_threads_nor_instructions_change_a_bit(
    implementation: str, noise: Any, dtype: str
) -> None:
    array, block = noise((17, 19, 70), dtype), (8, 8, 8)
    for bits in (1, 3, 8):
        plain = _native.encode(array, block, bits, 1, False)
        assert isinstance(plain, bytes)
        wanted = np.empty_like(array)
        _native.decode_into(plain, wanted, block, bits, 1, False)
        for threads, simd in ((1, True), (3, False), (7, True)):
            assert _native.encode(array, block, bits, threads, simd) == plain
            found = np.empty_like(array)
            _native.decode_into(plain, found, block, bits, threads, simd)
            assert found.tobytes() == wanted.tobytes()
    bound = _native.variable_encode(
        array, block, _native.WidthRule.BOUND, 3.0, False, None, 1, False
    )
    for threads, simd in ((1, True), (5, True)):
        again = _native.variable_encode(
            array, block, _native.WidthRule.BOUND, 3.0, False, None, threads, simd
        )
        assert again == bound
