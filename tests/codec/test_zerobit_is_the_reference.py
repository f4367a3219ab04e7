"""The C++ code and the slow numpy reference say the same, bit for bit, in every mode."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from octobrick.codec import Zerobit
from octobrick.codec import reference_zerobit as reference
from octobrick.codec import reference_zerobit_encoder as encoder

from .zerobit_volumes import KINDS, scene, with_channels

each_kind = pytest.mark.parametrize(("dtype", "channels"), KINDS)


# ---- The transform ---------------------------------------------------------------------------


def test_the_inverse_is_the_sum_of_signed_coefficients() -> None:
    """c_ijk = c[z][y][x], and the letters of a coefficient are for x, y and z."""
    coefficients = np.arange(1.0, 9)[:, None] ** 3
    values = reference.haar_inverse(coefficients)
    for z, y, x in np.ndindex(2, 2, 2):
        signs = [(-1) ** (x * (j >> 2 & 1) + y * (j >> 1 & 1) + z * (j & 1)) for j in range(8)]
        assert values[z, y, x] == np.dot(signs, coefficients)


def test_forward_and_inverse_are_each_other() -> None:
    values = np.random.default_rng(1).integers(0, 256, (2, 2, 2, 3)).astype(float)
    sums = reference.haar_forward(values)
    assert (sums[0] == values.sum(axis=(0, 1, 2))).all()
    for at, value in reference.haar_inverse(sums / 8).items():
        np.testing.assert_array_equal(value, values[at])


def test_c_lll_and_c_llh_are_shared_by_voxels_of_one_plane_across_z() -> None:
    """Section 2.2 of the paper: c000, c001, c010 and c011 have the sum of the two in common."""
    for j, axis in ((1, 0), (2, 1), (4, 2)):
        values = np.zeros((2, 2, 2, 1))
        values[(slice(None),) * axis + (0,)] = 1
        sums = reference.haar_forward(values)
        assert sorted(np.flatnonzero(sums)) == [0, j]


# ---- Encoder and decoder ---------------------------------------------------------------------


@each_kind
@pytest.mark.parametrize("thresholds", ["global", "block"])
@pytest.mark.parametrize("ranking", ["orthonormal", "literal"])
@pytest.mark.parametrize("count_averages", [False, True])
def test_codes_and_voxels_are_those_of_the_reference(
    dtype: str, channels: int, thresholds: Any, ranking: Any, count_averages: bool
) -> None:
    array = scene((5, 17, 21), dtype, channels)
    codec = Zerobit(0.1, thresholds=thresholds, ranking=ranking, count_averages=count_averages)
    code = codec.encode(array)
    choices = encoder.Settings(0.1, thresholds == "block", ranking == "orthonormal", count_averages)
    assert code == encoder.encode(with_channels(array), choices)
    decoded = with_channels(codec.decode(code, array.shape, dtype))
    assert decoded.tobytes() == reference.decode(code).tobytes()


@given(
    st.sampled_from(KINDS),
    st.tuples(st.integers(1, 18), st.integers(1, 6), st.integers(1, 18)),
    st.floats(0, 1),
    st.integers(0, 99),
)
@settings(max_examples=40, deadline=None)
def test_any_shape_and_ratio(
    kind: tuple[str, int], shape: tuple[int, int, int], ratio: float, seed: int
) -> None:
    dtype, channels = kind
    array = scene(shape, dtype, channels, seed)
    code = Zerobit(ratio).encode(array)
    assert code == encoder.encode(with_channels(array), encoder.Settings(ratio))
    for level in (0, 1, 2):
        decoded = Zerobit().decode_level(code, level)
        assert decoded.shape[:3] == tuple(-(-n // 2**level) for n in shape)
        assert decoded.tobytes() == reference.decode(code, level).tobytes()


def test_a_mask_and_a_background_are_those_of_the_reference() -> None:
    array = scene((9, 10, 35), "uint8", 3)
    wanted = np.random.default_rng(3).random((3, 3, 9)) < 0.4
    background = np.array([1.0, 2.0, 3.0])
    code = Zerobit(0.1, background=(1, 2, 3)).encode(array, wanted=wanted)
    choices = encoder.Settings(0.1, background=background)
    assert code == encoder.encode(array, choices, wanted)


@pytest.mark.parametrize("count", [3, 256, 257, 2000])
def test_codewords_are_those_of_the_reference(count: int) -> None:
    """Below, at and above what a codebook holds, with duplicates."""
    rng = np.random.default_rng(count)
    colours = rng.integers(0, 256, (count, 3), np.uint8)
    image = np.repeat(colours[rng.integers(0, count, 4000)], 64, axis=0)
    array = image.reshape(10, 20, 20, 4, 4, 4, 3).transpose(0, 3, 1, 4, 2, 5, 6)
    array = array.reshape(40, 80, 80, 3)
    code = reference.parse(Zerobit(0).encode(array, threads=2))
    cells = [c.astype(float) for c in array[::4, ::4, ::4].reshape(-1, 3)]
    every = [c for c in cells if (c != code.background).any()]
    words = encoder.median_cut(every, np.dtype(np.uint8))
    np.testing.assert_array_equal(code.averages, words)


# ---- Modes -----------------------------------------------------------------------------------


def gather_voxels(codec: Zerobit, code: bytes, array: NDArray[Any]) -> NDArray[Any]:
    out = np.empty_like(array)
    for at in np.ndindex(*array.shape[:3]):
        out[at] = codec.decode_voxel(code, at)
    return out


def gather_cells(codec: Zerobit, code: bytes, array: NDArray[Any]) -> NDArray[Any]:
    return paste_cells(array, lambda cell: codec.decode_cell(code, cell))


def paste_cells(array: NDArray[Any], read: Any) -> NDArray[Any]:
    cells = [-(-n // 4) for n in array.shape[:3]]
    wide = np.empty((*(4 * n for n in cells), *array.shape[3:]), array.dtype)
    for z, y, x in np.ndindex(*cells):
        wide[4 * z : 4 * z + 4, 4 * y : 4 * y + 4, 4 * x : 4 * x + 4] = read((z, y, x))
    nz, ny, nx = array.shape[:3]
    return wide[:nz, :ny, :nx]


@each_kind
def test_three_modes_give_the_same_voxels(dtype: str, channels: int) -> None:
    """Claim Z23; float32 too, because all modes add in one order."""
    array = scene((6, 17, 19), dtype, channels)
    codec = Zerobit(0.15)
    code = codec.encode(array)
    expected = codec.decode(code, array.shape, dtype)
    assert gather_voxels(codec, code, array).tobytes() == expected.tobytes()
    assert gather_cells(codec, code, array).tobytes() == expected.tobytes()
    for axis in range(3):

        def planes(cell: tuple[int, int, int], axis: int = axis) -> NDArray[Any]:
            read = [codec.decode_plane(code, cell, axis, offset) for offset in range(4)]
            return np.stack(read, axis)

        assert paste_cells(array, planes).tobytes() == expected.tobytes()
