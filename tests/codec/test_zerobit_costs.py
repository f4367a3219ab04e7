"""What the paper says of zerobit's structure: its sizes, its Figure 6, and what decoding costs."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from octobrick.codec import Zerobit, _native
from octobrick.codec import reference_zerobit as reference

from .zerobit_volumes import scene


@pytest.fixture
def noise_block() -> np.ndarray:
    """One unit block of which no coefficient is null."""
    return np.random.default_rng(1).normal(size=(16, 16, 16)).astype(np.float32)


# ---- Operations: claims Z3, Z19 to Z22 -------------------------------------------------------


def test_the_inverse_of_eight_values_takes_24_operations() -> None:
    counter = reference.Counter()
    reference.haar_inverse(np.ones((8, 3)), counter=counter)
    assert counter.additions == 24


def test_a_voxel_takes_15_decodings_and_14_operations(noise_block: np.ndarray) -> None:
    code = reference.parse(Zerobit(1).encode(noise_block))
    for at in ((0, 0, 0), (1, 2, 3), (3, 3, 3)):
        counter = reference.Counter()
        reference.read_cell(code, (0, 1, 2), tuple((c,) for c in at), counter)
        assert (counter.additions, counter.decodings) == (14, 15)
        assert _native.zerobit_voxel_operations(*at) == (14, 15)


@pytest.mark.parametrize(("axis", "additions"), [(2, 100), (1, 80), (0, 60)])
@pytest.mark.parametrize("offset", range(4))
def test_a_plane_takes_36_decodings_and_100_80_or_60_operations_across_x_y_or_z(
    noise_block: np.ndarray, axis: int, additions: int, offset: int
) -> None:
    wanted = [(0, 1, 2, 3)] * 3
    wanted[axis] = (offset,)
    counter = reference.Counter()
    code = reference.parse(Zerobit(1).encode(noise_block))
    assert len(reference.read_cell(code, (3, 0, 1), tuple(wanted), counter)) == 16
    assert (counter.additions, counter.decodings) == (additions, 36)
    assert _native.zerobit_plane_operations(axis, offset) == (additions, 36)


def test_a_cell_takes_64_decodings_and_216_operations(noise_block: np.ndarray) -> None:
    counter = reference.Counter()
    code = reference.parse(Zerobit(1).encode(noise_block))
    reference.read_cell(code, (1, 1, 1), counter=counter)
    assert (counter.additions, counter.decodings) == (216, 64)
    assert _native.zerobit_cell_operations() == (216, 64)


def test_null_nodes_save_the_operations_that_the_paper_says() -> None:
    """A voxel of cells that are not null costs (1 − γ₀) · 0.375 + (1 − γ₁) · 3 operations."""
    array = scene((16, 20, 36), "uint8", 3)
    codec = Zerobit(0.04)
    data = codec.encode(array)
    code, stats, counter = reference.parse(data), codec.stats(data), reference.Counter()
    for cell in np.ndindex(4, 5, 9):
        reference.read_cell(code, cell, counter=counter)
    null0, null1 = stats.null_nodes
    assert 0 < null0 < 1
    assert 0.5 < null1 < 1
    per_voxel = (1 - null0) * 0.375 + (1 - null1) * 3
    assert counter.additions == pytest.approx(per_voxel * 64 * stats.cells, abs=1e-6)


# ---- Structure: claims Z12 to Z16 ------------------------------------------------------------


def blocks_nbytes(codec: Zerobit, code: bytes) -> int:
    """Without header, codebook, tables and the zeros at the end."""
    stats = codec.stats(code)
    tables = stats.pointers_nbytes * 5 // 4
    return stats.nbytes - 64 - stats.codebook_nbytes - tables - 8


def test_a_void_block_takes_one_byte() -> None:
    for shape, blocks in (((16, 16, 16), 1), ((48, 17, 1), 6)):
        code = Zerobit().encode(np.zeros(shape, np.uint8))
        assert blocks_nbytes(Zerobit(), code) == blocks
        assert len(code) == 64 + 6 * blocks + 8


def test_a_cell_without_details_takes_six_bytes() -> None:
    array = np.zeros((16, 16, 16), np.uint8)
    array[4:8, 8:12, 0:4] = 9
    code = Zerobit().encode(array)
    assert blocks_nbytes(Zerobit(), code) == 1 + 8 + 6


def test_streams_of_a_full_block_have_640_and_4032_bytes(noise_block: np.ndarray) -> None:
    codec = Zerobit(1)
    code = codec.encode(noise_block)
    cell = reference.find_cell(reference.parse(code).blocks[0], 63)
    assert cell is not None
    assert (len(cell.zsms), len(cell.dis)) == (640, 4032)
    assert blocks_nbytes(codec, code) == 1 + 8 + 5 * 64 + 640 + 4032


@pytest.mark.parametrize("at", [(0, 0, 0), (0, 0, 3), (0, 2, 1), (3, 0, 0), (3, 3, 3)])
def test_cells_are_numbered_with_x_fastest(at: tuple[int, int, int]) -> None:
    z, y, x = at
    array = np.zeros((16, 16, 16), np.uint8)
    array[4 * z, 4 * y, 4 * x] = 255
    block = reference.parse(Zerobit(1).encode(array)).blocks[0]
    words = struct.unpack_from("<4H", block, 1)
    number = 16 * z + 4 * y + x
    assert [w for w in range(4) if words[w]] == [number // 16]
    assert words[number // 16] == 1 << number % 16


@pytest.mark.parametrize(("axis", "j"), [(0, 1), (1, 2), (2, 4)])
def test_a_step_along_an_axis_is_one_detail(axis: int, j: int) -> None:
    """In the finest octant at (1, 1, 1) of the cell: node 8 of level 1."""
    array = np.full((4, 4, 4), 100, np.uint8)
    octant = [slice(2, 4)] * 3
    octant[axis] = slice(2, 3)
    array[tuple(octant)] += 10
    octant[axis] = slice(3, 4)
    array[tuple(octant)] -= 10
    cell = reference.find_cell(reference.parse(Zerobit(1).encode(array)).blocks[0], 0)
    assert cell is not None
    assert not cell.level0
    assert cell.zsms == bytes([1 << 7, 1 << j - 1])


def figure_6() -> bytes:
    """A unit block whose cell 8 is that of Figure 6: zerobits at 24, details at 41."""
    # Cells 0 to 7 have 24 bytes of zerobits and maps, and 41 details, as the figure has it.
    before = [[0x7F], [0x1F], [0x01], [0x7F, 0x3F, 0x0F], [0x03, 0x01], [0x01] * 8, [], []]
    zsms, dis, entries = bytearray(), bytearray(), []
    maps_of_8 = [0x80 | 0b0001011, 0b0110000, 0b0111010]  # level 0, nodes 3 and 5
    for maps in [*before, maps_of_8]:
        level0 = bool(maps) and bool(maps[0] & 0x80)
        entries.append((len(dis), len(zsms) | level0 << 15))
        zerobits = 0b00010100 if level0 else (1 << len(maps)) - 1
        zsms += bytes([zerobits, *maps])
        dis += bytes(range(len(dis), len(dis) + sum((m & 0x7F).bit_count() for m in maps)))
    cia = b"".join(struct.pack("<BHH", 0, len(zsms) + d, z) for d, z in entries)
    return bytes([9]) + struct.pack("<Q", 0b111111111) + cia + bytes(zsms) + bytes(dis)


def test_figure6_example() -> None:
    """The index of detail 5 of node 5: map 27 (24 + 1 + 2), displacement 7, address 48."""
    cell = reference.find_cell(figure_6(), 8)
    assert cell is not None
    assert cell.zerobit_at == 24
    assert [node for node in range(9) if cell.zerobit(node)] == [0, 3, 5]
    assert [cell.map_at(node) for node in (0, 3, 5)] == [25, 26, 27]
    assert cell.significant(5, 5)
    assert cell.detail_at == 41
    assert cell.displacement(5, 5) == 7
    assert cell.detail_index(5, 5) == 48
