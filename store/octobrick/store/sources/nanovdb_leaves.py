"""Leaves of a NanoVDB grid: 8³ voxels each, plain, as bits, or quantized."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from octobrick.store.sources.nanovdb_file import GridFile
from octobrick.store.sources.nanovdb_values import QUANTIZED_NBYTES, Values
from octobrick.store.sources.vdb_grid import Xyz

# Leaves that lie behind each other are read together, as many as this.
_MOST_TOGETHER = 256
_SIDE = 8
_FLAGS = 15  # where a leaf says how wide its codes are
_MINIMUM = 80  # where a quantized leaf has its smallest value and its step

Voxels = npt.NDArray[Any]


class Leaves:
    """The leaves of a grid.

    Args:
        grid: the bytes of the grid.
        values: what its values are.
    """

    def __init__(self, grid: GridFile, values: Values) -> None:
        self._grid, self._values = grid, values

    def decoded(self, leaves: Sequence[tuple[Xyz, int]]) -> Iterator[tuple[Xyz, Voxels]]:
        """The voxels (x, y, z, component) of leaves, given by where they begin and their place.

        Raises:
            SourceError: one lies outside the grid.
        """
        shape = (_SIDE, _SIDE, _SIDE, self._values.components)
        ordered = sorted(leaves, key=lambda leaf: leaf[1])
        if self._values.leaf == "variable":
            for origin, place in ordered:
                yield origin, self._variable(place).reshape(shape)
            return
        nbytes, start = self._values.leaf_nbytes, 0
        while start < len(ordered):
            first, stop = ordered[start][1], start + 1
            while (
                stop < len(ordered)
                and stop - start < _MOST_TOGETHER
                and ordered[stop][1] == first + (stop - start) * nbytes
            ):
                stop += 1
            data = self._grid.read(first, (stop - start) * nbytes)
            voxels = self._decode(np.frombuffer(data, np.uint8).reshape(stop - start, nbytes))
            for (origin, _), leaf in zip(ordered[start:stop], voxels, strict=True):
                yield origin, leaf.reshape(shape)
            start = stop

    def _decode(self, data: npt.NDArray[np.uint8]) -> Voxels:
        """The voxels of leaves, a row of bytes each."""
        values = self._values
        stored = data[:, values.leaf_values : values.leaf_nbytes]
        if values.leaf in ("bits", "mask"):
            return np.unpackbits(stored[:, :64], axis=1, bitorder="little").astype(bool)
        if values.leaf == "values":
            plain = np.ascontiguousarray(stored).view(values.sample)
            return plain.astype(values.dtype, copy=False)
        return _dequantized(data, stored, values.leaf_bits)

    def _variable(self, place: int) -> Voxels:
        """The voxels of a leaf that says itself how wide its codes are."""
        head = self._grid.read(place, QUANTIZED_NBYTES)
        log2_bits = head[_FLAGS] >> 5
        if log2_bits > 4:
            raise self._grid.damaged(f"the leaf at byte {place} has codes of 2^{log2_bits} bits")
        codes = self._grid.read(place + QUANTIZED_NBYTES, 64 << log2_bits)
        row = np.frombuffer(head, np.uint8)[np.newaxis]
        return _dequantized(row, np.frombuffer(codes, np.uint8)[np.newaxis], 1 << log2_bits)


def _dequantized(
    data: npt.NDArray[np.uint8], stored: npt.NDArray[np.uint8], bits: int
) -> npt.NDArray[np.float32]:
    """Smallest value + code · step, in single precision as NanoVDB does it."""
    if bits == 16:
        codes: Voxels = np.ascontiguousarray(stored).view("<u2")
    elif bits == 8:
        codes = stored
    else:  # the first code is in the lowest bits of a byte
        shifts = np.arange(0, 8, bits, dtype=np.uint8)
        codes = (stored[:, :, np.newaxis] >> shifts & np.uint8((1 << bits) - 1)).reshape(
            len(stored), -1
        )
    scale = np.ascontiguousarray(data[:, _MINIMUM : _MINIMUM + 8]).view("<f4")
    with np.errstate(all="ignore"):
        voxels: npt.NDArray[np.float32] = codes.astype(np.float32) * scale[:, 1:] + scale[:, :1]
    return voxels
