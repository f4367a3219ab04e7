"""Samples straight from an S3Dc code are those of the decoded volume, to the bit."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from octobrick.codec import S3dc, S3dcSampler, _native, gradients
from octobrick.codec import reference_sampling as reference
from octobrick.codec.arrays import SAMPLE_DTYPES
from octobrick.codec.errors import CorruptBrickError, InvalidInputError, UnsupportedError
from octobrick.codec.reference import pack_rows

NEAREST = _native.Sampling.NEAREST
TRILINEAR = _native.Sampling.TRILINEAR
SHARED = _native.Sampling.TRILINEAR_SHARED

Array = NDArray[Any]
Zyx = tuple[int, int, int]


def native_sampler(
    codec: S3dc, code: bytes, shape: Zyx, dtype: Any, *, simd: bool = True
) -> _native.S3dcSampler:
    number = SAMPLE_DTYPES.index(np.dtype(dtype))
    return _native.S3dcSampler(code, shape, number, codec.block, codec.bits, simd)


def centres_of(shape: Zyx) -> Array:
    """The centre (x, y, z) of every voxel, in memory order."""
    return np.ascontiguousarray(np.indices(shape).reshape(3, -1).T[:, ::-1] + 0.5)


def points_around(shape: Zyx, count: int = 500, seed: int = 1) -> Array:
    """Points (x, y, z) inside and a little outside."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-1.5, np.array(shape[::-1]) + 1.5, (count, 3))


# ---- Equal to the reference ----------------------------------------------------------------


@st.composite
def volumes(draw: st.DrawFn) -> tuple[S3dc, Array]:
    """Small arrays of any type, some with axes of length 1 and rows of many words."""
    shape = draw(st.tuples(st.integers(1, 6), st.integers(1, 6), st.integers(1, 40)))
    codec = S3dc(draw(st.tuples(*[st.integers(1, 9)] * 3)), draw(st.integers(1, 8)))
    dtype = draw(st.sampled_from(SAMPLE_DTYPES))
    rng = np.random.default_rng(draw(st.integers(0, 999)))
    if dtype.kind == "f":
        scale = draw(st.sampled_from([1e-44, 1.0, 1e37]))
        return codec, (rng.normal(size=shape) * scale).astype(dtype)
    info = np.iinfo(dtype)
    return codec, rng.integers(info.min, info.max, shape, dtype, endpoint=True)


@st.composite
def points(draw: st.DrawFn, width: int) -> Array:
    """Points anywhere: between voxels, on centres and faces, far away, infinite, or not numbers."""
    near = st.floats(-2, 42, width=width)
    halves = st.integers(-3, 84).map(lambda k: k / 2)
    coordinate = st.one_of(near, halves, st.floats(width=width))
    rows = draw(st.lists(st.tuples(coordinate, coordinate, coordinate), max_size=40))
    return np.array(rows, f"float{width}").reshape(-1, 3)


@given(volumes(), st.one_of(points(32), points(64)), st.booleans())
@settings(max_examples=300, deadline=None)
def test_every_sample_is_the_references_to_the_bit(
    volume: tuple[S3dc, Array], at: Array, simd: bool
) -> None:
    codec, array = volume
    code = codec.encode(array)
    fetch = reference.fetch_from(codec.decode(code, array.shape, array.dtype))
    sampler = native_sampler(codec, code, array.shape, array.dtype, simd=simd)
    samples = np.empty((3, len(at)), np.float32)
    for how, out in zip((NEAREST, TRILINEAR, SHARED), samples, strict=True):
        sampler.sample(how, at, out)
    nearest = reference.nearest(fetch, array.shape, at).astype(np.float32)
    between = reference.trilinear(fetch, array.shape, at).astype(np.float32)
    np.testing.assert_array_equal(samples, [nearest, between, between])
    spacing = (0.5, 2.0, 3.0)
    slopes = reference.gradient(fetch, array.shape, at, spacing)
    if np.all(np.isnan(slopes) | (np.abs(slopes) < 3e38)):  # longer ones are scaled: below
        for how in (TRILINEAR, SHARED):
            vectors = np.empty((len(at), 3), np.float32)
            sampler.gradient(how, at, spacing, vectors)
            np.testing.assert_array_equal(vectors, slopes.astype(np.float32))


@pytest.mark.parametrize("bits", range(1, 9))
@pytest.mark.parametrize("block", [(1, 1, 1), (4, 4, 4), (3, 5, 7), (64, 64, 64)])
def test_every_voxel_is_decoded_as_decode_does(
    noise: Any, dtype: np.dtype[Any], bits: int, block: Zyx
) -> None:
    array = noise((5, 7, 67), dtype)
    codec = S3dc(block, bits)
    code = codec.encode(array)
    decoded = codec.decode(code, array.shape, dtype).astype(np.float32).ravel()
    sampler, centres = S3dcSampler(codec, code, array.shape, dtype), centres_of(array.shape)
    np.testing.assert_array_equal(sampler.nearest(centres), decoded)
    np.testing.assert_array_equal(sampler.trilinear(centres), decoded)
    np.testing.assert_array_equal(sampler.trilinear(centres, shared=False), decoded)


@pytest.mark.parametrize("bits", [1, 2, 7, 8])
@pytest.mark.parametrize("simd", [False, True])
@pytest.mark.parametrize("kind", ["uint8", "int8", "uint16", "int16"])
def test_every_range_and_index_is_decoded_as_decode_does(bits: int, simd: bool, kind: str) -> None:
    """A row is a block: its ends are a range, its indices are all there are."""
    dtype, levels = np.dtype(kind), 2**bits - 1
    top = 2 ** (8 * dtype.itemsize) - 1
    extents = np.unique(np.r_[0:256, top - 255 : top + 1, 0 : top + 1 : 37])
    low = np.iinfo(dtype).min + np.minimum(top - extents, 100)
    rows = np.stack([low, low + extents], 1).astype(dtype)
    codec, shape = S3dc((1, 1, levels + 1), bits), (len(extents), 1, levels + 1)
    indices = np.broadcast_to(np.arange(levels + 1, dtype=np.uint8), shape)
    code = rows.tobytes() + pack_rows(indices, bits)
    decoded = codec.decode(code, shape, dtype)
    assert decoded[..., -1].tolist() == rows[:, 1:].tolist()
    sampler = native_sampler(codec, code, shape, dtype, simd=simd)
    for how in (NEAREST, TRILINEAR, SHARED):
        samples = np.empty(decoded.size, np.float32)
        sampler.sample(how, centres_of(shape), samples)
        np.testing.assert_array_equal(samples, decoded.astype(np.float32).ravel())


@pytest.mark.parametrize("block", [(4, 4, 4), (3, 2, 5)])
def test_trilinear_is_the_weighted_mean_of_eight_decoded_voxels(
    noise: Any, dtype: np.dtype[Any], block: Zyx
) -> None:
    """By another formula than the reference has: blocks meet without a seam."""
    array = noise((9, 10, 21), dtype)
    codec = S3dc(block, 4)
    code = codec.encode(array)
    decoded = np.pad(codec.decode(code, array.shape, dtype).astype(np.float64), 1, mode="edge")
    at = np.random.default_rng(2).uniform(0, np.array(array.shape[::-1]), (2000, 3))
    cell = np.floor(at + 0.5).astype(int)  # of the padded volume
    part, expected = at + 0.5 - cell, np.zeros(len(at))
    for dz, dy, dx in np.ndindex(2, 2, 2):
        weight = np.prod(np.where([dx, dy, dz], part, 1 - part), axis=1)
        expected += weight * decoded[cell[:, 2] + dz, cell[:, 1] + dy, cell[:, 0] + dx]
    found = S3dcSampler(codec, code, array.shape, dtype).trilinear(at)
    largest = np.abs(decoded).max()
    np.testing.assert_allclose(found, expected, rtol=2.0**-24, atol=2.0**-48 * largest)


def test_a_label_is_never_mixed_with_another() -> None:
    """In blocks of a narrow range S3Dc is lossless, and so is a nearest sample: claim S27."""
    labels = np.random.default_rng(3).integers(0, 11, (12, 13, 14)).astype(np.uint8)
    codec = S3dc((8, 8, 8), 4)
    sampler = S3dcSampler(codec, codec.encode(labels), labels.shape, labels.dtype)
    at = points_around(labels.shape)
    z, y, x = np.clip(np.floor(at).T[::-1], 0, np.array(labels.shape)[:, None] - 1).astype(int)
    np.testing.assert_array_equal(sampler.nearest(at), labels[z, y, x])


# ---- Borders, and points that are none -----------------------------------------------------


@pytest.mark.parametrize(
    "shape", [(1, 1, 1), (1, 1, 9), (1, 9, 1), (9, 1, 1), (5, 1, 6), (4, 5, 6)]
)
def test_points_outside_are_moved_to_the_nearest_centre(
    noise: Any, dtype: np.dtype[Any], shape: Zyx
) -> None:
    array = noise(shape, dtype)
    codec = S3dc((2, 3, 4), 5)
    sampler = S3dcSampler(codec, codec.encode(array), shape, dtype)
    at = points_around(shape)
    at[:9] = [-np.inf, 0, 1e300], [np.inf] * 3, [-np.inf] * 3, [-1e9] * 3, [1e9] * 3, [0] * 3, \
        [-0.0] * 3, [5e-324] * 3, shape[::-1]  # fmt: skip
    inside = np.clip(at, 0.5, np.array(shape[::-1]) - 0.5)
    for shared in (False, True):
        found = sampler.trilinear(at, shared=shared)
        np.testing.assert_array_equal(found, sampler.trilinear(inside, shared=shared))
    np.testing.assert_array_equal(
        sampler.nearest(at),
        sampler.nearest(np.floor(np.clip(at, 0, np.array(shape[::-1]) - 1))),
    )


def test_a_volume_of_one_voxel_is_that_voxel_everywhere(dtype: np.dtype[Any]) -> None:
    array, codec = np.full((1, 1, 1), 77, dtype), S3dc()
    sampler = S3dcSampler(codec, codec.encode(array), (1, 1, 1), dtype)
    at = points_around((1, 1, 1))
    for samples in (
        sampler.nearest(at),
        sampler.trilinear(at),
        sampler.trilinear(at, shared=False),
    ):
        np.testing.assert_array_equal(samples, np.full(len(at), 77, np.float32))
    np.testing.assert_array_equal(sampler.gradient(at), np.zeros((len(at), 3)))


@pytest.mark.parametrize("width", ["float32", "float64"])
@pytest.mark.parametrize("shape", [(3, 4, 5), (1, 1, 1)])
def test_only_points_with_a_nan_coordinate_have_nan_samples(
    noise: Any, dtype: np.dtype[Any], width: str, shape: Zyx
) -> None:
    codec = S3dc((2, 2, 2), 3)
    sampler = S3dcSampler(codec, codec.encode(noise(shape, dtype)), shape, dtype)
    at = np.full((6, 3), 1.25, width)
    at[[0, 1, 2], [0, 1, 2]] = np.nan
    at[3] = np.nan
    at[4] = np.inf
    wanted = [True] * 4 + [False] * 2
    assert np.isnan(sampler.nearest(at)).tolist() == wanted
    assert np.isnan(sampler.trilinear(at)).tolist() == wanted
    assert np.isnan(sampler.trilinear(at, shared=False)).tolist() == wanted
    assert np.isnan(sampler.gradient(at)).tolist() == [[row] * 3 for row in wanted]


def test_no_points_have_no_samples() -> None:
    codec = S3dc()
    sampler = S3dcSampler(codec, codec.encode(np.ones((2, 2, 2), np.uint8)), (2, 2, 2), np.uint8)
    none = np.empty((0, 3))
    assert sampler.nearest(none).shape == sampler.trilinear(none).shape == (0,)
    assert sampler.gradient(none).shape == (0, 3)


# ---- Gradients -----------------------------------------------------------------------------


def test_gradients_at_inner_centres_are_central_differences(
    noise: Any, dtype: np.dtype[Any]
) -> None:
    array, codec, spacing = noise((6, 7, 9), dtype), S3dc((4, 4, 4), 6), (1.5, 0.5, 0.25)
    code = codec.encode(array)
    decoded = codec.decode(code, array.shape, dtype)
    expected = gradients.central_differences(decoded, spacing)
    sampler = S3dcSampler(codec, code, array.shape, dtype)
    found = sampler.gradient(centres_of(array.shape), spacing).reshape(expected.shape)
    inner = (slice(1, -1),) * 3
    np.testing.assert_array_equal(found[inner], expected[inner])
    # At a face the shader's clamping halves the one-sided difference across it, and no other.
    np.testing.assert_array_equal(2 * found[0, 1:-1, 1:-1, 2], expected[0, 1:-1, 1:-1, 2])
    np.testing.assert_array_equal(found[0, 1:-1, 1:-1, :2], expected[0, 1:-1, 1:-1, :2])


def test_a_ramp_has_its_slope_between_voxels_in_world_units() -> None:
    z, y, x = np.indices((6, 7, 8))
    ramp = (x + 2 * y + 3 * z).astype(np.int16)
    codec = S3dc((2, 2, 2), 8)  # ranges of at most 6: lossless
    sampler = S3dcSampler(codec, codec.encode(ramp), ramp.shape, ramp.dtype)
    at = np.random.default_rng(5).uniform(1.5, np.array([8, 7, 6]) - 1.5, (200, 3))
    found = sampler.gradient(at, (1.5, 0.5, 0.25))
    np.testing.assert_allclose(found, np.broadcast_to([4, 4, 2], found.shape), rtol=1e-6)


def test_a_gradient_beyond_float32_keeps_its_direction() -> None:
    array = np.zeros((3, 3, 3), np.float32)
    array[1, 1, 2], array[1, 2, 1] = 3e38, -1.5e38
    codec = S3dc((1, 1, 1), 8)
    sampler = S3dcSampler(codec, codec.encode(array), array.shape, array.dtype)
    largest = float(np.finfo(np.float32).max)
    found = sampler.gradient(np.array([[1.5, 1.5, 1.5]]), (1e-9,) * 3)[0]
    np.testing.assert_allclose(found, [largest, -largest / 2, 0], rtol=1e-6)


# ---- What is refused -----------------------------------------------------------------------


@st.composite
def damaged_codes(draw: st.DrawFn) -> tuple[S3dc, Zyx, str, bytes]:
    """Codes with bytes changed, cut off, or added."""
    codec = S3dc(draw(st.tuples(*[st.integers(1, 5)] * 3)), draw(st.integers(1, 8)))
    shape = draw(st.tuples(st.integers(1, 4), st.integers(1, 4), st.integers(1, 70)))
    dtype = draw(st.sampled_from(SAMPLE_DTYPES)).name
    rng = np.random.default_rng(draw(st.integers(0, 99)))
    code = bytearray(codec.encode((rng.normal(size=shape) * 40).astype("int8").astype(dtype)))
    for at in draw(st.lists(st.integers(0, len(code) - 1), max_size=4)):
        code[at] = draw(st.integers(0, 255))
    kept = draw(st.sampled_from([len(code)] * 4 + [len(code) - 1, len(code) // 2, 0]))
    added = draw(st.sampled_from([0] * 4 + [1, 2]))
    return codec, shape, dtype, bytes(code[:kept]) + bytes(added)


@given(damaged_codes())
@settings(max_examples=300, deadline=None)
def test_a_sampler_opens_what_decode_accepts_and_refuses_the_rest_as_it_does(
    damaged: tuple[S3dc, Zyx, str, bytes],
) -> None:
    codec, shape, dtype, code = damaged
    fault = None
    try:
        decoded = codec.decode(code, shape, dtype)
    except CorruptBrickError as error:
        fault = error
    if fault is not None:
        with pytest.raises(CorruptBrickError) as caught:
            S3dcSampler(codec, code, shape, dtype)
        assert (caught.value.message, str(caught.value.facts)) == (fault.message, str(fault.facts))
        return
    sampler = S3dcSampler(codec, code, shape, dtype)
    expected = decoded.astype(np.float32).ravel()
    np.testing.assert_array_equal(sampler.nearest(centres_of(shape)), expected)


def test_bytes_that_change_meanwhile_give_other_samples_and_no_crash() -> None:
    array = np.random.default_rng(1).integers(0, 255, (9, 9, 70)).astype(np.uint16)
    codec = S3dc((4, 4, 4), 7)
    code = bytearray(codec.encode(array))
    sampler = S3dcSampler(codec, code, array.shape, array.dtype)
    before = sampler.trilinear(points_around(array.shape))
    code[:] = np.random.default_rng(2).bytes(len(code))
    assert not np.array_equal(sampler.trilinear(points_around(array.shape)), before)
    with pytest.raises(BufferError):  # nor can it be taken away
        code.clear()


def test_a_sampler_keeps_its_bytes_alive() -> None:
    array = np.full((4, 4, 4), 9, np.uint8)
    sampler = S3dcSampler(S3dc(), bytearray(S3dc().encode(array)), array.shape, array.dtype)
    assert sampler.nearest(np.ones((1, 3))).tolist() == [9]


@pytest.mark.parametrize("shape", [(3,), (4, 2), (2, 2, 3), (1, 4), ()])
def test_points_without_three_coordinates_are_refused(shape: tuple[int, ...]) -> None:
    sampler = S3dcSampler(S3dc(), S3dc().encode(np.ones((2, 2, 2), np.uint8)), (2, 2, 2), "uint8")
    for method in (sampler.nearest, sampler.trilinear, sampler.gradient):
        with pytest.raises(InvalidInputError, match=r"give \(n, 3\)") as caught:
            method(np.zeros(shape))
        assert caught.value.facts["shape"] == list(shape)


def test_points_of_another_type_are_refused_and_other_layouts_are_not() -> None:
    array = np.random.default_rng(1).integers(0, 255, (5, 6, 7)).astype(np.uint8)
    codec = S3dc((2, 2, 2), 8)
    sampler = S3dcSampler(codec, codec.encode(array), array.shape, array.dtype)
    for kind in ("int64", "float16", "complex64"):
        with pytest.raises(UnsupportedError, match=f"points of {kind}"):
            sampler.trilinear(np.zeros((4, 3), kind))
    at = points_around(array.shape)
    expected = sampler.trilinear(at)
    strided = np.asfortranarray(np.repeat(at, 2, axis=0))[::2]
    np.testing.assert_array_equal(sampler.trilinear(strided), expected)
    np.testing.assert_array_equal(sampler.trilinear(at.astype(">f8")), expected)


@pytest.mark.parametrize("spacing", [(1, 1), (1, 0, 1), (1, np.nan, 1), (np.inf, 1, 1), (1, 1, -1)])
def test_spacings_that_are_no_distances_are_refused(spacing: Any) -> None:
    sampler = S3dcSampler(S3dc(), S3dc().encode(np.ones((2, 2, 2), np.uint8)), (2, 2, 2), "uint8")
    with pytest.raises(InvalidInputError, match="spacing_zyx is"):
        sampler.gradient(np.ones((1, 3)), spacing)


def test_the_longest_axis_is_sampled_at_its_end_and_a_longer_one_is_refused() -> None:
    longest = 2**31 - 1
    codec = S3dc((1, 1, 2**40), 1)
    code = np.zeros(codec.encoded_nbytes((1, 1, longest + 1), "uint8"), np.uint8)
    code[1] = 200  # the greatest sample
    code[-1] = 0x40  # the index of the last voxel but one of the longer row
    with pytest.raises(InvalidInputError, match="2147483647"):
        S3dcSampler(codec, code, (1, 1, longest + 1), "uint8")
    assert codec.encoded_nbytes((1, 1, longest), "uint8") == len(code)
    sampler = S3dcSampler(codec, code, (1, 1, longest), "uint8")
    at = np.array([[longest - 0.5, 0.5, 0.5], [longest - 1.5, 0.5, 0.5], [longest - 1.25, 1, 1]])
    assert sampler.nearest(at).tolist() == [200, 0, 0]
    assert sampler.trilinear(at).tolist() == [200, 0, 50]


def test_threads_share_a_sampler(noise: Any) -> None:
    array = noise((20, 21, 22), "float32")
    codec = S3dc((4, 4, 4), 3)
    sampler = S3dcSampler(codec, codec.encode(array), array.shape, array.dtype)
    at = points_around(array.shape, 20_000)
    expected = sampler.trilinear(at)
    with ThreadPoolExecutor(4) as pool:
        for found in pool.map(lambda _: sampler.trilinear(at), range(8)):
            np.testing.assert_array_equal(found, expected)
