"""What Zerobit refuses, and what it says: bad arguments, and bytes that `encode` did not write."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from octobrick.codec import Codebook, Zerobit
from octobrick.codec.errors import (
    CorruptBrickError,
    InvalidInputError,
    NotFiniteError,
    UnsupportedError,
)

from .zerobit_volumes import KINDS, scene

# ---- Arguments -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "parameters",
    [
        {"ratio": -0.1}, {"ratio": 1.1}, {"ratio": float("nan")}, {"ratio": "much"},
        {"thresholds": "none"}, {"ranking": "best"}, {"codebook": b"OBZC"},
    ],
)  # fmt: skip
def test_parameters_out_of_their_range(parameters: dict[str, Any]) -> None:
    with pytest.raises(InvalidInputError, match=f"Zerobit {next(iter(parameters))}"):
        Zerobit(**parameters)


@pytest.mark.parametrize(
    "shape", [(4, 4), (0, 4, 4), (4, 4, 4, 4), (4, 4, 4, 1), (4, 0, 4, 3), (4,) * 5]
)
def test_arrays_of_another_shape(shape: tuple[int, ...]) -> None:
    with pytest.raises(InvalidInputError, match=r"has shape"):
        Zerobit().encode(np.zeros(shape, np.uint8))


@pytest.mark.parametrize("dtype", ["int8", "int16", "float32"])
def test_colours_of_other_types(dtype: str) -> None:
    with pytest.raises(UnsupportedError, match=f"no {dtype} colours.*one by one"):
        Zerobit().encode(np.zeros((4, 4, 4, 3), dtype))


def test_samples_of_other_types() -> None:
    with pytest.raises(UnsupportedError, match="no float64 samples"):
        Zerobit().encode(np.zeros((4, 4, 4)))
    with pytest.raises(UnsupportedError, match="no int32 samples"):
        Zerobit().encode(np.zeros((4, 4, 4, 3), np.int32))
    with pytest.raises(UnsupportedError):
        Zerobit().decode(b"", (4, 4, 4), "int64")


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("threads", [1, 3])
def test_a_voxel_that_is_not_finite_is_named(value: float, threads: int) -> None:
    array = np.zeros((20, 20, 40), np.float32)
    array[3, 17, 38] = array[18, 0, 0] = value
    with pytest.raises(NotFiniteError, match=r"\(z, y, x\) = \(3, 17, 38\) is") as caught:
        Zerobit().encode(array, threads=threads)
    assert caught.value.facts["value"] == str(value)


@pytest.mark.parametrize(
    "wanted", [np.ones((2, 2, 3), bool), np.ones((2, 2, 2)), np.ones((8, 8, 8), bool)]
)
def test_a_mask_that_is_not_a_bool_per_cell(wanted: Any) -> None:
    with pytest.raises(InvalidInputError, match=r"needs a bool per cell of 4³ voxels, \(2, 2, 2\)"):
        Zerobit().encode(np.zeros((8, 8, 8), np.uint8), wanted=wanted)


@pytest.mark.parametrize("background", [-1, 256, 1.5, np.nan, (1, 2), (1, 2, 3)])
def test_a_background_that_no_voxel_can_be(background: Any) -> None:
    with pytest.raises(InvalidInputError, match="background is"):
        Zerobit(background=background).encode(np.zeros((4, 4, 4), np.uint8))


def test_positions_outside_of_the_volume() -> None:
    code = Zerobit().encode(scene((5, 9, 4), "uint8"))
    for voxel in ((5, 0, 0), (0, 9, 0), (0, 0, 4), (-1, 0, 0), (0, 0), (2**70, 0, 0)):
        with pytest.raises(InvalidInputError, match="voxel"):
            Zerobit().decode_voxel(code, voxel)
    for cell in ((2, 0, 0), (0, 3, 0), (0, 0, 1), (0, -1, 0)):
        with pytest.raises(InvalidInputError, match=r"is not one of \(2, 3, 1\)"):
            Zerobit().decode_cell(code, cell)
        with pytest.raises(InvalidInputError):
            Zerobit().decode_plane(code, cell, 0, 0)
    for axis, offset in ((3, 0), (-1, 0), (0, 4), (0, -1)):
        with pytest.raises(InvalidInputError, match="plane axis"):
            Zerobit().decode_plane(code, (0, 0, 0), axis, offset)
    for level in (-1, 3):
        with pytest.raises(InvalidInputError, match="levels 0, 1 and 2"):
            Zerobit().decode_level(code, level)


def test_thread_counts_that_make_no_sense() -> None:
    array = np.zeros((1, 1, 1), np.uint8)
    for threads in (0, -1, 10**6):
        with pytest.raises(InvalidInputError, match="give 1 to 1024"):
            Zerobit().encode(array, threads=threads)
        with pytest.raises(InvalidInputError, match="give 1 to 1024"):
            Zerobit().decode(Zerobit().encode(array), (1, 1, 1), "uint8", threads=threads)


def test_arrays_that_no_codebook_serves() -> None:
    grey, colour = scene((8, 8, 8), "uint8"), scene((8, 8, 8), "uint8", 3)
    with pytest.raises(InvalidInputError, match="no arrays"):
        Zerobit.train([])
    with pytest.raises(InvalidInputError, match="a codebook is for one type"):
        Zerobit.train([grey, colour])
    codebook = Zerobit.train([grey])
    for other in (colour, grey.astype(np.uint16)):
        with pytest.raises(InvalidInputError, match="another sample type or number of channels"):
            Zerobit(codebook=codebook).encode(other)
    with pytest.raises(InvalidInputError):
        Zerobit(codebook=Codebook(b"rubbish")).encode(grey)
    nothing = Zerobit.train([np.zeros((4, 4, 4), np.uint8)])
    with pytest.raises(InvalidInputError, match="has no codewords"):
        Zerobit(codebook=nothing).encode(grey)


# ---- Bytes -----------------------------------------------------------------------------------

SHAPE = (16, 20, 20)


@pytest.fixture
def code() -> bytes:
    """Of 1 × 2 × 2 unit blocks."""
    return Zerobit(0.1).encode(scene(SHAPE, "uint8"))


def refuse(data: bytes, match: str, codec: Zerobit | None = None) -> CorruptBrickError:
    """All ways to read the whole of it refuse it."""
    codec = codec or Zerobit()
    with pytest.raises(CorruptBrickError, match=match) as caught:
        codec.decode(data, SHAPE, "uint8")
    reads: tuple[Callable[[], object], ...] = (
        lambda: codec.decode_level(data, 1),
        lambda: codec.stats(data),
    )
    for read in reads:
        with pytest.raises(CorruptBrickError, match=match):
            read()
    return caught.value


def test_a_code_of_another_size_names_both_sizes(code: bytes) -> None:
    for data in (code[:-1], code + b"\0", code[:100]):
        error = refuse(data, f"{len(code)} bytes, but {len(data)} were given")
        assert error.facts == {"expected_nbytes": len(code), "given_nbytes": len(data)}
    refuse(code[:63], "header")
    refuse(b"", "header")


@pytest.mark.parametrize(
    ("offset", "value"),
    [
        (0, b"x"), (4, b"\2"), (4, b"\0"), (5, b"\5"), (6, b"\0"), (6, b"\2"), (7, b"\2"),
        (8, b"\0\0\0\0"), (20, b"\1\1"), (22, b"\1\1"), (24, b"\1"), (33, b"\1"), (36, b"\1"),
        (45, b"\1"), (44, b"\2\0\0\0\1"), (52, struct.pack("<f", -1)),
        (52, struct.pack("<f", np.nan)), (60, b"\1"),
    ],
)  # fmt: skip
def test_header_fields_outside_of_the_specification(code: bytes, offset: int, value: bytes) -> None:
    refuse(code[:offset] + value + code[offset + len(value) :], "header|bytes, but")


def test_zeros_at_the_end_that_are_not(code: bytes) -> None:
    refuse(code[:-1] + b"\1", "header")


def test_another_shape_or_type_than_expected_is_named(code: bytes) -> None:
    for shape, dtype in (((16, 20, 21), "uint8"), (SHAPE, "int8"), ((*SHAPE, 3), "uint8")):
        with pytest.raises(CorruptBrickError, match=r"the code is of \(16, 20, 20, 'uint8'\), but"):
            Zerobit().decode(code, shape, dtype)


def test_a_huge_shape_in_the_header_allocates_nothing(code: bytes) -> None:
    huge = code[:8] + struct.pack("<3I", *[2**32 - 1] * 3) + code[20:]
    for read in (
        lambda: Zerobit().decode_level(huge, 0),
        lambda: Zerobit().decode_cell(huge, (0, 0, 0)),
    ):
        with pytest.raises(CorruptBrickError):
            read()


def blocks_at(code: bytes) -> tuple[int, int]:
    """Where pointers and unit blocks of a uint8 code of four blocks start."""
    averages, details = struct.unpack_from("<HH", code, 20)
    return 64 + averages + details + 4, 64 + averages + details + 4 + 16


def test_pointers_that_do_not_increase_name_their_block(code: bytes) -> None:
    pointers, _ = blocks_at(code)
    for index, value in ((0, 1), (1, 0), (2, 2**32 - 1), (3, 5)):
        at = pointers + 4 * index
        data = code[:at] + struct.pack("<I", value) + code[at + 4 :]
        refuse(data, "unit block")


@pytest.mark.parametrize("seed", range(8))
def test_every_byte_of_a_unit_block_is_looked_at(code: bytes, seed: int) -> None:
    """A changed byte is refused, unless it is an index that has a codeword, or a map's bits."""
    _, start = blocks_at(code)
    rng = np.random.default_rng(seed)
    original = Zerobit().decode(code, SHAPE, "uint8")
    structure = start + 1 + 8 + 5 * code[start]  # of the first block
    for at in rng.integers(start, structure, 40):
        entry, byte = divmod(int(at) - start - 9, 5)
        average_index = entry >= 0 and byte == 0
        data = bytearray(code)
        data[at] ^= 1 << int(rng.integers(8))
        try:
            found = Zerobit().decode(bytes(data), SHAPE, "uint8")
        except CorruptBrickError:
            continue
        assert average_index, f"byte {at - start} may be anything"
        assert found.shape == original.shape


def test_a_damaged_block_does_not_keep_others_from_being_read(code: bytes) -> None:
    _, start = blocks_at(code)
    data = bytearray(code)
    data[start] += 1  # NNNC of unit block (0, 0, 0)
    codec, original = Zerobit(), Zerobit().decode(code, SHAPE, "uint8")
    assert codec.decode_voxel(data, (0, 19, 2)) == original[0, 19, 2]
    np.testing.assert_array_equal(codec.decode_cell(data, (0, 0, 4)), original[:4, :4, 16:])
    for read in (
        lambda: codec.decode_voxel(data, (15, 15, 15)),
        lambda: codec.decode_cell(data, (3, 3, 3)),
        lambda: codec.decode_plane(data, (0, 0, 0), 0, 0),
    ):
        with pytest.raises(CorruptBrickError, match=r"unit block \(z, y, x\) = \(0, 0, 0\)"):
            read()


def test_a_code_with_another_codebook() -> None:
    array = scene(SHAPE, "uint8")
    one, other = Zerobit.train([array]), Zerobit.train([array // 2])
    code = Zerobit(codebook=one).encode(array)
    for codec in (Zerobit(), Zerobit(codebook=other), Zerobit(codebook=Codebook(one.data[:-1]))):
        refuse(code, "shared codebook", codec)


@st.composite
def damaged_codes(draw: st.DrawFn) -> tuple[tuple[str, int], tuple[int, ...], bytes]:
    """Codes with bytes changed, cut off, or added; most changes behind the codebook."""
    dtype, channels = kind = draw(st.sampled_from(KINDS))
    shape = draw(st.tuples(st.integers(1, 18), st.integers(1, 18), st.integers(1, 34)))
    array = scene(shape, dtype, channels, draw(st.integers(0, 9)))
    code = bytearray(Zerobit(draw(st.sampled_from([0.0, 0.05, 1.0]))).encode(array))
    first = draw(st.sampled_from([0, len(code) // 2, max(0, len(code) - 200)]))
    for at in draw(st.lists(st.integers(first, len(code) - 1), max_size=3)):
        code[at] = draw(st.integers(0, 255))
    cut = draw(st.sampled_from([0, 0, 0, 0, 1, len(code) // 2]))
    return kind, array.shape, bytes(code[: len(code) - cut])


@given(damaged_codes())
@settings(max_examples=250, deadline=None)
def test_damaged_bytes_decode_to_the_shape_or_are_refused(
    damaged: tuple[tuple[str, int], tuple[int, ...], bytes],
) -> None:
    (dtype, _), shape, code = damaged
    try:
        decoded = Zerobit().decode(code, shape, dtype)
    except CorruptBrickError:
        return
    assert decoded.shape == shape
    if dtype == "float32":
        assert np.isfinite(decoded).all()
    last = tuple(n - 1 for n in shape[:3])
    assert (Zerobit().decode_voxel(code, last) == decoded[last]).all()


@given(st.binary(max_size=200))
def test_any_bytes_at_all(data: bytes) -> None:
    for given_bytes in (data, b"OBZB\1" + data):
        with pytest.raises(CorruptBrickError):
            Zerobit().decode_level(given_bytes, 0)


def test_any_contiguous_buffer_is_read_and_no_other(code: bytes) -> None:
    expected = Zerobit().decode(code, SHAPE, "uint8")
    shifted = memoryview(b"-" + code)[1:]
    for data in (bytearray(code), memoryview(code), np.frombuffer(code, np.uint8), shifted):
        np.testing.assert_array_equal(Zerobit().decode(data, SHAPE, "uint8"), expected)
    with pytest.raises(InvalidInputError, match="contiguous"):
        Zerobit().decode(memoryview(code)[::2], SHAPE, "uint8")
