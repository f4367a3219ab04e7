"""What S3Dc with variable widths, scales and predictions refuses: arguments, and foreign bytes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from octobrick.codec import S3dc
from octobrick.codec.errors import CorruptBrickError, InvalidInputError, NotFiniteError

from .generated import volumes

# ---- Arguments -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "parameters",
    [{"bits": 4, "max_error": 1}, {"max_error": 1, "bits_per_voxel": 2}, {"slope": 1, "bits": 2}],
)
def test_two_rules_for_the_width_are_named_with_all_there_are(parameters: Any) -> None:
    with pytest.raises(InvalidInputError, match="give one of bits, max_error"):
        S3dc(**parameters)


@pytest.mark.parametrize(
    "parameters",
    [{"max_error": -1}, {"max_error": math.nan}, {"max_error": math.inf}, {"bits_per_voxel": 0},
     {"bits_per_voxel": -2}, {"slope": 0}, {"slope": math.inf}, {"slope": "steep"},
     {"max_error": 1, "fitted": True}, {"bits": 4, "scale": "round"},
     {"max_error": 1, "scale": "trained"}, {"bits": 2, "fitted": True, "scale": "trained"}],
)  # fmt: skip
def test_parameters_out_of_their_range_or_that_do_not_go_together(parameters: Any) -> None:
    with pytest.raises(InvalidInputError, match="S3dc"):
        S3dc(**parameters)


def test_a_budget_below_the_tables_says_how_much_is_needed_and_that_is_enough(noise: Any) -> None:
    array = noise((16, 16, 16), "uint16")
    with pytest.raises(InvalidInputError, match=r"0\.5 bits per voxel are too few") as caught:
        S3dc((4, 4, 4), bits_per_voxel=0.5).encode(array)
    least = caught.value.facts["least_bits_per_voxel"]
    assert isinstance(least, float)
    code = S3dc((4, 4, 4), bits_per_voxel=least).encode(array)
    assert len(code) * 8 / array.size == pytest.approx(least)


def test_the_size_of_a_variable_code_is_not_known_beforehand() -> None:
    with pytest.raises(InvalidInputError, match="depends on the voxels"):
        S3dc(max_error=1).encoded_nbytes((8, 8, 8), "uint8")


@pytest.mark.parametrize(
    "codec",
    [S3dc(max_error=1), S3dc(bits=2, scale="trained"), S3dc(bits=2, fitted=True),
     S3dc(bits_per_voxel=4)],
    ids=str,
)  # fmt: skip
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_the_first_voxel_that_is_not_finite_is_named_by_every_form(
    noise: Any, codec: S3dc, value: float
) -> None:
    array = noise((20, 9, 30), "float32")
    array[3, 8, 29] = array[4, 0, 0] = value
    with pytest.raises(NotFiniteError, match=r"\(z, y, x\) = \(3, 8, 29\) is") as caught:
        codec.encode(array, threads=3)
    assert caught.value.facts["value"] == str(value)


def test_a_prediction_that_is_not_finite_is_refused_both_ways(noise: Any) -> None:
    array = noise((4, 4, 4), "float32")
    code = S3dc().encode(array, prediction=array)
    spoilt = array.copy()
    spoilt[1, 2, 3] = np.nan
    for call in (
        lambda: S3dc().encode(array, prediction=spoilt),
        lambda: S3dc().decode(code, array.shape, array.dtype, prediction=spoilt),
    ):
        with pytest.raises(NotFiniteError, match=r"\(1, 2, 3\)"):
            call()


def test_balancing_nothing_or_several_types_is_refused(noise: Any) -> None:
    with pytest.raises(InvalidInputError, match="no arrays"):
        S3dc.balanced([], 2)
    with pytest.raises(InvalidInputError, match="one type"):
        S3dc.balanced([noise((4, 4, 4), "uint8"), noise((4, 4, 4), "int8")], 2)


# ---- Bytes ---------------------------------------------------------------------------------

SHAPE, BLOCK = (4, 4, 44), (4, 4, 4)
CODEC = S3dc(BLOCK, max_error=0)


def eleven_blocks(dtype: str = "uint16") -> NDArray[Any]:
    """Blocks of all kinds, in two groups."""
    array = np.zeros(SHAPE, dtype)
    rng = np.random.default_rng(4)
    for k in range(11):
        array[..., 4 * k : 4 * k + 4] = rng.integers(0, 2 ** (k + 6) - 1, (4, 4, 4)) % 65536
    return array


def code_of(dtype: str = "uint16") -> bytearray:
    return bytearray(CODEC.encode(eleven_blocks(dtype)))


GROUPS = 44  # 11 blocks of 4 bytes of end points


def test_a_code_that_ends_early_names_both_sizes() -> None:
    code = code_of()
    for data in (b"", code[:10], code[: GROUPS + 15]):
        with pytest.raises(CorruptBrickError, match=f"has at least 60 bytes, but {len(data)}"):
            CODEC.decode(data, SHAPE, np.uint16)
    for data in (code[:-1], code + b"\0"):
        with pytest.raises(CorruptBrickError, match=f"has {len(code)} bytes, but {len(data)} were"):
            CODEC.decode(data, SHAPE, np.uint16)


@pytest.mark.parametrize(
    ("at", "byte", "block"),
    [(GROUPS, 1, 0), (GROUPS + 11, 0x7F, 8), (GROUPS + 8, 255, 8), (GROUPS + 13, 0x10, 8),
     (GROUPS + 15, 0x80, 8)],
)  # fmt: skip
def test_groups_that_do_not_add_up_are_named(at: int, byte: int, block: int) -> None:
    code = code_of()
    code[at] ^= byte
    with pytest.raises(CorruptBrickError, match=rf"from block .* \(0, 0, {block}\)"):
        CODEC.decode(code, SHAPE, np.uint16)


def test_eight_bit_samples_have_no_width_above_eight() -> None:
    codec, array = S3dc(BLOCK, bits_per_voxel=3), np.zeros((4, 4, 8), np.uint8)
    code = bytearray(codec.encode(array))
    for width in (9, 14, 15):
        code[8] = width
        with pytest.raises(CorruptBrickError, match="widths"):
            codec.decode(code + b"\0" * 8 * width, array.shape, np.uint8)


def test_end_points_out_of_order_are_named() -> None:
    code = code_of()
    code[4 * 9 : 4 * 9 + 4] = bytes([2, 0, 1, 0])
    with pytest.raises(CorruptBrickError, match=r"\(0, 0, 9\) has minimum 2 and maximum 1"):
        CODEC.decode(code, SHAPE, np.uint16)


@pytest.mark.parametrize("dtype", ["uint16", "float32"])
def test_raw_voxels_outside_of_their_end_points_are_refused(dtype: str) -> None:
    array = np.random.default_rng(1).integers(0, 65536, (4, 4, 4)).astype(dtype)
    array += array.dtype.type(0) if dtype == "uint16" else np.float32(0.01)
    code = bytearray(CODEC.encode(array))
    assert CODEC.block_widths(code, array.shape, dtype).item() == 8 * array.itemsize
    code[-array.itemsize :] = np.array([np.nan if dtype == "float32" else 65535], dtype).tobytes()
    code[: 2 * array.itemsize] = np.array([array.min(), 65534], dtype).tobytes()
    with pytest.raises(CorruptBrickError, match=r"uncoded block .* outside of its end points"):
        CODEC.decode(code, array.shape, dtype)


def test_a_raw_block_that_is_marked_as_a_difference_is_refused() -> None:
    array = eleven_blocks()
    code = bytearray(CODEC.encode(array, prediction=array[:, :, ::-1].copy()))
    flags = GROUPS + 16
    assert CODEC.block_widths(code, SHAPE, np.uint16, predicted=True)[0, 0, 10] == 16
    code[flags + 1] |= 1 << 2
    with pytest.raises(CorruptBrickError, match="group of blocks"):
        CODEC.decode(code, SHAPE, np.uint16, prediction=array)


@pytest.mark.parametrize(("from_end", "byte"), [(-1, 0x88), (-2, 0x0F), (-12, 0), (-10, 1)])
def test_scales_and_choices_that_no_encoder_writes_are_refused(from_end: int, byte: int) -> None:
    """Behind the rows: eight scales of four positions of 16 bits, and choices of three blocks."""
    codec, array = S3dc(BLOCK, 2, scale="trained"), eleven_blocks()[:, :, :12]
    code = bytearray(codec.encode(array))
    code[from_end] = byte
    with pytest.raises(CorruptBrickError, match="scale"):
        codec.decode(code, array.shape, array.dtype)


@st.composite
def damaged(draw: st.DrawFn) -> tuple[S3dc, NDArray[Any], bytes, NDArray[Any] | None]:
    """Codes of any form with bytes changed, cut off, or added."""
    array = draw(volumes(most_voxels=2000))
    codec = draw(
        st.sampled_from(
            [S3dc(BLOCK, max_error=1), S3dc((2, 3, 5), bits_per_voxel=200), S3dc(slope=100),
             S3dc(BLOCK, 3), S3dc(BLOCK, 2, scale="trained")]
        )
    )  # fmt: skip
    predicted = codec.scale == "linear" and draw(st.booleans())
    prediction = array[::-1] if predicted else None
    code = bytearray(codec.encode(array, prediction=prediction))
    tables = st.integers(0, min(len(code) - 1, 200))
    for at in draw(st.lists(st.one_of(tables, st.integers(0, len(code) - 1)), max_size=4)):
        code[at] = draw(st.sampled_from([0, 1, 0x7F, 0x80, 0xFF, draw(st.integers(0, 255))]))
    cut = draw(st.sampled_from([0, 0, 0, 1, len(code) // 2]))
    return codec, array, bytes(code[: len(code) - cut]), prediction


@given(damaged())
@settings(max_examples=300, deadline=None)
def test_damaged_bytes_decode_to_finite_voxels_or_are_refused(
    case: tuple[S3dc, NDArray[Any], bytes, NDArray[Any] | None],
) -> None:
    codec, array, code, prediction = case
    try:
        decoded = codec.decode(code, array.shape, array.dtype, prediction=prediction)
    except CorruptBrickError:
        return
    assert np.isfinite(decoded).all()
