"""Histograms that add up exactly without knowing the range of the whole."""

from __future__ import annotations

from functools import reduce
from operator import add
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from octobrick.codec import _native
from octobrick.codec.errors import InvalidInputError, NotFiniteError
from octobrick.codec.metrics import Histogram, histogram
from octobrick.codec.metrics.histogram import BINS_MAX


def of(volume: np.ndarray[Any, Any]) -> Histogram:
    return histogram(volume, volume.min(), volume.max())


def expected(volume: np.ndarray[Any, Any], found: Histogram) -> np.ndarray[Any, Any]:
    bins = np.floor(volume.astype(np.float64) / found.width).astype(np.int64) - found.first
    return np.bincount(bins.ravel(), minlength=found.counts.size)


def test_every_byte_has_a_bin_of_its_own(noise: Any) -> None:
    volume = noise((9, 8, 7), "uint8")
    found = of(volume)
    assert found.exponent == 0
    np.testing.assert_array_equal(found.counts, np.bincount(volume.ravel())[volume.min() :])


@given(
    st.sampled_from(["uint8", "int8", "uint16", "int16", "float32"]),
    st.floats(1e-30, 1e30),
    st.integers(0, 999),
)
@settings(max_examples=60, deadline=None)
def test_parts_add_up_to_the_whole_in_any_order(dtype: str, size: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    drift = np.cumsum(rng.normal(size=(6, 5, 7)), axis=0) * 20
    volume = (drift * size if dtype == "float32" else drift.astype(np.int64)).astype(dtype)
    parts = [of(plane[np.newaxis]) for plane in volume]
    whole = reduce(add, parts, Histogram())
    np.testing.assert_array_equal(whole.counts, expected(volume, whole))
    assert whole.total == volume.size
    assert whole.counts.size <= BINS_MAX
    order = rng.permutation(len(parts))
    other = reduce(add, [parts[i] for i in order], Histogram())
    assert (other.exponent, other.first) == (whole.exponent, whole.first)
    np.testing.assert_array_equal(other.counts, whole.counts)


def test_bins_are_fine_next_to_the_range(dtype: np.dtype[Any], noise: Any) -> None:
    volume = noise((8, 8, 8), dtype)
    found = of(volume)
    span = float(volume.max()) - float(volume.min())
    assert found.width <= max(1.0 if dtype.kind != "f" else 0.0, 4 * span / BINS_MAX)


@pytest.mark.parametrize(
    "values",
    [
        [3.4e38, -3.4e38, 0],
        [1e-45, 3e-45, 0],
        [1e8, 1e8 + 8, 1e8 + 16],
        [5, 5, 5],
        [0, 0, 0],
        [-0.0, 1e-30, 1e30],
    ],
)
def test_the_extremes_are_counted(values: list[float]) -> None:
    volume = np.array([[values]], np.float32)
    found = of(volume)
    assert found.total == 3
    assert found.counts.size <= BINS_MAX
    assert found.low <= float(volume.min())
    assert found.low + found.counts.size * found.width >= float(volume.max())


def test_quantiles_are_numpys_to_a_bin(noise: Any) -> None:
    volume = noise((20, 20, 20), "uint16")
    found = of(volume)
    for share in (0, 0.01, 0.5, 0.999, 1):
        exact = np.quantile(volume, share, method="inverted_cdf")
        assert abs(found.quantile(share) - float(exact)) <= found.width
    with pytest.raises(InvalidInputError, match="quantile"):
        Histogram().quantile(0.5)


def test_strides_and_instructions_do_not_matter(dtype: np.dtype[Any], noise: Any) -> None:
    volume = noise((9, 10, 11), dtype)[::-1, ::2, ::3]
    found = of(volume)
    assert found.total == volume.size
    plain = np.zeros(found.counts.size, np.uint64)
    assert _native.count_values_into(volume, found.exponent, found.first, plain, simd=False)
    np.testing.assert_array_equal(plain, found.counts)


def test_bounds_that_do_not_hold_and_nan_are_refused() -> None:
    volume = np.array([[[1, 2, 9]]], np.uint8)
    with pytest.raises(InvalidInputError, match=r"1 to 9.*1\.0 to 8\.0"):
        histogram(volume, 1, 8)
    with pytest.raises(NotFiniteError, match="NaN"):
        histogram(np.array([[[np.nan, 1]]], np.float32), 0, 1)
    with pytest.raises(InvalidInputError, match="finite"):
        histogram(volume, 0, np.inf)
