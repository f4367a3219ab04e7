"""The metrics against sums written out, and against values known beforehand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from octobrick.codec import ErrorStats, _native, metrics
from octobrick.codec.errors import InvalidInputError

integers = st.sampled_from(["uint8", "int8", "uint16", "int16"]).flatmap(
    lambda dtype: hnp.arrays(dtype, (2, 3, 3, 37)).map(lambda pair: (pair[0], pair[1]))
)


@given(integers)
@settings(max_examples=60, deadline=None)
def test_integers_are_compared_exactly(pair: tuple[NDArray[Any], NDArray[Any]]) -> None:
    a, b = pair
    difference = a.astype(object) - b.astype(object)
    stats = metrics.compare(a, b)
    assert stats == ErrorStats(a.size, abs(difference).max(), (difference**2).sum())
    assert isinstance(stats.sum_squared, int)
    assert _native.compare(a, b, simd=False) == _native.compare(a, b, simd=True)


def test_squares_of_full_range_differences_do_not_overflow() -> None:
    zeros = np.zeros((3, 70, 1000), np.uint16)
    stats = metrics.compare(zeros, zeros + np.uint16(65535))
    assert stats == ErrorStats(210_000, 65535, 210_000 * 65535**2)
    low = np.full((1, 1, 999), -128, np.int8)
    assert metrics.compare(low, ~low) == ErrorStats(999, 255, 999 * 255**2)


def test_floats_are_compared_in_double() -> None:
    a = np.full((2, 3, 1001), 3e38, np.float32)
    stats = metrics.compare(a, -a)
    assert stats.max_abs == 2 * float(a[0, 0, 0])
    assert stats.sum_squared == pytest.approx(a.size * (2 * 3e38) ** 2, rel=1e-6)
    assert _native.compare(a, -a, simd=False) == _native.compare(a, -a, simd=True)


def test_nan_shows_in_the_result_wherever_it_is() -> None:
    for at in (0, 7, 8, 20):
        a = np.zeros((2, 1, 21), np.float32)
        b = a.copy()
        b[1, 0, at] = np.nan
        stats = metrics.compare(a, b)
        assert math.isnan(stats.max_abs)
        assert math.isnan(stats.sum_squared)
        for total in (stats + ErrorStats(1, 5, 25), ErrorStats(1, 5, 25) + stats):
            assert math.isnan(total.max_abs)
        assert math.isnan(metrics.psnr(a, b, peak=1))


@pytest.mark.parametrize("dtype", ["uint8", "int32", "uint64", "float32", "float64", "bool"])
@pytest.mark.parametrize("shape", [(), (7,), (5, 6), (2, 3, 4), (2, 2, 3, 4), (0, 3)])
def test_any_type_and_number_of_axes(dtype: str, shape: tuple[int, ...]) -> None:
    rng = np.random.default_rng(3)
    a, b = (rng.integers(0, 2, shape).astype(dtype) for _ in range(2))
    difference = np.asarray(a.astype(float) - b.astype(float))
    stats = metrics.compare(a, b)
    assert stats == ErrorStats(a.size, np.abs(difference).max(initial=0), (difference**2).sum())


def test_strided_arrays_of_different_types(noise: Any) -> None:
    a = noise((8, 9, 30), "uint8")
    assert metrics.max_error(a[::2, ::-1, ::3], a[::2, ::-1, ::3].astype(np.float32)) == 0
    assert metrics.compare(a.T, np.ascontiguousarray(a.T)).max_abs == 0


def test_parts_add_up_to_the_whole(noise: Any) -> None:
    a, b = noise((6, 5, 40), "int16", 1), noise((6, 5, 40), "int16", 2)
    parts = (metrics.compare(a[z], b[z]) for z in range(6))
    assert sum(parts, ErrorStats()) == metrics.compare(a, b)


def test_rmse_and_psnr_of_known_numbers() -> None:
    stats = ErrorStats(count=4, max_abs=3, sum_squared=16)
    assert stats.rmse == 2
    assert stats.psnr(20) == pytest.approx(20)
    assert stats.psnr(0) == -math.inf
    assert ErrorStats(4).psnr(0) == ErrorStats(4).psnr(1) == math.inf
    assert ErrorStats().rmse == 0
    for peak in (-1.0, math.nan):
        with pytest.raises(InvalidInputError, match="peak is"):
            stats.psnr(peak)


def test_peak_is_the_range_of_the_original_unless_given() -> None:
    b = np.array([10, 20, 30], np.uint8)
    assert metrics.psnr(b, b + np.uint8(1)) == pytest.approx(20 * math.log10(20))
    assert metrics.psnr(b, b + np.uint8(1), peak=100) == pytest.approx(40)
    assert metrics.psnr(b, b) == math.inf


def ssim_of_every_window(a: NDArray[Any], b: NDArray[Any], peak: float) -> float:
    """SSIM as Wang et al. write it: one weighted window after the other."""
    axis = np.exp(-((np.arange(11) - 5.0) ** 2) / (2 * 1.5**2))
    weights = np.asarray(axis)
    for _ in range(a.ndim - 1):
        weights = np.multiply.outer(weights, axis)
    weights = weights / weights.sum()
    c1, c2 = (0.01 * peak) ** 2, (0.03 * peak) ** 2
    values = []
    for start in np.ndindex(*(n - 10 for n in a.shape)):
        window = tuple(slice(i, i + 11) for i in start)
        x, y = a[window].astype(float), b[window].astype(float)
        mx, my = (weights * x).sum(), (weights * y).sum()
        vx, vy = (weights * (x - mx) ** 2).sum(), (weights * (y - my) ** 2).sum()
        cov = (weights * (x - mx) * (y - my)).sum()
        values.append((2 * mx * my + c1) * (2 * cov + c2) / ((mx**2 + my**2 + c1) * (vx + vy + c2)))
    return float(np.mean(values))


@pytest.mark.parametrize("shape", [(11, 11), (15, 20), (12, 13, 14)])
def test_ssim_is_the_mean_over_all_gaussian_windows(noise: Any, shape: tuple[int, ...]) -> None:
    a = noise(shape, "uint8") // 2
    b = np.clip(a + noise(shape, "uint8", 2) // 16, 0, 255).astype(np.uint8)
    expected = ssim_of_every_window(a, b, 255)
    assert 0.1 < expected < 0.99
    assert metrics.ssim(a, b, peak=255) == pytest.approx(expected, abs=1e-12)


def test_ssim_of_channels_is_their_mean(noise: Any) -> None:
    a, b = noise((16, 17, 3), "uint8", 1), noise((16, 17, 3), "uint8", 2)
    each = [metrics.ssim(a[..., c], b[..., c], 255) for c in range(3)]
    assert metrics.ssim(a, b) == pytest.approx(np.mean(each))


def test_ssim_of_equal_arrays_is_one(noise: Any) -> None:
    for dtype in ("uint8", "int16", "float32"):
        a = noise((12, 12, 12), dtype)
        assert metrics.ssim(a, a) == pytest.approx(1, abs=1e-12)
    nothing = np.zeros((12, 12), np.float32)
    assert metrics.ssim(nothing, nothing) == 1


@pytest.mark.parametrize("shape", [(), (11,), (10, 40), (11, 40, 10), (11, 11, 11, 11)])
def test_ssim_needs_room_for_a_window(shape: tuple[int, ...]) -> None:
    with pytest.raises(InvalidInputError, match="at least 11 voxels on each axis"):
        metrics.ssim(np.zeros(shape), np.zeros(shape))


def test_shapes_that_differ_are_refused_with_both_named() -> None:
    for metric in (metrics.compare, metrics.max_error, metrics.psnr, metrics.ssim):
        with pytest.raises(InvalidInputError, match=r"\(3, 4\) and \(4, 3\)"):
            metric(np.zeros((3, 4)), np.zeros((4, 3)))


def test_angular_error_is_the_angle_in_degrees() -> None:
    a = np.array([[1, 0, 0], [0, 2, 0], [1, 1, 0], [1, 0, 0]], np.float32)
    b = np.array([[0, 3, 0], [0, -1, 0], [5, 5, 0], [1, 1e-6, 0]])
    np.testing.assert_allclose(
        metrics.angular_error(a, b), [90, 180, 0, np.degrees(1e-6)], rtol=1e-9, atol=1e-12
    )


def test_angular_error_with_zero_vectors_is_0_for_two_and_90_for_one() -> None:
    a, b = np.array([[0, 0, 0], [0, 0, 0], [1, 0, 0]]), np.array([[0, 0, 0], [1, 0, 0], [0, 0, 0]])
    np.testing.assert_array_equal(metrics.angular_error(a, b), [0, 90, 90])


def test_angular_error_bears_any_length_and_shows_nan() -> None:
    a = np.array([[5e-324, 0, 0], [1e308, 1e308, 0], [np.nan, 0, 0], [np.inf, 1, 0]])
    b = np.array([[0, 1e308, 0], [5e-324, 5e-324, 0], [1, 0, 0], [1, 0, 0]])
    np.testing.assert_array_equal(metrics.angular_error(a, b), [90, 0, np.nan, np.nan])


def test_angular_error_refuses_what_has_no_three_components() -> None:
    with pytest.raises(InvalidInputError, match="last axis"):
        metrics.angular_error(np.zeros((3, 2)), np.zeros((3, 2)))
