"""Samples from a code with a width per block are those of the decoded volume, to the bit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from octobrick.codec import S3dc, S3dcSampler, _native
from octobrick.codec import reference_sampling as reference
from octobrick.codec.arrays import SAMPLE_DTYPES
from octobrick.codec.errors import CorruptBrickError, InvalidInputError, UnsupportedError

from .generated import blocks, volumes

NEAREST = _native.Sampling.NEAREST
TRILINEAR = _native.Sampling.TRILINEAR
SHARED = _native.Sampling.TRILINEAR_SHARED

Array = NDArray[Any]
Zyx = tuple[int, int, int]


def native_sampler(
    codec: S3dc, code: bytes, shape: tuple[int, ...], dtype: Any, *, simd: bool = True
) -> _native.S3dcSampler:
    number = SAMPLE_DTYPES.index(np.dtype(dtype))
    nz, ny, nx = shape
    return _native.S3dcSampler(code, (nz, ny, nx), number, codec.block, codec.bits, simd)


def centres_of(shape: tuple[int, ...]) -> Array:
    """The centre (x, y, z) of every voxel, in memory order."""
    return np.ascontiguousarray(np.indices(shape).reshape(3, -1).T[:, ::-1] + 0.5)


def bits_of(samples: Array) -> Array:
    """Floats as integers, so that zeros of either sign differ."""
    return np.ascontiguousarray(samples, np.float32).view(np.uint32)


def all_widths(dtype: Any, widths: range) -> tuple[S3dc, Array]:
    """A codec, and a volume with a block of 4³ voxels for each of these widths, or one near it."""
    dtype = np.dtype(dtype)
    least = np.iinfo(dtype).min if dtype.kind != "f" else 0
    array = np.zeros((4, 4, 4 * len(widths)), dtype)
    rng = np.random.default_rng(1)
    for k, width in enumerate(widths):
        values = rng.integers(0, 2**width, 64)
        values[:2] = 0, 2**width - 1
        array[..., 4 * k : 4 * k + 4] = (values + least).astype(dtype).reshape(4, 4, 4)
    return S3dc((4, 4, 4), max_error=0.4 if dtype.kind == "f" else 0), array


# ---- Equal to the reference ----------------------------------------------------------------


@st.composite
def codes(draw: st.DrawFn, most_voxels: int = 6000) -> tuple[S3dc, Array, bytes]:
    """Codes of any volume by any rule, with blocks from constant to raw, cut at the faces."""
    array, block = draw(volumes(most_voxels)), draw(blocks)
    reach = float(array.max()) - float(array.min())
    error = draw(st.sampled_from([0.0, 1e-4, 0.01, 0.2])) * reach
    # The least budget of a block of one voxel: twice a float32, a byte of tables, and padding.
    rules: list[dict[str, float]] = [{"max_error": error}, {"bits_per_voxel": 200}, {"slope": 0.5}]
    codec = S3dc(block, **draw(st.sampled_from(rules)))  # type: ignore[arg-type]
    return codec, array, codec.encode(array)


@st.composite
def points(draw: st.DrawFn) -> Array:
    """Points anywhere: between voxels, on centres and faces, far away, infinite, or not numbers."""
    width = draw(st.sampled_from([32, 64]))
    near = st.floats(-2, 72, width=width)
    halves = st.integers(-3, 144).map(lambda k: k / 2)
    coordinate = st.one_of(near, halves, st.floats(width=width))
    rows = draw(st.lists(st.tuples(coordinate, coordinate, coordinate), max_size=40))
    return np.array(rows, f"float{width}").reshape(-1, 3)


@given(codes(), points(), st.booleans(), st.integers(0, 999))
@settings(max_examples=300, deadline=None)
def test_every_sample_is_the_references_to_the_bit(
    case: tuple[S3dc, Array, bytes], at: Array, simd: bool, seed: int
) -> None:
    codec, array, code = case
    shape: Any = array.shape
    fetch = reference.fetch_from(codec.decode(code, shape, array.dtype))
    inside = np.random.default_rng(seed).uniform(-1, np.array(shape[::-1]) + 1, (100, 3))
    at = np.concatenate([at, inside.astype(at.dtype)])
    sampler = native_sampler(codec, code, shape, array.dtype, simd=simd)
    samples = np.empty((3, len(at)), np.float32)
    for how, out in zip((NEAREST, TRILINEAR, SHARED), samples, strict=True):
        sampler.sample(how, at, out)
    nearest = reference.nearest(fetch, shape, at).astype(np.float32)
    between = reference.trilinear(fetch, shape, at).astype(np.float32)
    np.testing.assert_array_equal(samples, [nearest, between, between])
    np.testing.assert_array_equal(bits_of(samples[1]), bits_of(samples[2]))
    spacing = (0.5, 2.0, 3.0)
    slopes = reference.gradient(fetch, shape, at, spacing)
    if np.all(np.isnan(slopes) | (np.abs(slopes) < 3e38)):
        for how in (TRILINEAR, SHARED):
            vectors = np.empty((len(at), 3), np.float32)
            sampler.gradient(how, at, spacing, vectors)
            np.testing.assert_array_equal(vectors, slopes.astype(np.float32))


@given(codes())
@settings(max_examples=100, deadline=None)
def test_every_voxel_is_decoded_as_decode_does(case: tuple[S3dc, Array, bytes]) -> None:
    codec, array, code = case
    decoded = codec.decode(code, array.shape, array.dtype).astype(np.float32).ravel()
    sampler = S3dcSampler(codec, code, array.shape, array.dtype)
    centres = centres_of(array.shape)
    np.testing.assert_array_equal(bits_of(sampler.nearest(centres)), bits_of(decoded))
    for shared in (False, True):
        found = sampler.trilinear(centres, shared=shared)
        np.testing.assert_array_equal(found, decoded)


@pytest.mark.parametrize("simd", [False, True])
def test_every_width_and_raw_blocks_beside_each_other_are_sampled(
    dtype: np.dtype[Any], simd: bool
) -> None:
    codec, array = all_widths(dtype, range(9 if dtype.itemsize == 1 else 17))
    code = codec.encode(array)
    widths = codec.block_widths(code, array.shape, dtype).ravel().tolist()
    if dtype.kind == "f":
        assert {0, 14, 32} <= set(widths)
        assert len(set(widths)) > 10
    else:
        assert widths == (list(range(9)) if dtype.itemsize == 1 else [*range(15), 16, 16])
    sampler = native_sampler(codec, code, array.shape, dtype, simd=simd)
    fetch = reference.fetch_from(codec.decode(code, array.shape, dtype))
    at = np.random.default_rng(3).uniform(-1, np.array(array.shape[::-1]) + 1, (5000, 3))
    expected = reference.trilinear(fetch, array.shape, at).astype(np.float32)  # type: ignore[arg-type]
    for how in (TRILINEAR, SHARED):
        found = np.empty(len(at), np.float32)
        sampler.sample(how, at, found)
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("kind", ["uint8", "int8", "uint16", "int16", "float32"])
def test_every_index_between_any_levels_is_decoded_as_decode_does(kind: str) -> None:
    """Levels of a code are replaced by all pairs of some; indices of its blocks are all there."""
    dtype = np.dtype(kind)
    codec, array = all_widths(kind, range(9 if dtype.itemsize == 1 else 17))
    code = bytearray(codec.encode(array))
    widths = codec.block_widths(code, array.shape, dtype).ravel()
    levels = [0.1, -0.0, 1e-45, -3.4e38, 3.4e38, 7]
    if dtype.kind != "f":
        info = np.iinfo(dtype)
        levels = [info.min, info.min + 1, info.max // 2, info.max - 1, info.max, 7]
    ends = np.frombuffer(code, dtype)[: 2 * len(widths)].reshape(-1, 2)
    coded = widths < 8 * dtype.itemsize if dtype.itemsize > 1 else widths < 9
    for low in levels:
        for high in levels:
            if low > high:
                continue
            ends[coded] = [low, high]
            decoded = codec.decode(code, array.shape, dtype).astype(np.float32).ravel()
            sampler = S3dcSampler(codec, code, array.shape, dtype)
            centres = centres_of(array.shape)
            np.testing.assert_array_equal(bits_of(sampler.nearest(centres)), bits_of(decoded))
            np.testing.assert_array_equal(sampler.trilinear(centres), decoded)


# ---- Borders, and points that are none -----------------------------------------------------


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 1, 9), (1, 9, 1), (9, 1, 1), (5, 1, 6)])
@pytest.mark.parametrize("error", [0, 1e9])
def test_points_outside_are_moved_to_the_nearest_centre(
    noise: Any, dtype: np.dtype[Any], shape: Zyx, error: float
) -> None:
    codec = S3dc((2, 3, 4), max_error=error)
    sampler = S3dcSampler(codec, codec.encode(noise(shape, dtype)), shape, dtype)
    at = np.random.default_rng(1).uniform(-3, np.array(shape[::-1]) + 3, (300, 3))
    at[:4] = [-np.inf, 0, 1e300], [np.inf] * 3, [-1e9] * 3, shape[::-1]
    inside = np.clip(at, 0.5, np.array(shape[::-1]) - 0.5)
    for shared in (False, True):
        found = sampler.trilinear(at, shared=shared)
        np.testing.assert_array_equal(found, sampler.trilinear(inside, shared=shared))


def test_only_points_with_a_nan_coordinate_have_nan_samples(
    noise: Any, dtype: np.dtype[Any]
) -> None:
    codec = S3dc((2, 2, 2), max_error=0)
    sampler = S3dcSampler(codec, codec.encode(noise((3, 4, 5), dtype)), (3, 4, 5), dtype)
    at = np.full((5, 3), 1.25)
    at[[0, 1, 2], [0, 1, 2]] = np.nan
    at[3] = np.inf
    wanted = [True] * 3 + [False] * 2
    assert np.isnan(sampler.nearest(at)).tolist() == wanted
    assert np.isnan(sampler.trilinear(at)).tolist() == wanted
    assert np.isnan(sampler.trilinear(at, shared=False)).tolist() == wanted
    assert np.isnan(sampler.gradient(at)).tolist() == [[row] * 3 for row in wanted]


# ---- What is fetched -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("point", "fetches"),
    [
        ((2, 2, 2), (1, 4)),  # in one block, and rows of 8 indices of 4 bits in one word each
        ((8, 2, 2), (2, 8)),
        ((2, 8, 8), (4, 4)),
        ((8, 8, 8), (8, 8)),
        ((-5, 99, 2), (1, 4)),
    ],
)
def test_a_block_is_looked_up_once_for_all_that_it_has_of_the_eight(
    point: Zyx, fetches: tuple[int, int]
) -> None:
    array = np.random.default_rng(1).integers(0, 16, (16, 16, 16)).astype(np.uint8)
    codec = S3dc((8, 8, 8), max_error=0)
    code = codec.encode(array)
    assert np.all(codec.block_widths(code, array.shape, np.uint8) == 4)
    sampler, at = native_sampler(codec, code, array.shape, np.uint8), np.array([point], float)
    assert sampler.count_fetches(NEAREST, at) == (1, 1)
    assert sampler.count_fetches(TRILINEAR, at) == (8, 8)
    assert sampler.count_fetches(SHARED, at) == fetches


def test_a_constant_block_has_no_words_to_fetch() -> None:
    codec = S3dc((4, 4, 4), max_error=0)
    code = codec.encode(np.full((4, 4, 4), 9, np.uint8))
    sampler, at = native_sampler(codec, code, (4, 4, 4), np.uint8), np.full((3, 3), 2.0)
    assert sampler.count_fetches(SHARED, at) == (3, 0)


# ---- What is refused -----------------------------------------------------------------------


@st.composite
def damaged(draw: st.DrawFn) -> tuple[S3dc, Array, bytes]:
    """Codes with bytes changed, cut off, or added: in tables more often than elsewhere."""
    codec, array, sound = draw(codes(most_voxels=1500))
    code = bytearray(sound)
    tables = st.integers(0, min(len(code) - 1, 200))
    for at in draw(st.lists(st.one_of(tables, st.integers(0, len(code) - 1)), max_size=4)):
        code[at] = draw(st.sampled_from([0, 1, 0x7F, 0x80, 0xFF, draw(st.integers(0, 255))]))
    cut = draw(st.sampled_from([0, 0, 0, 0, 1, len(code) // 2]))
    return codec, array, bytes(code[: len(code) - cut]) + bytes(draw(st.sampled_from([0, 0, 0, 4])))


@given(damaged())
@settings(max_examples=300, deadline=None)
def test_a_sampler_opens_what_decode_accepts_and_refuses_the_rest_as_it_does(
    case: tuple[S3dc, Array, bytes],
) -> None:
    codec, array, code = case
    fault = None
    try:
        decoded = codec.decode(code, array.shape, array.dtype)
    except CorruptBrickError as error:
        fault = error
    if fault is not None:
        with pytest.raises(CorruptBrickError) as caught:
            S3dcSampler(codec, code, array.shape, array.dtype)
        assert (caught.value.message, str(caught.value.facts)) == (fault.message, str(fault.facts))
        return
    sampler = S3dcSampler(codec, code, array.shape, array.dtype)
    expected = decoded.astype(np.float32).ravel()
    np.testing.assert_array_equal(sampler.nearest(centres_of(array.shape)), expected)


@pytest.mark.parametrize("kind", ["uint16", "float32"])
def test_of_two_faults_the_one_of_the_first_block_is_named(kind: str) -> None:
    """Raw voxels outside of their levels, and behind them levels out of order; then the reverse."""
    array = np.random.default_rng(1).integers(0, 65536, (4, 4, 12)).astype(kind)
    array += np.asarray(0.1, kind)
    codec, size = S3dc((4, 4, 4), max_error=0), array.itemsize
    code = bytearray(codec.encode(array))
    assert np.all(codec.block_widths(code, array.shape, kind) == 8 * size)
    code[2 * size : 4 * size] = np.array([0, 1], kind).tobytes()  # levels of block 1
    for block, said in ((2, r"uncoded block .* \(0, 0, 1\)"), (0, r"\(0, 0, 0\) has minimum")):
        code[2 * size * block : 2 * size * (block + 1)] = np.array([9, 8], kind).tobytes()
        for read in (codec.decode, lambda *a: S3dcSampler(codec, *a)):
            with pytest.raises(CorruptBrickError, match=said):
                read(code, array.shape, kind)


def test_bytes_that_change_meanwhile_give_other_samples_and_no_crash(dtype: np.dtype[Any]) -> None:
    codec, array = all_widths(dtype, range(9 if dtype.itemsize == 1 else 16))
    code = bytearray(codec.encode(array))
    sampler = S3dcSampler(codec, code, array.shape, dtype)
    at = np.random.default_rng(1).uniform(-1, np.array(array.shape[::-1]) + 1, (500, 3))
    before = sampler.trilinear(at)
    for fill in (np.random.default_rng(2).bytes(len(code)), b"\xff" * len(code)):
        code[:] = fill
        for found in (sampler.nearest(at), sampler.trilinear(at), sampler.gradient(at)[:, 0]):
            assert not np.array_equal(found, before)


def test_codes_with_a_prediction_and_with_trained_scales_are_not_sampled(noise: Any) -> None:
    array = noise((8, 8, 8), "uint8")
    codec = S3dc((4, 4, 4), max_error=1)
    with pytest.raises(CorruptBrickError):
        S3dcSampler(codec, codec.encode(array, prediction=array), array.shape, array.dtype)
    trained = S3dc((4, 4, 4), 2, scale="trained")
    with pytest.raises(UnsupportedError, match="linear scale"):
        S3dcSampler(trained, trained.encode(array), array.shape, array.dtype)


def test_the_longest_axis_is_sampled_at_its_end_and_a_longer_one_is_refused() -> None:
    longest = 2**31 - 1
    codec = S3dc((1, 1, 2**40), max_error=0)
    code = bytes([7, 7, 0, 0]) + bytes(8)  # a block of width 0, and so no payload
    assert codec.encode(np.full((1, 1, 5), 7, np.uint8)) == code
    with pytest.raises(InvalidInputError, match="2147483647"):
        S3dcSampler(codec, code, (1, 1, longest + 1), "uint8")
    sampler = S3dcSampler(codec, code, (1, 1, longest), "uint8")
    at = np.array([[longest - 0.5, 0.5, 0.5], [longest / 2, 1, 1], [0, 0, 0]])
    assert sampler.nearest(at).tolist() == sampler.trilinear(at).tolist() == [7, 7, 7]
