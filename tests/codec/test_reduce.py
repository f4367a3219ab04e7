"""Coarser levels: exact means, whatever the shape, strides, threads or instructions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from octobrick.codec import _native, reduce, reference
from octobrick.codec.errors import InvalidInputError, UnsupportedError

any_float = st.floats(width=32, allow_nan=False, allow_infinity=False)
any_array = st.sampled_from(["uint8", "int8", "uint16", "int16", "float32"]).flatmap(
    lambda dtype: hnp.arrays(
        dtype,
        hnp.array_shapes(min_dims=3, max_dims=3, max_side=19),
        elements=any_float if dtype == "float32" else hnp.from_dtype(np.dtype(dtype)),
    )
)


@given(any_array, st.booleans())
@settings(max_examples=150, deadline=None)
def test_native_mean_is_that_of_the_reference(array: NDArray[Any], simd: bool) -> None:
    coarse = np.empty([-(-n // 2) for n in array.shape], array.dtype)
    assert _native.mean2_into(array, coarse, simd=simd)
    assert coarse.tobytes() == reference.mean2(array).tobytes()


def test_mean_is_over_the_voxels_that_exist() -> None:
    array = np.arange(27, dtype=np.int16).reshape(3, 3, 3)
    coarse = reduce.mean2(array)
    for z, y, x in np.ndindex(2, 2, 2):
        cell = array[2 * z : 2 * z + 2, 2 * y : 2 * y + 2, 2 * x : 2 * x + 2]
        assert coarse[z, y, x] == np.floor(cell.mean() + 0.5)


@pytest.mark.parametrize(("total", "mean"), [(-5, -1), (-4, 0), (3, 0), (4, 1), (12, 2), (-12, -1)])
def test_integers_are_rounded_half_up(total: int, mean: int) -> None:
    array = np.zeros((2, 2, 2), np.int8)
    array[1, 0, 1] = total
    assert reduce.mean2(array) == mean


def test_extreme_values_do_not_wrap(dtype: Any) -> None:
    info = np.finfo(dtype) if dtype.kind == "f" else np.iinfo(dtype)
    for value in (info.min, info.max):
        array = np.full((3, 5, 70), value, dtype)
        np.testing.assert_array_equal(reduce.mean2(array), array[::2, ::2, ::2])


def test_nan_and_infinity_spread_to_their_coarse_voxel_only() -> None:
    array = np.zeros((4, 4, 4), np.float32)
    array[0, 0, 0], array[3, 3, 3] = np.nan, np.inf
    coarse = reduce.mean2(array)
    assert np.isnan(coarse[0, 0, 0])
    assert coarse[1, 1, 1] == np.inf
    assert np.count_nonzero(coarse) == 2


def test_strides_threads_and_instructions_change_nothing(noise: Any, dtype: Any) -> None:
    array = noise((23, 31, 97), dtype)
    strided = noise((97, 62, 23), dtype).transpose(2, 1, 0)[::-1, ::2]
    strided[:] = array
    expected = reference.mean2(array)
    for source in (array, strided):
        for threads in (1, 5):
            for simd in (False, True):
                coarse = np.zeros((12, 49, 32), dtype).transpose(0, 2, 1)[:, ::2]
                assert _native.mean2_into(source, coarse, threads, simd)
                np.testing.assert_array_equal(coarse, expected)


def test_bad_input_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="give three axes"):
        reduce.mean2(np.zeros((4, 4), np.uint8))
    with pytest.raises(InvalidInputError, match="at least one voxel"):
        reduce.mean2(np.zeros((4, 0, 4), np.uint8))
    with pytest.raises(UnsupportedError, match="float64"):
        reduce.mean2(np.zeros((4, 4, 4)))


def test_native_refuses_shapes_and_types_that_do_not_fit() -> None:
    array = np.zeros((4, 4, 4), np.uint8)
    assert not _native.mean2_into(array, np.zeros((2, 2, 3), np.uint8))
    assert not _native.mean2_into(array, np.zeros((2, 2, 2), np.int8))
