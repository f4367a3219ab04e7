"""What a sample of an S3Dc code fetches: claims S13 to S16, counted by the code that fetches."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from octobrick.codec import S3dc, _native

NEAREST = _native.Sampling.NEAREST
TRILINEAR = _native.Sampling.TRILINEAR
SHARED = _native.Sampling.TRILINEAR_SHARED

Array = NDArray[Any]
Zyx = tuple[int, int, int]


def fetches_per_sample(
    codec: S3dc, how: _native.Sampling, shape: Zyx, at: Array
) -> tuple[float, float]:
    """End points and words, on average."""
    code = codec.encode(np.random.default_rng(1).integers(0, 255, shape).astype(np.uint8))
    sampler = _native.S3dcSampler(code, shape, 0, codec.block, codec.bits)
    ends, words = sampler.count_fetches(how, at)
    return ends / len(at), words / len(at)


@pytest.mark.parametrize("bits", [1, 2, 4, 8])
@pytest.mark.parametrize("edge", [4, 8, 16])
def test_nearest_takes_2_fetches_and_trilinear_16(bits: int, edge: int) -> None:
    codec, shape = S3dc((edge,) * 3, bits), (20, 20, 40)
    at = np.random.default_rng(1).uniform(-1, 42, (500, 3))
    assert fetches_per_sample(codec, NEAREST, shape, at) == (1, 1)
    assert fetches_per_sample(codec, TRILINEAR, shape, at) == (8, 8)


@pytest.mark.parametrize("bits", [1, 2, 4, 8])
@pytest.mark.parametrize("edge", [4, 8, 16])
def test_shared_fetches_are_those_of_claim_s15(bits: int, edge: int) -> None:
    """4 (1 + bits/16) words and (1 + 1/b)^3 end points, away from the faces."""
    codec, shape = S3dc((edge,) * 3, bits), (50, 50, 50)
    at = np.random.default_rng(7).uniform(0.5, 48.5, (100_000, 3))  # 48 is whole blocks and words
    ends, words = fetches_per_sample(codec, SHARED, shape, at)
    assert words == pytest.approx(4 * (1 + bits / 16), rel=0.02)
    assert ends == pytest.approx((1 + 1 / edge) ** 3, rel=0.02)


def test_shared_takes_6_point_2_fetches_at_4_bits_and_blocks_of_16() -> None:
    codec, shape = S3dc((16, 16, 16), 4), (50, 50, 50)
    at = np.random.default_rng(8).uniform(0.5, 48.5, (100_000, 3))
    assert sum(fetches_per_sample(codec, SHARED, shape, at)) == pytest.approx(6.2, abs=0.02)


@pytest.mark.parametrize(
    ("point", "fetches"),
    [
        ((2, 2, 2), (1, 4)),  # in one block and, of 4 indices, in one word
        ((4, 2, 2), (1, 8)),  # words meet at 4
        ((16, 2, 2), (2, 8)),  # blocks and words
        ((2, 16, 2), (2, 4)),
        ((2, 16, 16), (4, 4)),
        ((16, 16, 2), (4, 8)),
        ((16, 2, 16), (4, 8)),
        ((16, 16, 16), (8, 8)),
        ((-5, -5, -5), (1, 4)),
        ((99, 99, 99), (1, 4)),
    ],
)
def test_shared_takes_5_to_16_fetches_by_what_the_eight_have_in_common(
    point: tuple[int, int, int], fetches: tuple[int, int]
) -> None:
    codec = S3dc((16, 16, 16), 4)
    assert fetches_per_sample(codec, SHARED, (32, 32, 32), np.array([point], float)) == fetches


@pytest.mark.parametrize(
    ("shape", "fetches"),
    [((1, 1, 1), (1, 1)), ((1, 1, 9), (1, 1)), ((1, 9, 9), (1, 2)), ((9, 1, 9), (1, 2))],
)
def test_an_axis_of_length_1_is_fetched_once(shape: Zyx, fetches: tuple[int, int]) -> None:
    assert fetches_per_sample(S3dc((9, 9, 9), 4), SHARED, shape, np.ones((1, 3))) == fetches


@pytest.mark.parametrize("bits", [3, 5, 6, 7])
def test_indices_that_reach_into_the_next_word_are_counted_as_two(bits: int) -> None:
    codec, shape = S3dc((8, 8, 8), bits), (3, 3, 64)
    crossing = sum(x * bits // 16 != (x * bits + bits - 1) // 16 for x in range(64))
    ends, words = fetches_per_sample(
        codec,
        NEAREST,
        shape,
        np.ascontiguousarray(np.indices(shape).reshape(3, -1).T[:, ::-1] + 0.5),
    )
    assert (ends, words) == (1, 1 + crossing / 64)
