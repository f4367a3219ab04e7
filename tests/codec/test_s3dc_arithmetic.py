"""The fast forms of the quantiser against plain integer division, exhaustively where that is short.

A row of each test array is one block, so one row is one range R, and its columns are the cases.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from octobrick.codec import _native, reference

Rows = NDArray[Any]

both_paths = pytest.mark.parametrize("simd", [False, True], ids=["baseline", "simd"])
all_bits = pytest.mark.parametrize("bits", range(1, 9))


def native_indices(rows: Rows, bits: int, simd: bool) -> Rows:
    """The native indices of rows that are a block each."""
    array = rows[:, np.newaxis, :]
    code = _native.encode(array, (1, 1, rows.shape[1]), bits, simd=simd)
    assert isinstance(code, bytes)
    packed = code[2 * rows.itemsize * len(rows) :]
    return reference.unpack_rows(packed, array.shape, bits)[:, 0]


def native_values(ends: Rows, indices: Rows, bits: int, simd: bool) -> Rows:
    """The native decoding of rows of indices that are a block each, with the given end points."""
    code = ends.tobytes() + reference.pack_rows(indices[:, np.newaxis, :], bits)
    out = np.empty((len(indices), 1, indices.shape[1]), ends.dtype)
    outcome = _native.decode_into(code, out, (1, 1, indices.shape[1]), bits, simd=simd)
    assert outcome.status is _native.Status.OK
    return out[:, 0]


def expected_indices(rows: Rows, bits: int) -> Rows:
    levels = 2**bits - 1
    low = rows.min(axis=1, keepdims=True).astype(np.int64)
    extent = rows.max(axis=1, keepdims=True) - low
    return (2 * (rows - low) * levels + extent) // np.maximum(2 * extent, 1)


def expected_values(ends: Rows, indices: Rows, bits: int) -> Rows:
    levels = 2**bits - 1
    low, high = ends.astype(np.int64).T[:, :, np.newaxis]
    return low + (2 * (high - low) * indices.astype(np.int64) + levels) // (2 * levels)


@both_paths
@all_bits
@pytest.mark.parametrize("dtype", ["uint8", "int8"])
def test_every_distance_and_range_of_8_bit_samples(dtype: str, bits: int, simd: bool) -> None:
    info = np.iinfo(dtype)
    extents = np.arange(256)[:, np.newaxis]
    distances = np.minimum(np.arange(256), extents)
    for offsets in (0, 255 - extents, (255 - extents) // 2):
        rows = (distances + offsets + info.min).astype(dtype)
        found = native_indices(rows, bits, simd)
        np.testing.assert_array_equal(found, expected_indices(rows, bits))


@both_paths
@all_bits
@pytest.mark.parametrize("dtype", ["uint16", "int16"])
def test_distances_around_every_tie_of_16_bit_samples(dtype: str, bits: int, simd: bool) -> None:
    """Where rounding turns, between two indices, is where an inexact form would show."""
    info, levels = np.iinfo(dtype), 2**bits - 1
    step = 1 if bits <= 4 else 11
    extents = np.unique(np.r_[0:1200, 65535 - 1200 : 65536, 0:65536:step])[:, np.newaxis]
    ties = (2 * np.arange(levels) + 1) * extents // (2 * levels)
    distances = np.concatenate([ties + near for near in (-1, 0, 1)] + [0 * extents, extents], 1)
    distances = np.clip(distances, 0, extents)
    for offsets in (0, 65535 - extents):
        rows = (distances + offsets + info.min).astype(dtype)
        found = native_indices(rows, bits, simd)
        np.testing.assert_array_equal(found, expected_indices(rows, bits))


@both_paths
@pytest.mark.parametrize("bits", [4, 6, 8])
def test_every_distance_of_some_ranges_of_16_bit_samples(bits: int, simd: bool) -> None:
    extents = np.array([1, 2, 3, 255, 4095, 32767, 32768, 50001, 65533, 65534, 65535])
    rows = np.minimum(np.arange(65536), extents[:, np.newaxis]).astype(np.uint16)
    found = native_indices(rows, bits, simd)
    np.testing.assert_array_equal(found, expected_indices(rows, bits))


@both_paths
@all_bits
@pytest.mark.parametrize("dtype", ["uint8", "int8", "uint16", "int16"])
def test_every_index_and_range_decodes_as_the_formula(dtype: str, bits: int, simd: bool) -> None:
    info = np.iinfo(dtype)
    top = int(info.max) - int(info.min)
    extents = np.arange(0, top + 1, 1 if bits <= 4 or top < 256 else 5)
    indices = np.broadcast_to(np.arange(2**bits, dtype=np.uint8), (len(extents), 2**bits))
    for offsets in (np.zeros_like(extents), top - extents):
        low = info.min + offsets
        ends = np.stack([low, low + extents], axis=1).astype(dtype)
        found = native_values(ends, indices, bits, simd)
        np.testing.assert_array_equal(found, expected_values(ends, indices, bits))
