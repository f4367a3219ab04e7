"""Deblocking at the extremes: finite, within the hull, moved by no more than the bound."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from octobrick.codec import S3dc, _native
from octobrick.codec.deblock import rational_bezier
from octobrick.codec.errors import InvalidInputError, NotFiniteError, UnsupportedError

from .table import holds
from .ways_to_filter import DeblockingWay

INTEGERS = ("uint8", "int8", "uint16", "int16")
FLOAT_MAX = np.finfo(np.float32).max
TINY = np.finfo(np.float32).smallest_subnormal
BLOCK = (4, 4, 8)
STRENGTHS = [0, 1e-300, 100, 1e4, 1e300, -3, -1e4, -1e300]


def waves(shape: tuple[int, ...], dtype: str = "uint8") -> np.ndarray[Any, Any]:
    """Smooth matter with an edge over the whole range of a type (float32: about ±100)."""
    z, y, x = np.indices(shape)
    unit = np.sin(z / 5 + 1) * np.cos(y / 6) + np.where(x > shape[2] // 2, 0.8, np.sin(x / 7))
    unit = (unit - unit.min()) / max(float(np.ptp(unit)), 1e-9)
    if dtype == "float32":
        return (unit * 200 - 100).astype(dtype)
    info = np.iinfo(dtype)
    return np.rint(info.min + unit * (float(info.max) - info.min)).astype(dtype)


@holds("deblocking", "empty-input", "cpp")
def test_no_voxels_are_refused(implementation: str) -> None:
    with pytest.raises(InvalidInputError, match=r"\(0, 4, 4\)"):
        rational_bezier(np.empty((0, 4, 4), np.float32), (4, 4, 4))
    with pytest.raises(InvalidInputError, match="block"):
        rational_bezier(np.zeros((4, 4, 4), np.float32), (0, 4, 4))


@holds("deblocking", "one-voxel", "numpy", "cpp", "glsl")
def test_less_than_a_block_has_no_border_to_filter(deblocking: DeblockingWay, noise: Any) -> None:
    for shape in ((1, 1, 1), (4, 1, 8)):
        result = deblocking.filtered(noise(shape, "uint8"), S3dc(BLOCK, 2))
        assert np.abs(result.voxels - result.decoded).max() <= result.rounding


@holds("deblocking", "uneven", "numpy", "cpp", "glsl")
def test_blocks_of_which_a_part_is_missing_keep_the_promises(
    deblocking: DeblockingWay, noise: Any
) -> None:
    for shape in ((9, 13, 11), (1, 9, 20), (1, 1, 9)):
        result = deblocking.filtered(noise(shape, "int16"), S3dc(BLOCK, 2))
        result.require_promises()
        assert np.abs(result.voxels - result.decoded).max() > 2 * result.rounding


@holds("deblocking", "constant", "numpy", "cpp", "glsl")
def test_one_value_stays_what_it_is(deblocking: DeblockingWay) -> None:
    for dtype, value in (("uint8", 255), ("int16", -32768), ("float32", 0.1), ("float32", 3.4e38)):
        result = deblocking.filtered(np.full((5, 9, 17), value, dtype), S3dc(BLOCK, 2))
        assert np.abs(result.voxels - result.decoded).max() <= result.rounding


@holds("deblocking", "full-range", "numpy", "cpp", "glsl")
def test_the_whole_range_of_a_type_does_not_wrap(deblocking: DeblockingWay, noise: Any) -> None:
    for dtype in INTEGERS:
        for array in (noise((4, 8, 17), dtype), waves((4, 8, 17), dtype)):
            deblocking.filtered(array, S3dc(BLOCK, 2)).require_promises()


@holds("deblocking", "full-range", "cpp")
def test_a_step_over_the_whole_range_rises_and_never_falls(implementation: str) -> None:
    for dtype in INTEGERS:
        info = np.iinfo(dtype)
        step = np.full((1, 1, 16), info.min, dtype)
        step[..., 8:] = info.max
        filtered = rational_bezier(step, (1, 1, 8))[0, 0]
        assert (filtered[0], filtered[-1]) == (info.min, info.max)
        assert (np.diff(filtered) >= 0).all()


@pytest.mark.parametrize("dtype", ["uint32", "int64", "float64"])
@holds("deblocking", "wide-integers", "cpp")
def test_wider_types_are_refused_by_name(implementation: str, dtype: str) -> None:
    with pytest.raises(UnsupportedError, match=dtype):
        rational_bezier(np.ones((8, 8, 8), dtype), BLOCK)


@pytest.mark.parametrize("bits", [1, 2, 4])
@holds("deblocking", "greatest-floats", "numpy", "cpp", "glsl")
def test_a_range_beyond_float32_stays_finite(deblocking: DeblockingWay, bits: int) -> None:
    array = (waves((5, 9, 17), "float32").astype(np.float64) / 100 * float(FLOAT_MAX)).astype(
        np.float32
    )
    array[0, 0, 0], array[0, 0, 1] = -FLOAT_MAX, FLOAT_MAX
    result = deblocking.filtered(array, S3dc(BLOCK, bits))
    result.require_promises()
    assert np.abs(result.voxels - result.decoded).max() > result.rounding


@holds("deblocking", "denormals", "numpy", "cpp", "glsl")
def test_denormals_are_filtered_as_numbers(deblocking: DeblockingWay) -> None:
    array = (np.rint(waves((5, 9, 17), "float32") / 4 + 25) * np.float64(TINY)).astype(np.float32)
    result = deblocking.filtered(array, S3dc(BLOCK, 2))
    assert np.isfinite(result.voxels).all()
    assert result.voxels.min() >= result.decoded.min() - TINY
    assert result.voxels.max() <= result.decoded.max() + TINY
    assert (np.abs(result.voxels - result.decoded) <= result.bounds + 1.01 * float(TINY)).all()
    assert len(np.unique(result.voxels)) > 20


@pytest.mark.parametrize("strength", [0, 4, 1e300])
@holds("deblocking", "denormals", "cpp")
def test_denormals_are_filtered_to_the_nearest_of_them(
    implementation: str, strength: float
) -> None:
    """As the same volume 2^120 times as large is, where nothing is denormal."""
    rng = np.random.default_rng(3)
    volume = (rng.integers(0, 8, (8, 9, 10)) * np.float64(TINY)).astype(np.float32)
    filtered = rational_bezier(volume, (4, 4, 4), strength)
    large = np.ldexp(volume.astype(np.float64), 120).astype(np.float32)
    expected = rational_bezier(large, (4, 4, 4), strength).astype(np.float64)
    assert np.abs(filtered - np.ldexp(expected, -120)).max() <= 0.501 * float(TINY)
    assert (filtered != volume).any()


@holds("deblocking", "signed-zero", "numpy", "cpp", "glsl")
def test_the_sign_of_zero_moves_nothing(deblocking: DeblockingWay) -> None:
    array = np.where(np.indices((5, 9, 17)).sum(axis=0) % 2, np.float32(-0.0), np.float32(0.0))
    result = deblocking.filtered(array, S3dc(BLOCK, 2))
    np.testing.assert_array_equal(result.voxels, 0)
    array = waves((5, 9, 17), "float32")
    array[2, 3:6, 5:9] = -0.0
    plus = np.where(array == 0, np.float32(0), array)
    both = [deblocking.filtered(a, S3dc(BLOCK, 2)).voxels for a in (array, plus)]
    np.testing.assert_array_equal(*both)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@holds("deblocking", "not-finite", "cpp")
def test_what_is_not_finite_is_refused_by_its_place(implementation: str, bad: float) -> None:
    volume = np.zeros((4, 4, 9), np.float32)
    volume[1, 2, 7] = bad
    with pytest.raises(NotFiniteError) as caught:
        rational_bezier(volume, BLOCK)
    assert "(1, 2, 7)" in caught.value.message
    for wrong in (np.nan, np.inf, -np.inf):
        with pytest.raises(InvalidInputError, match="strength"):
            rational_bezier(np.zeros((4, 4, 9), np.float32), BLOCK, wrong)


@pytest.mark.parametrize("deviation", [8, 40, 1e4])
@holds("deblocking", "tiny-range", "numpy", "cpp", "glsl")
def test_a_tiny_range_on_a_large_offset_stays_within_it(
    deblocking: DeblockingWay, deviation: float
) -> None:
    """Float32 steps by 8 at 1e8, so that a result may be rounded by 4 beyond its bound."""
    array = (1e8 + np.random.default_rng(4).normal(size=(9, 10, 11)) * deviation).astype(np.float32)
    result = deblocking.filtered(array, S3dc(BLOCK, 2))
    result.require_promises()


@holds("deblocking", "one-bit", "numpy", "cpp", "glsl")
def test_codes_of_one_bit_are_clamped_to_a_part_of_their_step(
    deblocking: DeblockingWay, noise: Any
) -> None:
    for array in (noise((5, 9, 17), "uint8"), waves((5, 9, 17), "float32")):
        result = deblocking.filtered(array, S3dc(BLOCK, 1))
        result.require_promises()
        moved = np.abs(result.voxels - result.decoded)
        rounded = result.rounding + np.spacing(np.float32(256))
        assert (moved <= 0.4 * result.bounds + rounded).all()


@pytest.mark.parametrize("strength", STRENGTHS)
@holds("deblocking", "strengths", "numpy", "cpp", "glsl")
def test_no_strength_breaks_a_promise(deblocking: DeblockingWay, strength: float) -> None:
    for dtype in ("uint8", "float32"):
        result = deblocking.filtered(waves((5, 9, 17), dtype), S3dc(BLOCK, 2), strength)
        result.require_promises()
        assert np.abs(result.voxels - result.decoded).max() > 2 * result.rounding


@pytest.mark.parametrize("strength", STRENGTHS)
@holds("deblocking", "strengths", "numpy", "cpp")
def test_unlimited_too_it_stays_in_the_hull(implementation: str, strength: float) -> None:
    from octobrick.codec import reference_deblock

    volume = waves((5, 9, 34), "float32")
    run = reference_deblock.rational_bezier if implementation == "numpy" else rational_bezier
    for block in ((4, 4, 8), (4, 4, 17)):
        for axes in ("average", "sequential"):
            filtered = run(volume, block, strength, axes=axes)  # type: ignore[operator]
            assert np.isfinite(filtered).all()
            assert volume.min() <= filtered.min()
            assert filtered.max() <= volume.max()


@holds("deblocking", "threads-and-instructions", "cpp")
def test_neither_threads_nor_instructions_change_a_bit(implementation: str) -> None:
    volume = waves((19, 21, 40), "float32")
    bounds = np.full(volume.shape, 3.0, np.float32)

    def run(threads: int, simd: bool, sequential: bool) -> bytes:
        out = np.empty_like(volume)
        _native.deblock_into(
            volume, out, BLOCK, 4.0, 0.0, (0.0, 0.0), bounds, sequential,
            _native.DeblockLimit.AUTO, threads, simd,
        )  # fmt: skip
        return out.tobytes()

    for sequential in (False, True):
        plain = run(1, False, sequential)
        assert plain != volume.tobytes()
        for threads, simd in ((1, True), (3, False), (7, True)):
            assert run(threads, simd, sequential) == plain
