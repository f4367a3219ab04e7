"""Zerobit in plain numpy: slow, obvious, and the oracle for all other code.

Every rule stands here as docs/spec/zerobit.md has it. Nothing is optimised, and nothing is shared
with the native code; only well-formed arguments are expected. `Counter` counts what the inverse
transform does, so that the costs that the paper states can be checked.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Zyx = tuple[int, int, int]
Array = NDArray[Any]
Doubles = NDArray[np.float64]
BOTH = (0, 1)

DTYPES = tuple(np.dtype(name) for name in ("uint8", "int8", "uint16", "int16", "float32"))
HEADER = "<4sBBBB3IHHQ12s4s4sfII"


# ---- The Haar transform ------------------------------------------------------------------------


@dataclass
class Counter:
    """What a decoder has done: coefficients decoded, vectors added or subtracted."""

    decodings: int = 0
    additions: int = 0


def plus_or_minus(a: Array, b: Array, sign: int, counter: Counter) -> Array:
    """A + b where sign is 0, a − b where it is 1: one operation, whatever the channels."""
    counter.additions += 1
    return a + b if sign == 0 else a - b


def haar_forward(values: Doubles) -> Doubles:
    """Eight times the coefficients (8, C) of values (2, 2, 2, C): along x, then y, then z."""
    for axis in (2, 1, 0):
        low, high = np.take(values, 0, axis), np.take(values, 1, axis)
        values = np.stack([low + high, low - high], axis)
    # values[z][y][x] now has the letters (x, y, z) of coefficient j = 4x + 2y + z.
    return values.transpose(2, 1, 0, 3).reshape(8, -1)


def haar_inverse(
    coefficients: Array,
    z: tuple[int, ...] = BOTH,
    y: tuple[int, ...] = BOTH,
    x: tuple[int, ...] = BOTH,
    counter: Counter | None = None,
) -> dict[Zyx, Array]:
    """The values at the wanted coordinates, by sums that are shared: 24 operations for all."""
    counter = Counter() if counter is None else counter
    values = {}
    for iz in z:
        pairs = [
            plus_or_minus(coefficients[2 * k], coefficients[2 * k + 1], iz, counter)
            for k in range(4)
        ]
        for iy in y:
            quads = [plus_or_minus(pairs[2 * k], pairs[2 * k + 1], iy, counter) for k in range(2)]
            for ix in x:
                values[iz, iy, ix] = plus_or_minus(quads[0], quads[1], ix, counter)
    return values


def cell_sums(cell: Doubles) -> Doubles:
    """Sums (64, C) of a cell (4, 4, 4, C): the average, 7 details of level 0, 8 × 7 of level 1."""
    averages = np.empty((2, 2, 2, cell.shape[3]))
    details = []
    for z, y, x in np.ndindex(2, 2, 2):
        sums = haar_forward(cell[2 * z : 2 * z + 2, 2 * y : 2 * y + 2, 2 * x : 2 * x + 2])
        averages[z, y, x] = sums[0]
        details.append(sums[1:])
    return np.concatenate([haar_forward(averages), *details])


DIVISORS = np.where(np.arange(64) < 8, 64.0, 8.0)[:, None]


# ---- The zerobit structure ---------------------------------------------------------------------


def detail_dtype(dtype: np.dtype[Any]) -> np.dtype[Any]:
    """The type of a detail codeword."""
    return np.dtype("<f4" if dtype.kind == "f" else f"<i{dtype.itemsize}")


@dataclass
class Code:
    """A code, taken apart."""

    shape: Zyx
    dtype: np.dtype[Any]
    channels: int
    background: Array
    least: float
    greatest: float
    averages: Array
    details: Array
    thresholds: Array
    blocks: list[bytes]


def parse(data: bytes, codebook: bytes = b"") -> Code:
    """Takes a well-formed code apart."""
    (_, _, kind, channels, shared, nz, ny, nx, count_a, count_d, _, background, least, greatest,
     step, blocks_nbytes, _) = struct.unpack_from(HEADER, data)  # fmt: skip
    dtype = DTYPES[kind]
    size, at = dtype.itemsize, 64
    words, start = (codebook, 16) if shared else (data, at)

    def samples(raw: bytes, count: int, sort: np.dtype[Any]) -> Array:
        # The decoder's arithmetic: whole numbers, or double.
        exact = np.float64 if dtype.kind == "f" else np.int64
        return np.frombuffer(raw, sort, count).astype(exact)

    little = dtype.newbyteorder("<")
    averages = samples(words[start:], count_a * channels, little)
    details = samples(
        words[start + count_a * channels * size :], count_d * channels, detail_dtype(dtype)
    )
    if not shared:
        at += (count_a + count_d) * channels * size
    count = int(np.prod([-(-n // 16) for n in (nz, ny, nx)]))
    with np.errstate(over="ignore"):  # as the decoder's, which may be infinite
        thresholds = np.frombuffer(data, np.uint8, count, at) * np.float32(step)
    pointers = np.frombuffer(data, "<u4", count, at + count).tolist()
    first = at + 5 * count
    ends = [*pointers[1:], blocks_nbytes]
    return Code(
        (nz, ny, nx),
        dtype,
        channels,
        np.array([samples(background[4 * c :], 1, little)[0] for c in range(channels)]),
        samples(least, 1, little)[0],
        samples(greatest, 1, little)[0],
        averages.reshape(-1, channels),
        details.reshape(-1, channels),
        thresholds,
        [data[first + a : first + b] for a, b in zip(pointers, ends, strict=True)],
    )


@dataclass
class Cell:
    """Where one cell's parts lie in its unit block; addresses count as in the paper's Figure 6."""

    block: bytes
    average_index: int
    zerobit_at: int  # in ZSMS
    detail_at: int  # in DIS
    level0: bool
    zsms: bytes
    dis: bytes

    def zerobit(self, node: int) -> bool:
        """Whether detail node 0 to 8 is not null."""
        return self.level0 if node == 0 else bool(self.zsms[self.zerobit_at] >> node - 1 & 1)

    def map_at(self, node: int) -> int:
        """The address in ZSMS of the significance map of a node that is not null."""
        return self.zerobit_at + 1 + sum(self.zerobit(i) for i in range(node))

    def significant(self, node: int, j: int) -> bool:
        """Whether detail j of a node is not null."""
        return self.zerobit(node) and bool(self.zsms[self.map_at(node)] >> j - 1 & 1)

    def displacement(self, node: int, j: int) -> int:
        """Details of the cell that precede one."""
        before = [(i, k) for i in range(node) for k in range(1, 8)]
        before += [(node, k) for k in range(1, j)]
        return sum(self.significant(i, k) for i, k in before)

    def detail_index(self, node: int, j: int) -> int:
        """The index of a detail that is not null."""
        return self.dis[self.detail_at + self.displacement(node, j)]


def find_cell(block: bytes, number: int) -> Cell | None:
    """One cell of a unit block; None where it is null."""
    if block[0] == 0:
        return None
    flags = int.from_bytes(block[1:9], "little")
    if not flags >> number & 1:
        return None
    entries = [struct.unpack_from("<BHH", block, 9 + 5 * k) for k in range(block[0])]
    streams = block[9 + 5 * block[0] :]
    # The first cell's details start where ZSMS ends.
    zsms_nbytes = entries[0][1]
    rank = (flags & (1 << number) - 1).bit_count()
    average, detail, zerobit = entries[rank]
    return Cell(
        block,
        average,
        zerobit & 0x7FFF,
        detail - zsms_nbytes,
        bool(zerobit >> 15),
        streams[:zsms_nbytes],
        streams[zsms_nbytes:],
    )


def node_coefficients(code: Code, cell: Cell, node: int, average: Array, counter: Counter) -> Array:
    """The eight coefficients of a node."""
    counter.decodings += 7
    rows = [average]
    for j in range(1, 8):
        null = np.zeros_like(average)
        live = cell.significant(node, j)
        rows.append(code.details[cell.detail_index(node, j)] if live else null)
    return np.array(rows)


def read_cell(
    code: Code,
    cell_zyx: Zyx,
    wanted: tuple[tuple[int, ...], ...] = ((0, 1, 2, 3),) * 3,
    counter: Counter | None = None,
    depth: int = 2,
) -> dict[Zyx, Array]:
    """Values of a cell at the wanted coordinates, before clamping: every mode is this.

    Args:
        code: what `parse` returned.
        cell_zyx: which cell.
        wanted: coordinates in the cell, per axis: all four, or one.
        counter: what counts.
        depth: 2 for voxels, 1 for averages of 2³ (coordinates 0 and 1), 0 for the cell's average.
    """
    counter = Counter() if counter is None else counter
    grid = [-(-n // 16) for n in code.shape]
    block = np.ravel_multi_index([c // 4 for c in cell_zyx], grid)
    z, y, x = (c % 4 for c in cell_zyx)
    cell = find_cell(code.blocks[int(block)], 16 * z + 4 * y + x)
    if cell is None:
        return dict.fromkeys(coordinates(wanted), code.background)
    counter.decodings += 1
    average = code.averages[cell.average_index]
    if depth == 0:
        return {(0, 0, 0): average}
    nodes: list[tuple[int, ...]] = [BOTH] * 3
    if depth == 2:
        nodes = [tuple(sorted({w // 2 for w in axis})) for axis in wanted]
    values = expand(code, cell, 0, average, nodes, counter)
    if depth == 1:
        return values
    halves = [tuple(sorted({w % 2 for w in axis})) for axis in wanted]
    voxels = {}
    for (nz, ny, nx), parent in values.items():
        node = 1 + 4 * nz + 2 * ny + nx
        for (hz, hy, hx), value in expand(code, cell, node, parent, halves, counter).items():
            voxels[2 * nz + hz, 2 * ny + hy, 2 * nx + hx] = value
    return voxels


def expand(
    code: Code,
    cell: Cell,
    node: int,
    average: Array,
    parts: list[tuple[int, ...]],
    counter: Counter,
) -> dict[Zyx, Array]:
    """The values of one node at the wanted coordinates; a null node passes its average on."""
    if not cell.zerobit(node):
        return dict.fromkeys(coordinates(parts), average)
    coefficients = node_coefficients(code, cell, node, average, counter)
    z, y, x = parts
    return haar_inverse(coefficients, z, y, x, counter)


def coordinates(parts: Any) -> Iterator[Zyx]:
    """All (z, y, x) of three ranges."""
    return ((z, y, x) for z in parts[0] for y in parts[1] for x in parts[2])


def sample_of(code: Code, value: Array) -> Array:
    """A value as it is given back: clamped, in the sample type."""
    return np.clip(value, code.least, code.greatest).astype(code.dtype)


def decode(data: bytes, level: int = 0, codebook: bytes = b"") -> Array:
    """The volume (z, y, x, C) at a level."""
    code = parse(data, codebook)
    side = 4 >> level
    cells = [-(-n // 4) for n in code.shape]
    wide = np.empty((*(side * n for n in cells), code.channels), code.dtype)
    wanted = (tuple(range(side)),) * 3
    for z, y, x in np.ndindex(*cells):
        for (iz, iy, ix), value in read_cell(code, (z, y, x), wanted, depth=2 - level).items():
            # What is background is not clamped.
            null = value is code.background
            at = (side * z + iz, side * y + iy, side * x + ix)
            wide[at] = value.astype(code.dtype) if null else sample_of(code, value)
    nz, ny, nx = (-(-n // 2**level) for n in code.shape)
    return wide[:nz, :ny, :nx]
