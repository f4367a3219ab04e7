"""The native codec and the numpy reference are two writings of one formula: same bytes, always."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from octobrick.codec import S3dc, _native, reference
from octobrick.codec.errors import InvalidInputError

DTYPES = ("uint8", "int8", "uint16", "int16", "float32")
finite = st.floats(allow_nan=False, allow_infinity=False, width=32)


@st.composite
def volumes(draw: st.DrawFn) -> NDArray[Any]:
    """Small arrays, some with rows longer than one chunk (64), of few values or of any."""
    dtype = np.dtype(draw(st.sampled_from(DTYPES)))
    long_row = draw(st.booleans())
    shape = draw(st.tuples(st.integers(1, 3 if long_row else 9), st.integers(1, 5),
                           st.integers(60, 140) if long_row else st.integers(1, 20)))  # fmt: skip
    elements = finite if dtype.kind == "f" else hnp.from_dtype(dtype)
    return draw(hnp.arrays(dtype, shape, elements=elements, fill=elements))


blocks = st.tuples(st.integers(1, 10), st.integers(1, 10), st.integers(1, 70))


@given(volumes(), blocks, st.integers(1, 8), st.booleans())
@settings(max_examples=150, deadline=None)
def test_native_code_and_voxels_equal_those_of_the_reference(
    array: NDArray[Any], block: tuple[int, int, int], bits: int, simd: bool
) -> None:
    code = _native.encode(array, block, bits, simd=simd)
    assert code == reference.encode(array, block, bits)
    decoded = np.empty_like(array)
    outcome = _native.decode_into(code, decoded, block, bits, simd=simd)
    assert outcome.status is _native.Status.OK
    expected = reference.decode(code, array.shape, array.dtype, block, bits)
    assert decoded.tobytes() == expected.tobytes()  # bytes: −0 and +0 are not the same


@pytest.mark.parametrize("bits", range(1, 9))
@pytest.mark.parametrize(
    ("shape", "block"),
    [
        ((1, 1, 1), (8, 8, 8)),
        ((1, 1, 7), (1, 1, 1)),
        ((1, 300, 1), (8, 8, 8)),
        ((17, 13, 11), (8, 8, 8)),
        ((5, 3, 64), (2, 3, 5)),
        ((2, 2, 65), (64, 64, 64)),
        ((3, 9, 191), (4, 4, 48)),
    ],
)
def test_shapes_that_no_block_divides(
    noise: Any, dtype: Any, shape: tuple[int, int, int], block: tuple[int, int, int], bits: int
) -> None:
    array = noise(shape, dtype)
    codec = S3dc(block, bits)
    code = codec.encode(array)
    assert code == reference.encode(array, block, bits)
    assert len(code) == codec.encoded_nbytes(shape, dtype)
    decoded = codec.decode(code, shape, dtype)
    assert decoded.dtype == dtype
    assert decoded.flags.c_contiguous
    np.testing.assert_array_equal(decoded, reference.decode(code, shape, dtype, block, bits))


STRIDINGS = {
    "reversed": lambda a: a[::-1, ::-1, ::-1],
    "reversed in x": lambda a: a[:, :, ::-1],
    "every third": lambda a: a[::3, ::2, ::3],
    "transposed": lambda a: a.transpose(2, 0, 1),
    "Fortran": np.asfortranarray,
    "a window": lambda a: a[1:-1, 2:-1, 3:],
    "repeated rows": lambda a: np.broadcast_to(a[:, :1], a.shape),
    "one value": lambda a: np.broadcast_to(a[:1, :1, :1], a.shape),
    "foreign byte order": lambda a: a.astype(a.dtype.newbyteorder("S")),
}


@pytest.mark.parametrize("striding", STRIDINGS)
def test_strides_change_nothing(noise: Any, dtype: Any, striding: str) -> None:
    strided = STRIDINGS[striding](noise((19, 12, 83), dtype))
    codec = S3dc((4, 8, 8), 5)
    assert codec.encode(strided) == codec.encode(np.ascontiguousarray(strided))


def test_samples_that_are_not_aligned(noise: Any, dtype: Any) -> None:
    records = np.zeros((4, 5, 70), np.dtype([("tag", "u1"), ("value", dtype)]))
    records["value"] = noise(records.shape, dtype)
    codec = S3dc((2, 2, 4), 3)
    assert codec.encode(records["value"]) == codec.encode(records["value"].copy())
    shifted = np.zeros(4 * 5 * 70 * dtype.itemsize + 1, np.uint8)[1:].view(dtype)
    shifted = shifted.reshape(4, 5, 70)
    shifted[:] = records["value"]
    assert codec.encode(shifted) == codec.encode(records["value"].copy())


def test_decoding_into_strided_memory(noise: Any, dtype: Any) -> None:
    array = noise((6, 7, 90), dtype)
    codec = S3dc((4, 4, 4), 4)
    code = codec.encode(array)
    room = np.zeros((6, 180, 7), dtype)
    out = room.transpose(0, 2, 1)[:, ::-1, ::2]
    assert codec.decode(code, array.shape, dtype, out=out) is out
    np.testing.assert_array_equal(out, codec.decode(code, array.shape, dtype))
    assert not room.transpose(0, 2, 1)[:, :, 1::2].any()
    with pytest.raises(InvalidInputError, match="out is"):
        codec.decode(code, array.shape, dtype, out=out[1:])


@pytest.mark.parametrize("bits", [1, 4, 7])
def test_threads_and_instruction_sets_change_nothing(noise: Any, dtype: Any, bits: int) -> None:
    array = noise((37, 41, 150), dtype)
    block = (8, 8, 8)
    codes = {
        _native.encode(array, block, bits, threads, simd)
        for threads in (1, 2, 7)
        for simd in (False, True)
    }
    assert len(codes) == 1
    code = codes.pop()
    decoded = set()
    for threads in (1, 2, 7):
        for simd in (False, True):
            out = np.empty_like(array)
            _native.decode_into(code, out, block, bits, threads, simd)
            decoded.add(out.tobytes())
    assert len(decoded) == 1


def test_an_array_above_the_threading_threshold_round_trips(noise: Any) -> None:
    array = noise((40, 256, 512), "uint8")
    codec = S3dc(bits=8)
    assert codec.encode(array) == codec.encode(array, threads=1)
    np.testing.assert_array_equal(codec.decode(codec.encode(array), array.shape, "uint8"), array)
