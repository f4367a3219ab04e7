"""The kinds of values of NanoVDB grids, and where each kind has its parts in a node.

Source: the documentation in NanoVDB.h of NanoVDB 32 (https://www.openvdb.org). Nodes are C structs
aligned to 32 bytes: a box, masks, four statistics, and a table of values.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

LeafCode = Literal["values", "bits", "mask", "quantized", "variable"]

# The names of all kinds, by number.
_NAMES = (
    *("unknown", "float", "double", "int16", "int32", "int64", "Vec3f", "Vec3d", "Mask", "half"),
    *("uint32", "bool", "RGBA8", "Fp4", "Fp8", "Fp16", "FpN", "Vec4f", "Vec4d", "Index"),
    *("OnIndex", "IndexMask", "OnIndexMask", "PointIndex", "Vec3u8", "Vec3u16", "UInt8"),
)
_BBOX_NBYTES = 32  # of an inner node: its box and flags
_LEAF_BASE_NBYTES = 80  # of a leaf: its corner, flags, and the mask of active voxels
QUANTIZED_NBYTES = 96  # where the codes of a quantized leaf begin


def kind_name(number: int) -> str:
    """The name of a kind of values."""
    return _NAMES[number] if number < len(_NAMES) else f"of kind {number}"


def _up(nbytes: int, alignment: int) -> int:
    return -(-nbytes // alignment) * alignment


@dataclass(frozen=True, slots=True)
class Values:
    """One kind of values.

    Attributes:
        sample: little-endian type of one component.
        components: how many of them a value has.
        leaf: how leaves code them: plain values, bits, the mask of active voxels itself, codes of
            ``leaf_bits`` bits with a smallest value and a step, or codes whose width the leaf says.
        leaf_bits: bits of one code.
        stat_nbytes: bytes of a mean, which is a float where values are shorter.
    """

    sample: np.dtype[np.generic]
    components: int = 1
    leaf: LeafCode = "values"
    leaf_bits: int = 0
    stat_nbytes: int = 4

    @property
    def dtype(self) -> np.dtype[np.generic]:
        """The native type of voxels; bytes that are not 0 are true."""
        is_bool = self.leaf in ("bits", "mask")
        return np.dtype(np.bool_) if is_bool else self.sample.newbyteorder("=")

    @property
    def nbytes(self) -> int:
        """Bytes of one value."""
        return self.sample.itemsize * self.components

    def _behind_stats(self, start: int) -> int:
        """Where least, greatest, mean and deviation of a node end that begin at a byte."""
        least = _up(start, self.sample.itemsize)
        return _up(least + 2 * self.nbytes, self.stat_nbytes) + 2 * self.stat_nbytes

    @property
    def root_background(self) -> int:
        """Where the root has the background."""
        return _up(28, self.sample.itemsize)

    @property
    def root_nbytes(self) -> int:
        """Bytes of the root before its tiles."""
        return _up(self._behind_stats(self.root_background + self.nbytes), 32)

    @property
    def root_tile(self) -> np.dtype[np.void]:
        """A tile of the root, 4096 voxels a side."""
        value = _up(20, self.sample.itemsize)
        return np.dtype(
            {
                "names": ["key", "child", "value"],
                "formats": ["<u8", "<i8", (self.sample, (self.components,))],
                "offsets": [0, 8, value],
                "itemsize": _up(value + self.nbytes, 32),
            }
        )

    def node(self, log2_side: int) -> np.dtype[np.void]:
        """An inner node with 2^log2_side tiles or children a side."""
        count = 1 << 3 * log2_side
        entry = np.dtype(
            {
                "names": ["value", "child"],
                "formats": [(self.sample, (self.components,)), "<i8"],
                "offsets": [0, 0],
                "itemsize": _up(max(8, self.nbytes), 8),
            }
        )
        table = _up(self._behind_stats(_BBOX_NBYTES + count // 4), 32)
        return np.dtype(
            {
                "names": ["children", "table"],
                "formats": [(np.uint8, (count // 8,)), (entry, (count,))],
                "offsets": [_BBOX_NBYTES + count // 8, table],
                "itemsize": table + count * entry.itemsize,
            }
        )

    @property
    def leaf_values(self) -> int:
        """Where a leaf has its values or codes."""
        if self.leaf == "mask":
            return 16
        if self.leaf == "bits":
            return _LEAF_BASE_NBYTES
        if self.leaf != "values":
            return QUANTIZED_NBYTES
        return _up(self._behind_stats(_LEAF_BASE_NBYTES), 32)

    @property
    def leaf_nbytes(self) -> int:
        """Bytes of a leaf; of one that says itself how wide its codes are, without them."""
        if self.leaf == "variable":
            return QUANTIZED_NBYTES
        if self.leaf in ("mask", "bits"):
            return 96 if self.leaf == "mask" else 160
        bits = self.leaf_bits if self.leaf == "quantized" else 8 * self.nbytes
        return self.leaf_values + 64 * bits


def _of(sample: str, components: int = 1, stat_nbytes: int = 4) -> Values:
    return Values(np.dtype(sample), components, stat_nbytes=stat_nbytes)


_F4 = np.dtype("<f4")
_BOOL = np.dtype("u1")
READ: dict[int, Values] = {
    1: _of("<f4"),
    2: _of("<f8", stat_nbytes=8),
    3: _of("<i2"),
    4: _of("<i4"),
    5: _of("<i8", stat_nbytes=8),
    6: _of("<f4", 3),
    7: _of("<f8", 3, stat_nbytes=8),
    8: Values(_BOOL, leaf="mask", stat_nbytes=1),
    9: _of("<f2"),
    10: _of("<u4"),
    11: Values(_BOOL, leaf="bits", stat_nbytes=1),
    12: _of("<u1", 4),
    13: Values(_F4, leaf="quantized", leaf_bits=4),
    14: Values(_F4, leaf="quantized", leaf_bits=8),
    15: Values(_F4, leaf="quantized", leaf_bits=16),
    16: Values(_F4, leaf="variable"),
    26: _of("<u1"),
}
READ_NAMES = tuple(kind_name(number) for number in READ)
