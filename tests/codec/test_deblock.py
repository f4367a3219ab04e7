"""The deblocking filter: what it computes, what it promises, and that nothing upsets it."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from octobrick.codec import S3dc, Zerobit, deblock, metrics
from octobrick.codec import reference_deblock as reference
from octobrick.codec.errors import (
    CorruptBrickError,
    InvalidInputError,
    NotFiniteError,
    UnsupportedError,
)

LARGEST = float(np.finfo(np.float32).max)
EXTREME_STRENGTHS = (0, 1e-300, 4, 16, 1e2, 1e4, 1e300, -3, -1e4, -1e300)
LIMITS = ("auto", "ramp", "clamp")
Volume = NDArray[Any]

extents = st.tuples(*[st.integers(1, 14)] * 3)


def smooth(shape: tuple[int, ...], seed: int = 1) -> Volume:
    """A field with structure at every scale, about −100 to 100."""
    noise = np.random.default_rng(seed).normal(size=shape)
    for axis in range(3):
        noise = noise.cumsum(axis) / 2
    return (noise * 20).astype(np.float32)


def assert_same(found: Volume, expected: Volume, span: float) -> None:
    error = np.abs(found.astype(np.float64) - expected)
    assert error.max() <= 1e-5 * span


@given(
    extents,
    extents,
    st.sampled_from(EXTREME_STRENGTHS),
    st.sampled_from([None, *LIMITS]),
    st.sampled_from(["average", "sequential"]),
    st.integers(0, 99),
)
@settings(max_examples=120, deadline=None)
def test_native_filter_is_the_reference_at_any_strength(
    shape: tuple[int, int, int],
    block: tuple[int, int, int],
    strength: float,
    limit: Any,
    axes: Any,
    seed: int,
) -> None:
    volume = smooth(shape, seed)
    bound = np.random.default_rng(seed).choice([0, 0.5, 4, 40, np.inf], shape).astype(np.float32)
    given_bound = None if limit is None else bound
    options = {"limit": limit or "auto", "axes": axes}
    found = deblock.rational_bezier(volume, block, strength, given_bound, threads=2, **options)
    expected = reference.rational_bezier(volume, block, strength, given_bound, **options)
    assert_same(found, expected, float(np.ptp(volume)))


@pytest.mark.parametrize("block", [(4, 4, 4), (5, 3, 7), (16, 16, 16), (30, 1, 30), (1, 1, 1)])
@pytest.mark.parametrize("dtype", ["uint8", "int16"])
def test_native_filter_is_the_reference_on_integers(
    block: tuple[int, int, int], dtype: str
) -> None:
    volume = smooth((19, 20, 41)).astype(np.int8).astype(dtype)
    found = deblock.rational_bezier(volume, block, 4, 3.0)
    expected = reference.rational_bezier(volume, block, 4, np.full(volume.shape, 3, np.float32))
    assert found.dtype == np.float32
    assert_same(found, expected, float(np.ptp(volume)))


def test_a_block_of_hundreds_does_not_underflow() -> None:
    """Bernstein polynomials of degree 1200 go down to 1e-700: below every double."""
    volume = smooth((1, 1, 1201))
    for strength in (4, 1e4):
        found = deblock.rational_bezier(volume, (1, 1, 1200), strength)
        assert np.isfinite(found).all()
        assert_same(
            found, reference.rational_bezier(volume, (1, 1, 1200), strength), np.ptp(volume)
        )


def de_casteljau(points: list[float], t: float) -> float:
    """The Bézier curve by repeated interpolation: no polynomial, no logarithm."""
    while len(points) > 1:
        points = [(1 - t) * a + t * b for a, b in itertools.pairwise(points)]
    return points[0]


@pytest.mark.parametrize(("before", "after"), [(2, 2), (4, 4), (8, 3), (5, 5), (32, 32)])
def test_without_strength_it_is_de_casteljaus_curve(before: int, after: int) -> None:
    line = smooth((1, 1, before + after))
    filtered = reference.filter_axis(
        line.astype(np.float64), np.zeros(line.shape), 2, before, strength=0
    )
    points = line[0, 0].astype(float).tolist()
    for s in range(before - before // 2, before + after // 2):
        expected = de_casteljau(points, s / (len(points) - 1))
        assert filtered[0, 0, s] == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_weights_are_the_papers() -> None:
    """ω = exp(λ(1 − ‖∇‖)) written out, without the cancellation of e^λ."""
    line = smooth((1, 1, 12))[0, 0].astype(np.float64)
    slopes = np.abs(np.gradient(line)) / np.ptp(line)
    weights = np.exp(4 * (1 - slopes))
    basis = np.exp(reference.log_basis(12, 5))
    expected = (basis * weights * line).sum() / (basis * weights).sum()
    found = deblock.rational_bezier(line.reshape(1, 1, 12).astype(np.float32), (1, 1, 6), 4)
    # Of the three axes two have no border, and leave the voxel as it was.
    assert found[0, 0, 5] == pytest.approx((expected + 2 * line[5]) / 3, abs=1e-5 * np.ptp(line))


@pytest.mark.parametrize("size", [3, 4, 5, 8])
def test_only_half_of_each_block_beside_a_border_is_replaced(size: int) -> None:
    step = np.zeros((1, 1, 2 * size), np.float32)
    step[..., size:] = 1
    moved = deblock.rational_bezier(step, (1, 1, size)) != step
    expected = np.zeros(2 * size, bool)
    expected[size - size // 2 : size + size // 2] = True
    np.testing.assert_array_equal(moved[0, 0], expected)


def test_the_average_keeps_two_thirds_of_a_jump_and_the_sequence_little() -> None:
    step = np.zeros((16, 16, 16), np.float32)
    step[:, :, 8:] = 1
    average = deblock.rational_bezier(step, (8, 8, 8), 0)
    sequence = deblock.rational_bezier(step, (8, 8, 8), 0, axes="sequential")
    curve = sequence[0, 0, 8] - sequence[0, 0, 7]
    assert curve < 0.25
    assert average[0, 0, 8] - average[0, 0, 7] == pytest.approx(2 / 3 + curve / 3, abs=1e-6)


def test_constant_volumes_stay_what_they_are(dtype: np.dtype[Any]) -> None:
    volume = np.full((9, 8, 7), 77, dtype)
    np.testing.assert_array_equal(deblock.rational_bezier(volume, (4, 4, 4)), 77)
    offset = np.full((1, 9, 8), 1e8, np.float32)
    offset[0, 0, 0] = 1e8 + 64  # flat elsewhere, and exactly so
    assert (deblock.rational_bezier(offset, (1, 2, 2))[0, 5:] == np.float32(1e8)).all()


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 5, 1), (3, 4, 5), (1, 1, 40)])
def test_a_volume_of_one_block_has_no_border(shape: tuple[int, int, int]) -> None:
    volume = smooth(shape)
    np.testing.assert_array_equal(deblock.rational_bezier(volume, (2**40,) * 3), volume)
    ones = deblock.rational_bezier(volume, (1, 1, 1))
    np.testing.assert_array_equal(ones, volume)  # half of one voxel, rounded down, is none


@pytest.mark.parametrize("strength", EXTREME_STRENGTHS)
@pytest.mark.parametrize("axes", ["average", "sequential"])
def test_no_strength_leaves_the_control_points_hull(strength: float, axes: Any) -> None:
    volume = smooth((12, 13, 14))
    filtered = deblock.rational_bezier(volume, (4, 5, 3), strength, axes=axes)
    assert filtered.min() >= volume.min()
    assert filtered.max() <= volume.max()
    line = volume[:1, :1]
    curve = deblock.rational_bezier(line, (1, 1, 7), strength, axes=axes)
    assert (curve >= line.min()).all()
    assert (curve <= line.max()).all()


def test_the_greatest_floats_and_the_least_are_filtered() -> None:
    for size in (LARGEST, 2.0**-140):
        volume = np.where(smooth((8, 9, 10)) > 0, size, -size).astype(np.float32)
        filtered = deblock.rational_bezier(volume, (4, 4, 4))
        assert np.isfinite(filtered).all()
        assert_same(filtered, reference.rational_bezier(volume, (4, 4, 4), 4), 2 * size)


@pytest.mark.parametrize("value_range", [1e-300, 1e-30, 1e300])
def test_any_range_to_measure_gradients_by_gives_finite_values(value_range: float) -> None:
    volume = smooth((9, 9, 9))
    for strength in (4, 1e300):
        options = {"value_range": value_range}
        found = deblock.rational_bezier(volume, (4, 4, 4), strength, **options)
        expected = reference.rational_bezier(volume, (4, 4, 4), strength, **options)
        assert_same(found, expected, float(np.ptp(volume)))


def test_parts_with_the_wholes_range_are_filtered_like_the_whole() -> None:
    volume = smooth((6, 6, 40))
    span = float(np.ptp(volume))
    whole = deblock.rational_bezier(volume, (6, 6, 4))
    part = deblock.rational_bezier(volume[:, :, 12:28], (6, 6, 4), value_range=span)
    # One block at the cut has lost its neighbour, and its first voxel its central difference.
    assert_same(part[:, :, 4:-4], whole[:, :, 16:24], span)


@pytest.mark.parametrize("block", [(4, 4, 4), (8, 3, 5)])
@pytest.mark.parametrize("strength", [4, 0, -3, 100])
def test_parts_with_the_wholes_least_and_greatest_are_filtered_like_the_whole_to_the_bit(
    block: tuple[int, int, int], strength: float
) -> None:
    volume = smooth((24, 27, 43))
    ends = (float(volume.min()), float(volume.max()))
    grid = tuple(-(-n // b) for n, b in zip(volume.shape, block, strict=True))
    bound = np.random.default_rng(3).choice([0, 0.5, 4], grid).astype(np.float32)
    whole = deblock.rational_bezier(volume, block, strength, bound, value_range=ends)
    # Blocks from the second on, of which the outer two on each side lack what they need.
    first = [b if n > 4 * b else 0 for n, b in zip(volume.shape, block, strict=True)]
    voxels = tuple(slice(f, None) for f in first)
    cells = tuple(slice(f // b, None) for f, b in zip(first, block, strict=True))
    part = deblock.rational_bezier(volume[voxels], block, strength, bound[cells], value_range=ends)
    inner = [slice(2 * b if f else 0, None) for f, b in zip(first, block, strict=True)]
    np.testing.assert_array_equal(part[tuple(inner)], whole[voxels][tuple(inner)])
    assert (whole != volume).any()


@given(extents, extents, st.sampled_from(LIMITS), st.sampled_from([4, 1e4]), st.integers(0, 99))
@settings(max_examples=60, deadline=None)
def test_bounds_by_block_leave_out_work_and_change_no_voxel(
    shape: tuple[int, int, int], block: tuple[int, int, int], limit: Any, strength: float, seed: int
) -> None:
    volume = smooth(shape, seed)
    grid = tuple(-(-n // b) for n, b in zip(shape, block, strict=True))
    bounds = np.random.default_rng(seed).choice([0, 0, 0, 0, 5], grid).astype(np.float32)
    each = bounds
    for axis, (n, b) in enumerate(zip(shape, block, strict=True)):
        each = each.repeat(b, axis).take(range(n), axis)
    ends = (float(volume.min()), float(volume.max()))
    for value_range in (None, ends if ends[0] < ends[1] else None):
        options: Any = {"limit": limit, "value_range": value_range}
        found = deblock.rational_bezier(volume, block, strength, bounds, **options)
        expected = deblock.rational_bezier(volume, block, strength, each, **options)
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("limit", LIMITS)
def test_no_voxel_moves_further_than_its_bound(limit: Any) -> None:
    volume = smooth((12, 12, 12))
    bound = np.random.default_rng(2).uniform(0, 3, (3, 3, 3)).astype(np.float32)
    bound[1, 1, 1] = 0
    per_voxel = np.kron(bound, np.ones((4, 4, 4), np.float32))
    filtered = deblock.rational_bezier(volume, (4, 4, 4), 4, bound, limit=limit)
    moved = np.abs(filtered.astype(np.float64) - volume)
    rounding = np.spacing(np.maximum(np.abs(volume), np.abs(filtered))) / 2.0
    assert (moved <= per_voxel.astype(np.float64) + rounding).all()
    np.testing.assert_array_equal(filtered[4:8, 4:8, 4:8], volume[4:8, 4:8, 4:8])
    again = deblock.rational_bezier(volume, (4, 4, 4), 4, per_voxel, limit=limit)
    np.testing.assert_array_equal(filtered, again)
    assert moved.max() > 0


def test_an_infinite_bound_does_not_limit() -> None:
    volume = smooth((9, 9, 9))
    free = deblock.rational_bezier(volume, (4, 4, 4))
    for limit in LIMITS:
        found = deblock.rational_bezier(volume, (4, 4, 4), 4, np.inf, limit=limit)  # type: ignore[arg-type]
        np.testing.assert_allclose(found, free, atol=1e-5)


@pytest.mark.parametrize(("bits", "expected"), [(1, "clamp"), (2, "clamp"), (3, None), (8, None)])
def test_auto_clamps_codes_of_one_and_two_bits(bits: int, expected: Any) -> None:
    volume = smooth((16, 16, 16))
    codec = S3dc((4, 4, 4), bits)
    code = codec.encode(volume)
    decoded = codec.decode(code, volume.shape, volume.dtype)
    bounds = deblock.s3dc_bounds(codec, code, volume.shape, volume.dtype)
    auto = deblock.rational_bezier(decoded, codec.block, 4, bounds)
    part = np.float32(0.4) * bounds
    clamped = deblock.rational_bezier(decoded, codec.block, 4, part, limit="clamp")
    assert np.allclose(auto, clamped, atol=1e-5) == (expected == "clamp")


@pytest.mark.parametrize("dtype", ["uint8", "float32"])
@pytest.mark.parametrize("bits", [1, 2, 4])
def test_s3dc_bounds_hold_for_every_voxel(dtype: str, bits: int) -> None:
    volume = smooth((13, 14, 15)).astype(np.int8).astype(dtype)
    volume[:4, :4, :4] = 9
    volume[4:8, :4, :4] = np.arange(4) % 2
    codec = S3dc((4, 4, 4), bits)
    code = codec.encode(volume)
    bounds = deblock.s3dc_bounds(codec, code, volume.shape, dtype)
    assert bounds.shape == (4, 4, 4)
    assert bounds[0, 0, 0] == 0
    assert (bounds[1, 0, 0] == 0) == (dtype == "uint8")
    decoded = codec.decode(code, volume.shape, dtype).astype(np.float64)
    per_voxel = np.kron(bounds, np.ones((4, 4, 4)))[:13, :14, :15]
    rounding = np.where(per_voxel > 0, 0.5 if dtype == "uint8" else 1e-5, 0)
    assert (np.abs(decoded - volume) <= per_voxel * (1 + 1e-6) + rounding).all()


@pytest.mark.parametrize("dtype", ["uint8", "int16", "float32"])
@pytest.mark.parametrize("predicted", [False, True])
def test_bounds_of_bounded_and_scaled_codes_hold_for_every_voxel(
    dtype: str, predicted: bool
) -> None:
    rng = np.random.default_rng(6)
    waves = np.sin(np.indices((13, 18, 22)).sum(0) / 6) * 60 + rng.normal(0, 2, (13, 18, 22))
    voxels = (waves + 90).astype(dtype)
    prediction = np.roll(voxels, 1, axis=1) if predicted else None
    codecs = [S3dc((4, 4, 4), max_error=3), S3dc((4, 4, 8), max_error=0)]
    codecs += [] if predicted else [S3dc((4, 5, 6), 2, scale="trained")]
    for codec in codecs:
        code = codec.encode(voxels, prediction=prediction)
        decoded = codec.decode(code, voxels.shape, dtype, prediction=prediction)
        bounds = deblock.s3dc_bounds(codec, code, voxels.shape, dtype, predicted=predicted)
        for axis, (n, b) in enumerate(zip(voxels.shape, codec.block, strict=True)):
            bounds = bounds.take(np.arange(n) // b, axis)
        rounding = 0.5 if np.dtype(dtype).kind != "f" else 1e-4  # float32 near 150
        off = np.abs(decoded.astype(np.float64) - voxels.astype(np.float64))
        assert (off <= bounds + rounding).all()
        if codec.max_error is not None:
            assert bounds.max() <= codec.max_error


@pytest.mark.parametrize(
    "codec", [S3dc((4, 4, 4), 2), S3dc(bits_per_voxel=1), Zerobit(0.02)], ids=str
)
def test_a_smooth_volume_gains_by_the_default_of_its_codec(codec: S3dc | Zerobit) -> None:
    waves = np.sin(np.indices((24, 25, 26)).sum(0) / 5) * 90 + 120
    voxels = (waves + np.random.default_rng(1).normal(0, 1, waves.shape)).astype(np.uint8)
    code = codec.encode(voxels)
    decoded = codec.decode(code, voxels.shape, voxels.dtype)
    filtered = deblock.deblocked(codec, code, voxels.shape, voxels.dtype)
    original = voxels.astype(np.float32)
    before = metrics.psnr(original, decoded.astype(np.float32))
    assert metrics.psnr(original, filtered) > before + 0.3


def test_the_defaults_are_those_of_the_specification() -> None:
    voxels = np.random.default_rng(3).integers(0, 200, (17, 18, 19)).astype(np.uint8)
    zerobit, s3dc = Zerobit(0.05), S3dc((4, 4, 8), 3)
    code = zerobit.encode(voxels)
    bounds = deblock.zerobit_bounds(zerobit, code)
    assert bounds.shape == (5, 5, 5)
    assert bounds[4, 0, 3] == 2 * zerobit.block_thresholds(code)[1, 0, 0]
    decoded = zerobit.decode(code, voxels.shape, voxels.dtype)
    np.testing.assert_array_equal(
        deblock.deblocked(zerobit, code, voxels.shape, voxels.dtype),
        deblock.rational_bezier(decoded, (4, 4, 4), 4, bounds, limit="ramp"),
    )
    code = s3dc.encode(voxels)
    decoded = s3dc.decode(code, voxels.shape, voxels.dtype)
    bounds = deblock.s3dc_bounds(s3dc, code, voxels.shape, voxels.dtype)
    np.testing.assert_array_equal(
        deblock.deblocked(s3dc, code, voxels.shape, voxels.dtype),
        deblock.rational_bezier(decoded, s3dc.block, 4, bounds),
    )
    with pytest.raises(InvalidInputError, match="colours"):
        deblock.deblocked(zerobit, code, (4, 4, 4, 3), "uint8")


def test_blocks_of_one_value_among_others_have_the_bounds_of_those() -> None:
    voxels = np.random.default_rng(2).integers(0, 30, (8, 8, 16)).astype(np.uint8)
    voxels[:, :, 8:] //= 10
    codec = S3dc((4, 4, 4), bits_per_voxel=1.5)
    code = codec.encode(voxels)
    widths = codec.block_widths(code, voxels.shape, voxels.dtype)
    bounds = deblock.s3dc_bounds(codec, code, voxels.shape, voxels.dtype)
    assert set(np.unique(widths)) >= {0, 2}
    assert (bounds[widths == 0] == np.median(bounds[widths > 0])).all()


def test_smooth_data_at_two_bits_gain_and_lose_their_seams() -> None:
    z, y, x = np.indices((32, 32, 32))
    volume = (100 * np.sin(x / 9) * np.cos(y / 11) + 3 * z).astype(np.float32)
    codec = S3dc((8, 8, 8), 2)
    code = codec.encode(volume)
    decoded = codec.decode(code, volume.shape, volume.dtype)
    bounds = deblock.s3dc_bounds(codec, code, volume.shape, volume.dtype)
    filtered = deblock.rational_bezier(decoded, codec.block, 4, bounds)
    assert metrics.psnr(volume, filtered) > metrics.psnr(volume, decoded) + 3


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_neither_threads_nor_instructions_change_a_voxel(threads: int) -> None:
    from octobrick.codec import _native

    volume = smooth((21, 18, 37))
    expected = deblock.rational_bezier(volume, (4, 8, 5), 4, 2.0, threads=1)
    bounds = np.full((6, 3, 8), 2, np.float32)
    for simd in (True, False):
        found = np.empty_like(volume)
        auto = _native.DeblockLimit.AUTO
        fault = _native.deblock_into(
            volume, found, (4, 8, 5), 4, 0, (0, 0), bounds, False, auto, threads, simd
        )
        assert fault is None
        assert found.tobytes() == expected.tobytes()


def test_any_strides_give_the_same_and_the_input_is_left_alone() -> None:
    volume = smooth((10, 11, 24))
    before = volume.copy()
    strided = volume[::-1, :, ::2]
    np.testing.assert_array_equal(
        deblock.rational_bezier(strided, (4, 4, 4)),
        deblock.rational_bezier(strided.copy(), (4, 4, 4)),
    )
    np.testing.assert_array_equal(volume, before)
    expected = deblock.rational_bezier(volume, (4, 4, 4))
    unaligned = np.frombuffer(b"x" + volume.tobytes(), np.float32, offset=1).reshape(volume.shape)
    for same in (volume.astype(">f4"), unaligned):
        np.testing.assert_array_equal(deblock.rational_bezier(same, (4, 4, 4)), expected)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_voxel_that_is_not_finite_is_named(bad: float) -> None:
    volume = smooth((4, 5, 6))
    volume[2, 3, 4] = volume[3, 4, 5] = bad
    for threads in (1, 3):
        with pytest.raises(NotFiniteError, match=r"\(2, 3, 4\)"):
            deblock.rational_bezier(volume, (2, 2, 2), threads=threads)


def test_wrong_arguments_are_refused() -> None:
    volume = smooth((4, 5, 6))
    for options in (
        {"strength": np.nan},
        {"strength": np.inf},
        {"bound": -1},
        {"bound": np.nan},
        {"bound": np.zeros((1, 2, 3))},
        {"limit": "none"},
        {"axes": "x"},
        {"value_range": 0},
        {"value_range": np.inf},
        {"value_range": (2.0, 2.0)},
        {"value_range": (np.nan, 2.0)},
        {"threads": 0},
    ):
        with pytest.raises(InvalidInputError):
            deblock.rational_bezier(volume, (2, 2, 2), **options)  # type: ignore[arg-type]
    with pytest.raises(InvalidInputError, match="block"):
        deblock.rational_bezier(volume, (0, 2, 2))
    with pytest.raises(InvalidInputError, match="shape"):
        deblock.rational_bezier(volume[0], (2, 2, 2))
    with pytest.raises(UnsupportedError, match="float64"):
        deblock.rational_bezier(volume.astype(np.float64), (2, 2, 2))


def test_damaged_end_points_are_refused() -> None:
    volume = smooth((8, 8, 8))
    codec = S3dc((4, 4, 4), 2)
    code = codec.encode(volume)
    with pytest.raises(CorruptBrickError, match="bytes"):
        deblock.s3dc_bounds(codec, code[:63], volume.shape, "float32")
    swapped = code[4:8] + code[:4] + code[8:]
    with pytest.raises(CorruptBrickError, match="minimum"):
        deblock.s3dc_bounds(codec, swapped, volume.shape, "float32")
    hole = np.float32(np.nan).tobytes() + code[4:]
    with pytest.raises(CorruptBrickError, match="minimum"):
        deblock.s3dc_bounds(codec, hole, volume.shape, "float32")
