"""Gradients at the extremes: no NaN, and directions within 0.1731°, in numpy, C++ and shaders."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from octobrick.codec import _native, gradients, metrics
from octobrick.codec.errors import InvalidInputError, NotFiniteError, UnsupportedError

from .table import holds
from .ways_to_filter import GradientWay

WORST_DEGREES = 0.1731
INTEGERS = ("uint8", "int8", "uint16", "int16")
FLOAT_MAX = np.finfo(np.float32).max
TINY = np.finfo(np.float32).smallest_subnormal
UNEVEN = [(17, 13, 11), (20, 17, 32), (5, 86, 3), (1, 3, 5)]


def require_directions(way: GradientWay, vectors: NDArray[Any]) -> NDArray[Any]:
    """Of length 1 and near where the vectors are not 0, exactly 0 where they are."""
    decoded = way.coded(vectors)
    assert np.isfinite(decoded).all()
    zero = ~vectors.any(axis=-1)
    np.testing.assert_array_equal(decoded[zero], 0)
    if not zero.all():
        # Scaled, as float32 has no squares of the greatest and the least.
        wide = vectors[~zero].astype(np.float64)
        wide /= np.abs(wide).max(axis=-1, keepdims=True)
        assert metrics.angular_error(wide, decoded[~zero]).max() <= WORST_DEGREES
        np.testing.assert_allclose(np.linalg.norm(decoded[~zero], axis=-1), 1, atol=1e-6)
    return decoded


@holds("gradients", "empty-input", "cpp")
def test_no_voxels_are_refused_and_no_vectors_have_no_codes(implementation: str) -> None:
    with pytest.raises(InvalidInputError, match=r"\(4, 0, 4\)"):
        gradients.central_differences(np.empty((4, 0, 4), np.uint8))
    with pytest.raises(InvalidInputError, match=r"\(0, 2, 2, 3\)"):
        gradients.reduce(np.empty((0, 2, 2, 3), np.float32))
    assert gradients.encode_directions(np.empty((0, 3), np.float32)).shape == (0, 3)
    assert gradients.decode_directions(np.empty((2, 0, 3), np.uint8)).shape == (2, 0, 3)


@pytest.mark.parametrize("axis", [0, 1, 2])
@holds("gradients", "one-voxel", "numpy", "cpp", "glsl")
def test_an_axis_of_one_voxel_has_no_derivative_and_disturbs_no_other(
    directions: GradientWay, noise: Any, axis: int
) -> None:
    shape = [6, 7, 8]
    shape[axis] = 1
    volume = noise(tuple(shape), "int16")
    gradient = directions.differences(volume)
    assert not gradient[..., 2 - axis].any()
    others = [i for i in range(3) if i != axis]
    for i, along in zip(others, np.gradient(volume.astype(np.float64), axis=others), strict=True):
        np.testing.assert_allclose(gradient[..., 2 - i], along, rtol=1e-6, atol=1e-6)
    require_directions(directions, gradient)


@holds("gradients", "one-voxel", "numpy", "cpp", "glsl")
def test_one_voxel_has_no_gradient_and_reduces_to_itself(directions: GradientWay) -> None:
    none = directions.differences(np.full((1, 1, 1), 200, np.uint8))
    np.testing.assert_array_equal(none, np.zeros((1, 1, 1, 3)))
    np.testing.assert_array_equal(require_directions(directions, none), 0)
    one = np.full((1, 1, 1, 3), (1, 2, 3), np.float32)
    np.testing.assert_array_equal(directions.reduce(one), one)


@pytest.mark.parametrize("shape", UNEVEN)
@holds("gradients", "uneven", "numpy", "cpp", "glsl")
def test_odd_extents_reduce_to_half_of_them_and_keep_a_gradient_up_to_the_faces(
    directions: GradientWay, shape: tuple[int, int, int]
) -> None:
    fine = np.full((*shape, 3), (3, -1, 2), np.float32)
    coarse = directions.reduce(fine)
    assert coarse.shape == (*(-(-n // 2) for n in shape), 3)
    np.testing.assert_allclose(coarse, np.broadcast_to(fine[0, 0, 0], coarse.shape), rtol=1e-6)
    require_directions(directions, coarse)


@holds("gradients", "constant", "numpy", "cpp", "glsl")
def test_one_value_has_no_gradient(directions: GradientWay) -> None:
    for dtype, value in (("uint8", 255), ("int16", -32768), ("float32", 3.4e38), ("float32", -0.0)):
        gradient = directions.differences(np.full((5, 6, 7), value, dtype))
        np.testing.assert_array_equal(gradient, np.zeros((5, 6, 7, 3)))
        np.testing.assert_array_equal(directions.reduce(gradient), np.zeros((3, 3, 4, 3)))
        require_directions(directions, gradient)


@pytest.mark.parametrize("dtype", INTEGERS)
@holds("gradients", "full-range", "numpy", "cpp", "glsl")
def test_differences_of_a_whole_range_do_not_wrap(directions: GradientWay, dtype: str) -> None:
    info = np.iinfo(dtype)
    step = np.full((4, 4, 8), info.min, dtype)
    step[..., 4:] = info.max
    gradient = directions.differences(step)
    reach = float(info.max) - info.min
    np.testing.assert_array_equal(
        gradient[..., 0], np.broadcast_to([0, 0, 0, reach / 2, reach / 2, 0, 0, 0], step.shape)
    )
    falling = directions.differences(step[..., ::-1].copy())
    np.testing.assert_array_equal(falling[..., 0], -gradient[..., ::-1, 0])
    require_directions(directions, gradient)


@pytest.mark.parametrize("dtype", ["uint32", "int64", "float64"])
@holds("gradients", "wide-integers", "cpp")
def test_wider_types_are_refused_by_name(implementation: str, dtype: str) -> None:
    with pytest.raises(UnsupportedError, match=dtype):
        gradients.central_differences(np.ones((4, 4, 4), dtype))
    with pytest.raises(UnsupportedError, match="int32"):
        gradients.encode_directions(np.ones((4, 3), np.int32))


@holds("gradients", "greatest-floats", "numpy", "cpp", "glsl")
def test_differences_beyond_float32_are_scaled_and_keep_their_direction(
    directions: GradientWay,
) -> None:
    rng = np.random.default_rng(5)
    volume = (rng.uniform(-1, 1, (5, 6, 7)) * FLOAT_MAX).astype(np.float32)
    volume[2, 3, 3], volume[2, 3, 4] = -FLOAT_MAX, FLOAT_MAX
    gradient = directions.differences(volume, (0.5, 1, 2))
    assert np.isfinite(gradient).all()
    exact = np.stack(np.gradient(volume.astype(np.float64), 0.5, 1, 2)[::-1], axis=-1)
    exact /= np.abs(exact).max(axis=-1, keepdims=True)
    scaled = gradient.astype(np.float64) / np.abs(gradient).max(axis=-1, keepdims=True)
    np.testing.assert_allclose(scaled, exact, atol=1e-6)
    require_directions(directions, gradient)
    assert np.isfinite(directions.reduce(gradient)).all()


@holds("gradients", "denormals", "numpy", "cpp", "glsl")
def test_a_slope_of_denormals_is_kept(directions: GradientWay) -> None:
    """The shader sees codes alone, in which there is nothing denormal."""
    ramp = (np.arange(8, dtype=np.float32) * TINY).reshape(1, 1, 8)
    gradient = directions.differences(ramp)
    np.testing.assert_array_equal(gradient[0, 0], np.outer(np.ones(8), [TINY, 0, 0]))
    require_directions(directions, gradient)


@holds("gradients", "signed-zero", "numpy", "cpp", "glsl")
def test_the_sign_of_zero_is_no_direction(directions: GradientWay) -> None:
    zeros = np.array([(-0.0, 0.0, -0.0), (0.0, 0.0, 0.0), (-0.0, -0.0, -0.0)], np.float32)
    np.testing.assert_array_equal(require_directions(directions, zeros), 0)
    plus, minus = np.array([(1, 0.0, 2)], np.float32), np.array([(1, -0.0, 2)], np.float32)
    np.testing.assert_array_equal(directions.coded(plus), directions.coded(minus))
    np.testing.assert_array_equal(directions.reduce(zeros.reshape(1, 1, 3, 3)), 0)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@holds("gradients", "not-finite", "cpp")
def test_what_is_not_finite_is_refused_by_its_place(implementation: str, bad: float) -> None:
    volume = np.zeros((4, 5, 6), np.float32)
    volume[1, 2, 3] = bad
    with pytest.raises(NotFiniteError) as caught:
        gradients.central_differences(volume)
    assert "(1, 2, 3)" in caught.value.message
    vectors = np.ones((2, 3, 3), np.float32)
    vectors[1, 2, 0] = bad
    with pytest.raises(NotFiniteError, match=r"\(1, 2\)"):
        gradients.encode_directions(vectors)


@holds("gradients", "no-gradients", "numpy", "cpp", "glsl")
def test_zero_reduces_to_zero_and_a_single_gradient_wins_entirely(directions: GradientWay) -> None:
    for zero in (0.0, -0.0):
        field = np.full((5, 4, 3, 3), zero, np.float32)
        np.testing.assert_array_equal(directions.reduce(field), np.zeros((3, 2, 2, 3)))
        np.testing.assert_array_equal(require_directions(directions, field), 0)
    field = np.zeros((6, 6, 6, 3), np.float32)
    field[2, 3, 4] = (3, -4, 12)
    coarse = directions.reduce(field)
    np.testing.assert_allclose(coarse[1, 1, 2], (3, -4, 12), rtol=1e-6)
    assert np.count_nonzero(coarse.any(axis=-1)) == 1
    assert np.count_nonzero(require_directions(directions, coarse).any(axis=-1)) == 1


@pytest.mark.parametrize("size", [5e-324, 1e-310, 1e-160, 1e-30, 1, 1e30, 1e160, 1e308])
@holds("gradients", "magnitudes", "numpy", "cpp", "glsl")
def test_length_does_not_matter(directions: GradientWay, size: float) -> None:
    rng = np.random.default_rng(7)
    unit = rng.normal(size=(400, 3))
    unit /= np.abs(unit).max(axis=-1, keepdims=True)
    vectors = unit * size  # the least have components of 0 and of 1 only
    require_directions(directions, np.concatenate([vectors, [(size, 0, 0), (-size, size, -size)]]))


@holds("gradients", "magnitudes", "numpy", "cpp", "glsl")
def test_float32_vectors_from_denormal_to_huge_survive_reduction(directions: GradientWay) -> None:
    for size in (float(TINY), 1e-38, 1e-20, 1.0, 1e20, 1e38):
        field = (np.ones((2, 2, 2, 3)) * (1, 0, 2) * size).astype(np.float32)
        coarse = directions.reduce(field)
        np.testing.assert_allclose(coarse[0, 0, 0], field[0, 0, 0], rtol=1e-6)
        require_directions(directions, coarse)


@holds("gradients", "region-borders", "numpy", "cpp", "glsl")
def test_borders_of_regions_are_within_the_bound_and_alike_from_either_side(
    directions: GradientWay,
) -> None:
    signs = list(itertools.product((1, -1), repeat=3))
    t = np.linspace(0, 1, 17)
    families = [
        (1, 0 * t, 0 * t),
        (1 + 0 * t, 1 + 0 * t, t),
        (1 + 0 * t, t, t),
        (1 + 0 * t, t, 0 * t),
    ]
    lines = np.concatenate(
        [np.stack(np.broadcast_arrays(*family), axis=-1) for family in families]
    ).astype(np.float64)
    vectors = np.concatenate(
        [lines[:, order] * sign for order in itertools.permutations(range(3)) for sign in signs]
    )
    decoded, sizes = np.abs(require_directions(directions, vectors)), np.abs(vectors)
    for a, b in ((0, 1), (0, 2), (1, 2)):
        alike = sizes[:, a] == sizes[:, b]
        assert alike.any()
        np.testing.assert_allclose(decoded[alike, a], decoded[alike, b], atol=1e-7)


@pytest.mark.parametrize("ratio", [2.0**-10, 2.0, 1024.0, 65536.0])
@holds("gradients", "anisotropic", "numpy", "cpp", "glsl")
def test_differences_count_in_world_units(directions: GradientWay, ratio: float) -> None:
    """A plane across (1, 1, 1) in the world keeps that normal, however long voxels are."""
    z, y, x = np.indices((5, 6, 7))
    volume = (x + y + z * ratio).astype(np.float32)
    gradient = directions.differences(volume, (ratio, 1, 1))
    np.testing.assert_allclose(gradient, np.ones((5, 6, 7, 3)), rtol=1e-6)
    require_directions(directions, gradient)


@holds("gradients", "threads-and-instructions", "cpp")
def test_neither_threads_nor_instructions_change_a_bit(implementation: str, noise: Any) -> None:
    volume = noise((9, 10, 41), "float32")
    field = gradients.central_differences(volume, threads=1)
    codes, vectors = np.empty(field.shape, np.uint8), np.empty_like(field)
    _native.encode_directions_into(field, codes, 1, False)
    _native.decode_directions_into(codes, vectors, 1, False)
    coarse = gradients.reduce(field, threads=1).tobytes()
    for threads, simd in ((1, True), (3, False), (7, True)):
        assert gradients.central_differences(volume, threads=threads).tobytes() == field.tobytes()
        assert gradients.reduce(field, threads=threads).tobytes() == coarse
        again, back = np.empty_like(codes), np.empty_like(vectors)
        _native.encode_directions_into(field, again, threads, simd)
        _native.decode_directions_into(codes, back, threads, simd)
        assert again.tobytes() == codes.tobytes()
        assert back.tobytes() == vectors.tobytes()
        part = np.empty((5, 5, 21, 3), np.float32)
        _native.reduced_differences_into(
            volume, (0, 0, 0), volume.shape, (1, 1, 1), part, threads, simd
        )
        assert part.tobytes() == coarse
