"""Central differences in world units, and the reduction that borders survive."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from octobrick.codec import _native, gradients
from octobrick.codec import reference_gradients as reference
from octobrick.codec.errors import InvalidInputError, NotFiniteError, UnsupportedError

SHAPES = st.tuples(*[st.integers(1, 9)] * 3)
LARGEST = float(np.finfo(np.float32).max)


def test_a_ramp_has_its_slope_everywhere_in_world_units(dtype: np.dtype[Any]) -> None:
    z, y, x = np.indices((5, 6, 7))
    ramp = (x + 2 * y + 3 * z).astype(dtype)
    gradient = gradients.central_differences(ramp, (1.5, 0.5, 0.25))
    np.testing.assert_array_equal(gradient, np.broadcast_to([4, 4, 2], gradient.shape))


def test_inside_it_is_numpys_gradient(noise: Any) -> None:
    volume = noise((6, 7, 8), "float32")
    expected = np.gradient(volume.astype(np.float64), 2.0, 1.0, 0.5)
    found = gradients.central_differences(volume, (2, 1, 0.5))
    np.testing.assert_allclose(found, np.stack(expected[::-1], -1), rtol=1e-6, atol=1e-6)


@given(SHAPES, st.sampled_from(["uint8", "int8", "uint16", "int16", "float32"]), st.integers(0, 99))
@settings(max_examples=60, deadline=None)
def test_native_field_is_the_references(shape: tuple[int, int, int], dtype: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    volume = (rng.normal(size=shape) * 100).astype(np.int64).astype(dtype)
    spacing = tuple(rng.uniform(0.1, 4, 3))
    found = gradients.central_differences(volume, spacing)
    assert found.tobytes() == reference.central_differences(volume, spacing).tobytes()
    radius, sigma = int(rng.integers(1, 6)), float(rng.uniform(0.2, 3))
    reduced = gradients.reduce(found, radius, sigma, threads=2)
    np.testing.assert_array_equal(reduced, reference.reduce(found, radius, sigma))


@given(SHAPES, st.sampled_from(["uint8", "int8", "uint16", "int16", "float32"]), st.integers(0, 99))
@settings(max_examples=80, deadline=None)
def test_parts_reduced_in_one_go_are_those_of_the_whole(
    shape: tuple[int, int, int], dtype: str, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    volume = (rng.normal(size=shape) * 100).clip(-400, 400).astype(np.int64).astype(dtype)
    if dtype == "float32" and seed % 3 == 0:
        volume = volume * np.float32(8e35)  # differences beyond the greatest float
    spacing = tuple(rng.uniform(0.3, 3, 3))
    start = [2 * int(rng.integers(0, (n + 1) // 2)) for n in shape]
    count = [int(rng.integers(1, n - i + 1)) for i, n in zip(start, shape, strict=True)]
    evened = [max(m & ~1, min(2, n - i)) for m, i, n in zip(count, start, shape, strict=True)]
    ends = [i + m == n for m, i, n in zip(count, start, shape, strict=True)]
    count = [m if end else even for m, even, end in zip(count, evened, ends, strict=True)]
    whole = gradients.reduce(gradients.central_differences(volume, spacing))
    part = tuple(slice(i // 2, i // 2 + -(-m // 2)) for i, m in zip(start, count, strict=True))
    for threads in (1, 2):
        found = gradients.reduced_differences(
            volume, spacing, start_zyx=start, shape_zyx=count, threads=threads
        )
        assert found.tobytes() == whole[part].tobytes()
    plain = np.empty_like(whole[part])
    at = (tuple(start), tuple(count))
    assert _native.reduced_differences_into(volume, *at, spacing, plain, simd=False) is None
    assert plain.tobytes() == whole[part].tobytes()


def test_a_part_that_is_not_there_is_refused() -> None:
    volume = np.zeros((4, 4, 4), np.uint8)
    for start, shape in (((0, 0, 4), (1, 1, 1)), ((0, 0, 2), (1, 1, 3)), ((-2, 0, 0), (1, 1, 1))):
        with pytest.raises(InvalidInputError, match="part"):
            gradients.reduced_differences(volume, start_zyx=start, shape_zyx=shape)
    volume = np.zeros((4, 4, 4), np.float32)
    volume[2, 1, 3] = np.inf
    with pytest.raises(NotFiniteError, match=r"\(2, 1, 3\)"):
        gradients.reduced_differences(volume)


def test_unsigned_differences_do_not_wrap() -> None:
    volume = np.array([[[255, 0, 255, 1]]], np.uint8)
    gradient = gradients.central_differences(volume)[0, 0]
    np.testing.assert_array_equal(gradient[:, 0], [-255, 0, 0.5, -254])
    np.testing.assert_array_equal(gradient[:, 1:], 0)


def test_the_greatest_floats_do_not_overflow_and_keep_their_direction() -> None:
    volume = np.array([[[-LARGEST, LARGEST], [LARGEST, LARGEST]]], np.float32)
    gradient = gradients.central_differences(volume)
    assert np.isfinite(gradient).all()
    np.testing.assert_array_equal(gradient[0, 0, 0], np.float32([LARGEST, LARGEST, 0]))
    inside = gradients.central_differences(np.array([[[-LARGEST, 0, LARGEST]]], np.float32))
    assert inside[0, 0, 1, 0] == np.float32(LARGEST)
    tiny = gradients.central_differences(np.array([[[0, 255]]], np.uint8), (1, 1, 1e-150))
    assert tiny[0, 0, 0, 0] == np.float32(LARGEST)


def test_constant_and_single_voxels_have_no_gradient(dtype: np.dtype[Any]) -> None:
    for shape in ((1, 1, 1), (3, 4, 5), (1, 7, 1)):
        assert not gradients.central_differences(np.full(shape, 77, dtype)).any()


def test_any_strides_give_the_same(noise: Any) -> None:
    volume = noise((6, 9, 8), "int16")
    strided = volume[::-1, ::2, ::3]
    np.testing.assert_array_equal(
        gradients.central_differences(strided), gradients.central_differences(strided.copy())
    )
    foreign = volume.astype(">i2")
    foreign.flags.writeable = False
    gradient = gradients.central_differences(volume)
    np.testing.assert_array_equal(gradients.central_differences(foreign), gradient)
    np.testing.assert_array_equal(
        gradients.reduce(gradient.astype(">f4")[::-1]), gradients.reduce(gradient[::-1].copy())
    )


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_voxel_that_is_not_finite_is_named(bad: float) -> None:
    volume = np.zeros((4, 5, 6), np.float32)
    volume[2, 3, 4] = volume[3, 0, 0] = bad
    for threads in (1, 3):
        with pytest.raises(NotFiniteError, match=r"\(2, 3, 4\)"):
            gradients.central_differences(volume, threads=threads)


@pytest.mark.parametrize("spacing", [(1, 1), (1, 0, 1), (1, -1, 1), (1, np.nan, 1), (1e200, 1, 1)])
def test_impossible_spacings_are_refused(spacing: tuple[float, ...]) -> None:
    with pytest.raises(InvalidInputError, match="spacing_zyx"):
        gradients.central_differences(np.zeros((2, 2, 2), np.uint8), spacing)


def test_a_single_gradient_among_zeros_wins_entirely() -> None:
    fine = np.zeros((4, 4, 4, 3), np.float32)
    fine[1, 0, 1] = (3, -4, 12)
    coarse = gradients.reduce(fine)
    np.testing.assert_array_equal(coarse[0, 0, 0], np.float32([3, -4, 12]))
    assert np.count_nonzero(coarse.any(axis=-1)) == 1


def test_the_stronger_gradient_weighs_more() -> None:
    fine = np.zeros((2, 2, 2, 3), np.float32)
    fine[0, 0, 0], fine[1, 1, 1] = (3, 0, 0), (0, 1, 0)
    np.testing.assert_array_equal(gradients.reduce(fine)[0, 0, 0], np.float32([9 / 4, 1 / 4, 0]))


def test_the_kernel_is_centred_on_the_coarse_voxel() -> None:
    """An odd kernel would be half a voxel off the means of 2×2×2 that it shades."""
    fine = np.zeros((8, 8, 8, 3), np.float32)
    fine[...] = (0, 0, 1)
    fine[3, 3, 3] = fine[4, 4, 4] = (1, 0, 0)
    coarse = gradients.reduce(fine, radius=2, sigma=1.0)
    np.testing.assert_array_equal(coarse[1, 1, 1], coarse[2, 2, 2])


@pytest.mark.parametrize("sigma", [1e-300, 1e-3, 1e300])
def test_no_sigma_makes_the_weights_vanish(sigma: float) -> None:
    fine = np.full((5, 5, 5, 3), (1, 2, 3), np.float32)
    np.testing.assert_allclose(
        gradients.reduce(fine, 3, sigma), np.full((3, 3, 3, 3), (1, 2, 3)), rtol=1e-6
    )


@pytest.mark.parametrize("size", [1e-45, LARGEST])
def test_extreme_magnitudes_survive_reduction(size: float) -> None:
    fine = np.full((2, 2, 2, 3), (size, 0, -size), np.float32)
    np.testing.assert_array_equal(gradients.reduce(fine)[0, 0, 0], np.float32([size, 0, -size]))


def test_wrong_arguments_of_the_reduction_are_refused() -> None:
    fine = np.zeros((2, 2, 2, 3), np.float32)
    for radius, sigma in ((0, 1.0), (17, 1.0), (1, 0.0), (1, np.nan), (1, np.inf)):
        with pytest.raises(InvalidInputError, match="radius"):
            gradients.reduce(fine, radius, sigma)
    with pytest.raises(InvalidInputError, match="shape"):
        gradients.reduce(fine[..., :2])
    with pytest.raises(UnsupportedError, match="float64"):
        gradients.reduce(fine.astype(np.float64))  # type: ignore[arg-type]
