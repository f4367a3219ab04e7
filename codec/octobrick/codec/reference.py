"""S3Dc and the mean reducer in plain numpy: slow, obvious, and the oracle for all other code.

Every formula stands here as docs/spec/s3dc.md has it. Nothing is optimised, and nothing is
shared with the native code; only well-formed arguments are expected.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

Zyx = tuple[int, int, int]
Array = NDArray[Any]
Indices = NDArray[np.uint8]


def encode(array: Array, block: Zyx, bits: int) -> bytes:
    """The code of an array (z, y, x): end points, then packed rows of indices."""
    ends = end_points(array, block)
    indices = encode_indices(array, block, bits)
    little_endian = ends.astype(ends.dtype.newbyteorder("<"))
    return little_endian.tobytes() + pack_rows(indices, bits)


def decode(data: bytes, shape: Zyx, dtype: DTypeLike, block: Zyx, bits: int) -> Array:
    """The voxels of a well-formed code."""
    sample = np.dtype(dtype)
    grid = tuple(-(-n // b) for n, b in zip(shape, block, strict=True))
    count = 2 * int(np.prod(grid))
    ends = np.frombuffer(data, sample.newbyteorder("<"), count).astype(sample).reshape(*grid, 2)
    indices = unpack_rows(data[count * sample.itemsize :], shape, bits)
    out = np.empty(shape, sample)
    for cell, voxels in blocks(shape, block):
        low, high = ends[cell]
        out[voxels] = dequantise(indices[voxels], low, high, bits)
    return out


def end_points(array: Array, block: Zyx) -> Array:
    """Minimum and maximum of every block, (nbz, nby, nbx, 2); a zero among them is +0."""
    grid = tuple(-(-n // b) for n, b in zip(array.shape, block, strict=True))
    ends = np.empty((*grid, 2), array.dtype)
    for cell, voxels in blocks(array.shape, block):
        ends[cell] = array[voxels].min(), array[voxels].max()
    ends += ends.dtype.type(0)  # −0 + 0 is +0
    return ends


def encode_indices(array: Array, block: Zyx, bits: int) -> Indices:
    """The index of every voxel, not yet packed."""
    ends = end_points(array, block)
    indices = np.empty(array.shape, np.uint8)
    for cell, voxels in blocks(array.shape, block):
        low, high = ends[cell]
        indices[voxels] = quantise(array[voxels], low, high, bits)
    return indices


def quantise(values: Array, low: np.number[Any], high: np.number[Any], bits: int) -> Indices:
    """Indices of values between two end points (the paper's eq. 1)."""
    levels = 2**bits - 1
    if low == high:
        return np.zeros(values.shape, np.uint8)
    if values.dtype.kind == "f":
        offset, extent = np.float64(low), np.float64(high) - np.float64(low)
        position = (values.astype(np.float64) - offset) / extent
        indices: Array = np.floor(position * levels + 0.5)
    else:
        distance, reach = values.astype(np.int64) - int(low), int(high) - int(low)
        indices = (2 * distance * levels + reach) // (2 * reach)
    return indices.astype(np.uint8)


def dequantise(indices: Indices, low: np.number[Any], high: np.number[Any], bits: int) -> Array:
    """Values of indices between two end points (the paper's eq. 2, rounded to the sample type)."""
    levels = 2**bits - 1
    if low.dtype.kind == "f":
        offset, extent = np.float64(low), np.float64(high) - np.float64(low)
        values: Array = (offset + extent * indices / levels).astype(np.float32)
        values = np.where(values < low, low, values)
        values = np.where(values > high, high, values)
        return np.where(indices == levels, high, values)  # where high − low was rounded
    reach = int(high) - int(low)
    values = int(low) + (2 * reach * indices.astype(np.int64) + levels) // (2 * levels)
    return values.astype(low.dtype)


def pack_rows(indices: Indices, bits: int) -> bytes:
    """Rows of indices: least significant bit first, each padded with zeros to 16-bit words."""
    nz, ny, nx = indices.shape
    row_nbits = -(-nx * bits // 16) * 16
    stream = np.zeros((nz, ny, row_nbits), np.uint8)
    for bit in range(bits):
        stream[:, :, bit : nx * bits : bits] = indices >> bit & 1
    return np.packbits(stream, axis=-1, bitorder="little").tobytes()


def unpack_rows(packed: bytes, shape: Zyx, bits: int) -> Indices:
    """The indices of packed rows."""
    nz, ny, nx = shape
    rows = np.frombuffer(packed, np.uint8).reshape(nz, ny, -1)
    stream = np.unpackbits(rows, axis=-1, bitorder="little")
    indices = np.zeros(shape, np.uint8)
    for bit in range(bits):
        indices |= stream[:, :, bit : nx * bits : bits] << bit
    return indices


def blocks(shape: tuple[int, ...], block: Zyx) -> Iterator[tuple[Zyx, tuple[slice, ...]]]:
    """Every block's place in the grid, and its voxels; the last ones are cut at the faces."""
    grid = tuple(-(-n // b) for n, b in zip(shape, block, strict=True))
    for z, y, x in np.ndindex(*grid):
        cell = (z, y, x)
        yield cell, tuple(slice(i * b, i * b + b) for i, b in zip(cell, block, strict=True))


def mean2(array: Array) -> Array:
    """Half the resolution: the mean of every 2×2×2 voxels, an odd last voxel being repeated."""
    odd = [(0, n % 2) for n in array.shape]
    wide = np.pad(array, odd, mode="edge").astype(
        np.float64 if array.dtype.kind == "f" else np.int64
    )
    columns = (wide[0::2, 0::2] + wide[0::2, 1::2]) + (wide[1::2, 0::2] + wide[1::2, 1::2])
    eight = columns[:, :, 0::2] + columns[:, :, 1::2]
    means: Array = eight / 8 if array.dtype.kind == "f" else (eight + 4) // 8
    return means.astype(array.dtype)


def upsample2(coarse: Array, shape: Zyx) -> Array:
    """Twice the resolution: 3/4 of the voxel that holds the finer one, 1/4 of the nearer other."""
    wide: Array = coarse.astype(np.float64 if coarse.dtype.kind == "f" else np.int64)
    for axis in (1, 0, 2):
        at = np.arange(shape[axis])
        near = np.clip(at // 2 + np.where(at % 2, 1, -1), 0, coarse.shape[axis] - 1)
        wide = 3 * wide.take(at // 2, axis) + wide.take(near, axis)
    values: Array = wide / 64 if coarse.dtype.kind == "f" else (wide + 32) // 64
    return values.astype(coarse.dtype)
