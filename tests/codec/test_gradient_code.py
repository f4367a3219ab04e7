"""Directions in three bytes: how far off they are, also at the edges, and between codes."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from octobrick.codec import gradients
from octobrick.codec import reference_gradients as reference
from octobrick.codec.errors import InvalidInputError, NotFiniteError, UnsupportedError
from octobrick.codec.metrics import angular_error

WORST_DEGREES = 0.1731
MEAN_DEGREES = 0.029
Vectors = NDArray[Any]


def random_vectors(count: int, seed: int = 1) -> Vectors:
    return np.random.default_rng(seed).normal(size=(count, 3)).astype(np.float32)


def round_trip(vectors: Vectors) -> Vectors:
    return gradients.decode_directions(gradients.encode_directions(vectors))


def border_vectors() -> Vectors:
    """Axes, diagonals and points on every border of the 48 regions, in all signs and orders."""
    points = [(1, 0, 0), (1, 1, 0), (1, 1, 1), (1, 0.498, 0), (1, 0.5, 0.5), (1, 1, 0.25)]
    turned = {p for point in points for p in itertools.permutations(point)}
    signs = list(itertools.product((1, -1), repeat=3))
    return np.array([np.multiply(p, s) for p in sorted(turned) for s in signs], np.float32)


def test_random_directions_are_within_the_bound_and_close_on_average() -> None:
    vectors = random_vectors(1_000_000)
    error = angular_error(vectors, round_trip(vectors))
    assert error.max() <= WORST_DEGREES
    assert error.mean() <= MEAN_DEGREES


def test_directions_on_region_borders_are_within_the_bound() -> None:
    vectors = border_vectors()
    assert angular_error(vectors, round_trip(vectors)).max() <= WORST_DEGREES
    beside = (vectors[:, np.newaxis] + random_vectors(40, 2) * 1e-5).reshape(-1, 3)
    assert angular_error(beside, round_trip(beside)).max() <= WORST_DEGREES


def test_around_the_largest_hole_the_bound_is_met_and_nearly_reached() -> None:
    rng = np.random.default_rng(12)
    p, q = rng.uniform(0.49, 0.51, 300_000), rng.uniform(0, 1e-3, 300_000)
    vectors = np.column_stack([np.ones_like(p), p, q])
    worst = angular_error(vectors, round_trip(vectors)).max()
    assert 0.170 < worst <= WORST_DEGREES


@pytest.mark.parametrize(("percent", "expected"), [(61, 0.17303), (0, 0.31776)])
def test_largest_hole_is_that_of_the_papers_table_1(percent: int, expected: float) -> None:
    least, most = reference.largest_hole(percent)
    assert least == pytest.approx(expected, abs=4e-5)
    assert most == pytest.approx(expected, abs=4e-5)
    assert most - least < 4e-5


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_native_codes_are_those_of_the_reference(dtype: str) -> None:
    vectors = np.concatenate([random_vectors(20_000, 3), border_vectors()]).astype(dtype)
    np.testing.assert_array_equal(
        gradients.encode_directions(vectors), reference.encode_directions(vectors)
    )


def test_every_byte_decodes_to_the_bits_of_the_reference() -> None:
    edge = np.array([0, 1, 84, 126, 127, 128, 129, 200, 254, 255], np.uint8)
    codes = np.stack(np.meshgrid(edge, edge, edge), axis=-1)
    noise = np.random.default_rng(4).integers(0, 256, (50_000, 3), np.uint8)
    for code in (codes, noise):
        decoded = gradients.decode_directions(code)
        assert decoded.tobytes() == reference.decode_directions(code).tobytes()
        length = np.linalg.norm(decoded.astype(np.float64), axis=-1)
        zero = ((code == 127) | (code == 128)).all(axis=-1)
        np.testing.assert_allclose(length, np.where(zero, 0, 1), atol=3e-7)


@pytest.mark.parametrize("simd", [True, False])
@pytest.mark.parametrize("threads", [1, 2, 3])
def test_neither_threads_nor_instructions_change_a_code(simd: bool, threads: int) -> None:
    from octobrick.codec import _native

    vectors = random_vectors(9_001, 5)
    codes, decoded = np.empty(vectors.shape, np.uint8), np.empty(vectors.shape, np.float32)
    assert _native.encode_directions_into(vectors, codes, threads, simd) is None
    _native.decode_directions_into(codes, decoded, threads, simd)
    np.testing.assert_array_equal(codes, reference.encode_directions(vectors))
    np.testing.assert_array_equal(decoded, reference.decode_directions(codes))


def test_zero_has_its_own_code_and_decodes_to_zero() -> None:
    zeros = np.array([(0, 0, 0), (-0.0, 0, -0.0)], np.float32)
    codes = gradients.encode_directions(zeros)
    np.testing.assert_array_equal(codes, 128)
    np.testing.assert_array_equal(gradients.decode_directions(codes), 0)


@given(
    st.lists(st.floats(-1, 1), min_size=3, max_size=3).filter(lambda v: max(map(abs, v)) > 0.1),
    st.integers(-1070, 1020),
)
@settings(max_examples=100, deadline=None)
def test_length_does_not_matter_from_denormal_to_huge(vector: list[float], power: int) -> None:
    scaled = np.ldexp(np.array(vector), power)
    if not np.abs(scaled).max():
        return
    assert angular_error(scaled, round_trip(scaled)) <= WORST_DEGREES


@pytest.mark.parametrize("length", [5e-324, 1e-45, 1e308])
def test_the_least_and_the_greatest_gradients_keep_their_direction(length: float) -> None:
    vectors = np.array([(length, 0, 0), (0, -length, 0), (length, length, length)])
    decoded = round_trip(vectors)
    assert angular_error(np.sign(vectors), decoded).max() < 0.13


def test_the_sign_of_zero_does_not_matter() -> None:
    plus, minus = np.array([[1.0, 0.0, 0.5]]), np.array([[1.0, -0.0, 0.5]])
    np.testing.assert_array_equal(
        gradients.encode_directions(plus), gradients.encode_directions(minus)
    )


def test_the_cubes_symmetries_turn_the_code_with_the_vector() -> None:
    vectors = random_vectors(500, 6)
    codes = gradients.encode_directions(vectors).astype(int) * 2 - 255
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1, -1), repeat=3):
            turned = vectors[:, order] * np.array(signs, np.float32)
            found = gradients.encode_directions(turned).astype(int) * 2 - 255
            np.testing.assert_array_equal(found, codes[:, order] * np.array(signs))


def test_interpolated_codes_decode_between_their_ends() -> None:
    """As a texture does it: the angle from one end grows, and the way keeps near the arc."""
    first = random_vectors(3000, 7)
    second = first + 0.5 * random_vectors(3000, 8)
    ends = [gradients.encode_directions(v).astype(np.float64) * 2 - 255 for v in (first, second)]
    start = reference.decode(ends[0])
    goal = reference.decode(ends[1])
    whole = angular_error(start, goal)
    before = np.zeros(len(start))
    normal = np.cross(start.astype(np.float64), goal.astype(np.float64))
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    for t in np.linspace(0, 1, 21):
        between = reference.decode((1 - t) * ends[0] + t * ends[1])
        angle = angular_error(start, between)
        assert (angle >= before - 1e-5).all(), t
        assert (angle <= whole + 1e-5).all(), t
        off_arc = np.degrees(np.arcsin(np.abs((between * normal).sum(axis=1))))
        assert (off_arc <= np.maximum(whole, 1) / 3).all(), t
        before = angle


def test_shape_is_kept_and_empty_is_fine() -> None:
    vectors = random_vectors(24, 9).reshape(2, 3, 4, 3)
    assert gradients.encode_directions(vectors).shape == vectors.shape
    strided = vectors[:, ::2, ::-1]
    np.testing.assert_array_equal(
        gradients.encode_directions(strided), gradients.encode_directions(strided.copy())
    )
    empty = gradients.encode_directions(np.empty((0, 3), np.float32))
    assert gradients.decode_directions(empty).shape == (0, 3)


def test_foreign_bytes_and_odd_addresses_give_the_same() -> None:
    vectors = random_vectors(100, 11)
    expected = gradients.encode_directions(vectors)
    unaligned = np.frombuffer(b"x" + vectors.tobytes(), np.float32, offset=1).reshape(-1, 3)
    assert not unaligned.flags.aligned
    assert not unaligned.flags.writeable
    for same in (vectors.astype(">f4"), vectors.astype(">f8"), unaligned):
        np.testing.assert_array_equal(gradients.encode_directions(same), expected)
    read_only = expected.copy()
    read_only.flags.writeable = False
    np.testing.assert_array_equal(
        gradients.decode_directions(read_only), gradients.decode_directions(expected)
    )


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_is_refused_by_its_place(bad: float) -> None:
    vectors = random_vectors(8192, 10).reshape(64, 128, 3)
    vectors[50, 7, 1] = bad
    vectors[60, 0, 0] = np.nan
    for threads in (1, 2):
        with pytest.raises(NotFiniteError, match=r"vector at \(50, 7\)") as caught:
            gradients.encode_directions(vectors, threads=threads)
        assert caught.value.facts["vector_index"] == [50, 7]


def test_wrong_shapes_and_types_are_refused() -> None:
    with pytest.raises(InvalidInputError, match="last axis"):
        gradients.encode_directions(np.zeros((3, 2), np.float32))
    with pytest.raises(InvalidInputError, match="last axis"):
        gradients.decode_directions(np.zeros((), np.uint8))
    with pytest.raises(UnsupportedError, match="int64"):
        gradients.encode_directions(np.zeros((1, 3), np.int64))
    with pytest.raises(UnsupportedError, match="float32"):
        gradients.decode_directions(np.zeros((1, 3), np.float32))  # type: ignore[arg-type]
    with pytest.raises(InvalidInputError, match="threads"):
        gradients.encode_directions(np.zeros((1, 3), np.float32), threads=0)
