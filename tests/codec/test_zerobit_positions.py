"""Many voxels or cells in one call: the same as one by one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from octobrick.codec import Zerobit, _native

from .zerobit_volumes import KINDS, scene, with_channels

SHAPE = (21, 18, 35)  # no multiple of cells or unit blocks


def code_of(dtype: str, channels: int, ratio: float) -> tuple[_native.ZerobitReader, NDArray[Any]]:
    """A reader, and all voxels (z, y, x, C)."""
    array, codec = scene(SHAPE, dtype, channels), Zerobit(ratio)
    code = codec.encode(array)
    decoded = codec.decode(code, array.shape, array.dtype)
    return _native.ZerobitReader(code, b""), with_channels(decoded)


def random_positions(extent: tuple[int, ...], count: int) -> NDArray[np.uint64]:
    return np.random.default_rng(count).integers(0, extent, (count, 3), np.uint64)


@settings(max_examples=10)
@given(ratio=st.sampled_from((0.0, 0.02, 0.1, 0.5, 1.0)), count=st.integers(0, 300))
@pytest.mark.parametrize(("dtype", "channels"), KINDS)
def test_many_voxels_are_those_of_the_whole_volume(
    dtype: str, channels: int, ratio: float, count: int
) -> None:
    reader, whole = code_of(dtype, channels, ratio)
    at = random_positions(SHAPE, count)
    out = np.empty((count, channels), dtype)
    assert reader.voxels(at, out).status == _native.ZerobitStatus.OK
    np.testing.assert_array_equal(out, whole[tuple(at.T)])


@settings(max_examples=10)
@given(ratio=st.sampled_from((0.0, 0.02, 0.1, 0.5, 1.0)), count=st.integers(0, 70))
@pytest.mark.parametrize(("dtype", "channels"), KINDS)
def test_many_cells_are_those_of_the_whole_volume(
    dtype: str, channels: int, ratio: float, count: int
) -> None:
    reader, whole = code_of(dtype, channels, ratio)
    at = random_positions(tuple(n // 4 for n in SHAPE), count)
    out = np.empty((count, 4, 4, 4, channels), dtype)
    assert reader.cells(at, out).status == _native.ZerobitStatus.OK
    for cell, (z, y, x) in zip(out, 4 * at.astype(int), strict=True):
        np.testing.assert_array_equal(cell, whole[z : z + 4, y : y + 4, x : x + 4])


@pytest.mark.parametrize("axis", range(3))
def test_positions_outside_of_the_volume_are_refused(axis: int) -> None:
    reader, _ = code_of("uint8", 1, 0.05)
    at = np.zeros((2, 3), np.uint64)
    for read, extent, voxels in ((reader.voxels, SHAPE, 1), (reader.cells, (6, 5, 9), 64)):
        at[1, axis] = extent[axis] - 1
        out = np.empty((2, voxels), np.uint8)
        read(at, out)
        at[1, axis] += np.uint64(1)
        with pytest.raises(ValueError, match="outside"):
            read(at, out)


def test_positions_that_are_not_threes_are_refused() -> None:
    reader, _ = code_of("uint8", 1, 0.05)
    with pytest.raises(ValueError, match="size"):
        reader.voxels(np.zeros(4, np.uint64), np.empty(1, np.uint8))


def test_many_voxels_of_a_damaged_code_are_refused() -> None:
    code = bytearray(Zerobit().encode(scene(SHAPE, "uint8")))
    first_block = len(code) - 8 - int.from_bytes(code[56:60], "little")
    code[first_block] ^= 0x7F
    reader = _native.ZerobitReader(bytes(code), b"")
    out = np.zeros((1, 1), np.uint8)
    outcome = reader.voxels(np.zeros((1, 3), np.uint64), out)
    assert outcome.status == _native.ZerobitStatus.BAD_BLOCK
