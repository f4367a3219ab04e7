"""What S3Dc refuses, and what it says: bad arguments, and bytes that `encode` did not write."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from octobrick.codec import S3dc
from octobrick.codec.errors import (
    CorruptBrickError,
    InvalidInputError,
    NotFiniteError,
    UnsupportedError,
)

# ---- Arguments -----------------------------------------------------------------------------


@pytest.mark.parametrize("bits", [0, 9, -1, 2**70])
def test_bits_outside_1_to_8(bits: int) -> None:
    with pytest.raises(InvalidInputError, match=f"bits is {bits}; give 1 to 8"):
        S3dc(bits=bits)


@pytest.mark.parametrize("block", [(0, 8, 8), (8, -1, 8), (8, 8), (8, 8, 8, 8), (2**64, 1, 1)])
def test_blocks_without_three_positive_axes(block: Any) -> None:
    with pytest.raises(InvalidInputError, match="S3dc block is") as caught:
        S3dc(block=block)
    assert caught.value.facts["given"] == [str(b) for b in block]


@pytest.mark.parametrize(
    "codec", [{"bits": 2.5}, {"bits": "4"}, {"block": 8}, {"block": (8, 8, 1.5)}]
)
def test_parameters_that_are_no_integers(codec: Any) -> None:
    with pytest.raises(InvalidInputError, match="integer"):
        S3dc(**codec)


@pytest.mark.parametrize("shape", [(0, 4, 4), (4, 0, 4), (4, 4, 0), (4, 4), (2, 2, 2, 2), ()])
def test_arrays_without_three_axes_that_hold_voxels(shape: tuple[int, ...]) -> None:
    with pytest.raises(InvalidInputError, match=r"give three axes \(z, y, x\)") as caught:
        S3dc().encode(np.zeros(shape, np.uint8))
    assert caught.value.facts["shape"] == list(shape)


@pytest.mark.parametrize("dtype", ["bool", "int32", "uint64", "float64", "complex64"])
def test_sample_types_that_are_not_supported_are_named_with_those_that_are(dtype: str) -> None:
    with pytest.raises(UnsupportedError, match=f"no {dtype} samples.*float32"):
        S3dc().encode(np.zeros((2, 2, 2), dtype))
    with pytest.raises(UnsupportedError):
        S3dc().decode(b"", (2, 2, 2), dtype)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("threads", [1, 5])
def test_the_first_voxel_that_is_not_finite_is_named(
    noise: Any, value: float, threads: int
) -> None:
    """In memory order, not in the order in which blocks are worked."""
    array = noise((20, 30, 70), "float32")
    array[3, 25, 69] = array[4, 0, 0] = array[19, 29, 1] = value
    with pytest.raises(NotFiniteError, match=r"\(z, y, x\) = \(3, 25, 69\) is") as caught:
        S3dc().encode(array[:, :, :], threads=threads)
    assert caught.value.facts == {"voxel_zyx": [3, 25, 69], "value": str(value)}
    with pytest.raises(NotFiniteError, match=r"\(z, y, x\) = \(0, 0, 68\)"):
        S3dc().encode(array[::-1, ::-1, ::-1])


def test_shapes_whose_size_overflows() -> None:
    for shape in [(2**31, 2**31, 2**31), (2**62, 1, 4), (1, 2**62, 2**61), (3, 2**61, 2)]:
        with pytest.raises(InvalidInputError, match="more bytes than this machine can count"):
            S3dc((1, 1, 1), 8).encoded_nbytes(shape, "float32")
    with pytest.raises(InvalidInputError, match="each at least 1"):
        S3dc().encoded_nbytes((2**64, 1, 1), "uint8")


def test_thread_counts_that_make_no_sense() -> None:
    for threads in (0, -3, 10**6):
        with pytest.raises(InvalidInputError, match="give 1 to 1024"):
            S3dc().encode(np.zeros((1, 1, 1), np.uint8), threads=threads)


# ---- Bytes ---------------------------------------------------------------------------------


def test_a_code_of_another_size_names_both_sizes() -> None:
    code = S3dc().encode(np.zeros((4, 4, 4), np.uint8))
    for data in (b"", code[:-1], code + b"\0", code * 2):
        with pytest.raises(CorruptBrickError, match=f"has {len(code)} bytes, but {len(data)}"):
            S3dc().decode(data, (4, 4, 4), np.uint8)


def test_a_huge_shape_is_refused_before_anything_is_allocated() -> None:
    """2^60 voxels would not fit any memory: the size of the data is looked at first."""
    with pytest.raises(CorruptBrickError) as caught:
        S3dc().decode(b"\0" * 100, (2**20, 2**20, 2**20), np.uint8)
    assert caught.value.facts["given_nbytes"] == 100


@pytest.mark.parametrize(
    ("dtype", "ends"),
    [
        ("uint8", (7, 6)), ("int8", (1, -128)), ("uint16", (65535, 0)), ("int16", (0, -1)),
        ("float32", (1.5, 1.25)), ("float32", (np.nan, 1)), ("float32", (0, np.nan)),
        ("float32", (0, np.inf)), ("float32", (-np.inf, 0)),
    ],
)  # fmt: skip
@pytest.mark.parametrize("threads", [1, 5])
def test_end_points_out_of_order_name_block_and_values(
    dtype: str, ends: tuple[float, float], threads: int
) -> None:
    codec, shape = S3dc((2, 2, 2), 4), (6, 6, 70)
    code = bytearray(codec.encode(np.zeros(shape, dtype)))
    pairs = np.frombuffer(code, dtype, count=2 * 3 * 3 * 35).reshape(3, 3, 35, 2)
    pairs[1, 2, 30] = pairs[2, 0, 0] = ends
    with pytest.raises(CorruptBrickError, match=r"block \(bz, by, bx\) = \(1, 2, 30\)") as caught:
        codec.decode(code, shape, dtype, threads=threads)
    low, high = (np.dtype(dtype).type(e).astype(float) for e in ends)
    assert caught.value.facts == {
        "block_zyx": [1, 2, 30], "minimum": str(low), "maximum": str(high),
    }  # fmt: skip


@pytest.mark.parametrize(("bits", "nx"), [(1, 3), (3, 5), (4, 7), (7, 70), (8, 65)])
def test_padding_bits_that_are_set_name_the_row(bits: int, nx: int) -> None:
    codec, shape = S3dc(bits=bits), (3, 4, nx)
    code = bytearray(codec.encode(np.zeros(shape, np.uint8)))
    row_nbytes = 2 * -(-nx * bits // 16)
    assert row_nbytes * 8 > nx * bits, "a row without padding tests nothing"
    last_byte_of_row = codec.end_points_nbytes(shape, np.uint8) + row_nbytes * (2 * 4 + 1 + 1) - 1
    code[last_byte_of_row] |= 0x80
    with pytest.raises(CorruptBrickError, match=r"\(z, y\) = \(2, 1\) has padding bits"):
        codec.decode(code, shape, np.uint8)


@st.composite
def damaged_codes(draw: st.DrawFn) -> tuple[S3dc, tuple[int, int, int], str, bytes]:
    """Codes with bytes changed, cut off, or added."""
    codec = S3dc(draw(st.tuples(*[st.integers(1, 5)] * 3)), draw(st.integers(1, 8)))
    shape = draw(st.tuples(st.integers(1, 4), st.integers(1, 4), st.integers(1, 70)))
    dtype = draw(st.sampled_from(["uint8", "int8", "uint16", "int16", "float32"]))
    rng = np.random.default_rng(draw(st.integers(0, 99)))
    code = bytearray(codec.encode((rng.normal(size=shape) * 40).astype("int8").astype(dtype)))
    for at in draw(st.lists(st.integers(0, len(code) - 1), max_size=4)):
        code[at] = draw(st.integers(0, 255))
    cut = draw(st.sampled_from([0, 0, 0, 1, len(code) // 2]))
    return (
        codec,
        shape,
        dtype,
        bytes(code[: len(code) - cut]) + b"\7" * draw(st.sampled_from([0, 0, 0, 1])),
    )


@given(damaged_codes())
@settings(max_examples=300, deadline=None)
def test_damaged_bytes_decode_within_their_end_points_or_are_refused(
    damaged: tuple[S3dc, tuple[int, int, int], str, bytes],
) -> None:
    codec, shape, dtype, code = damaged
    try:
        decoded = codec.decode(code, shape, dtype)
    except CorruptBrickError:
        return
    ends = np.frombuffer(
        code, dtype, codec.end_points_nbytes(shape, dtype) // np.dtype(dtype).itemsize
    )
    grid = [-(-n // b) for n, b in zip(shape, codec.block, strict=True)]
    ends = ends.reshape(*grid, 2)
    for axis, (n, b) in enumerate(zip(shape, codec.block, strict=True)):
        ends = ends.take(np.arange(n) // b, axis)
    assert (ends[..., 0] <= decoded).all()
    assert (decoded <= ends[..., 1]).all()


@given(st.binary(max_size=64), st.integers(1, 8))
def test_any_bytes_at_all(data: bytes, bits: int) -> None:
    try:
        S3dc(bits=bits).decode(data, (1, 3, 3), "float32")
    except CorruptBrickError:
        pass
    else:
        assert len(data) == S3dc(bits=bits).encoded_nbytes((1, 3, 3), "float32")


def test_any_contiguous_buffer_is_read_and_no_other() -> None:
    array = np.arange(27, dtype=np.uint16).reshape(3, 3, 3)
    codec = S3dc(bits=8)
    code = codec.encode(array)
    expected = codec.decode(code, array.shape, array.dtype)
    words = np.frombuffer(code, np.uint16)
    shifted = memoryview(b"-" + code)[1:]
    for data in (bytearray(code), memoryview(code), words, shifted):
        np.testing.assert_array_equal(codec.decode(data, array.shape, array.dtype), expected)
    with pytest.raises(InvalidInputError, match="contiguous"):
        codec.decode(memoryview(code * 2)[::2], array.shape, array.dtype)


def test_end_points_are_little_endian_pairs() -> None:
    code = S3dc().encode(np.array([[[300, 5, 7]]], np.uint16))
    assert struct.unpack_from("<HH", code) == (5, 300)
