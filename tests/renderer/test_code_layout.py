"""What shaders are told of a brick's bytes is what the codec makes."""

from __future__ import annotations

import numpy as np
import pytest

from octobrick.codec import S3dc, Zerobit
from octobrick.codec.errors import CorruptBrickError, UnsupportedError
from octobrick.renderer.code_check import checked_code
from octobrick.renderer.code_layout import BOUND_NBYTES, CodeLayout

from .array_source import ArraySource

DTYPES = ["uint8", "int8", "uint16", "int16", "float32"]


@pytest.mark.parametrize("bits", range(1, 9))
@pytest.mark.parametrize("brick_x", [16, 20, 21])
@pytest.mark.parametrize("block", [1, 2, 3, 4, 6, 8, 16])
def test_the_indices_of_a_run_lie_in_two_words_one_block_and_the_brick(
    bits: int, block: int, brick_x: int
) -> None:
    shape = (3, 3, brick_x)
    source = ArraySource(np.zeros(shape, np.uint8), codec=S3dc((8, 8, block), bits), brick=shape)
    layout = CodeLayout.of(source, 0)
    assert min(block, brick_x) % layout.run == 0
    assert brick_x % layout.run == 0
    row_nbits = -(-brick_x * bits // 16) * 16
    first = 8 * S3dc((8, 8, block), bits).end_points_nbytes(shape, np.uint8)
    for y in range(9):
        for x in range(0, brick_x, layout.run):
            begin = first + y * row_nbits + x * bits
            words = (begin + layout.run * bits - 1) // 32 - begin // 32 + 1
            assert words <= (2 if layout.crosses_words else 1)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("codec", [S3dc(), S3dc((5, 3, 7), 3), S3dc(scale="trained"), None])
def test_where_all_bricks_have_one_size_it_is_known(dtype: str, codec: S3dc | None) -> None:
    brick = (9, 14, 21)
    source = ArraySource(np.ones(brick, dtype), codec=codec, brick=brick)
    code = source.brick_code(0, (0, 0, 0))
    layout = CodeLayout.of(source, 0)
    assert code is not None
    assert layout.has_one_size
    assert layout.code_nbytes == len(code)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("codec", [S3dc(max_error=0), S3dc(bits_per_voxel=9), Zerobit(1)])
def test_no_brick_takes_more_than_its_layout_says(dtype: str, codec: S3dc | Zerobit) -> None:
    brick = (16, 24, 40)
    rng = np.random.default_rng(1)
    voxels = rng.integers(0, 256, brick[0] * brick[1] * brick[2] * np.dtype(dtype).itemsize, "u1")
    array = np.nan_to_num(voxels.view(dtype).reshape(brick), posinf=0, neginf=0)
    layout = CodeLayout.of(ArraySource(array, codec=codec, brick=brick), 0)
    assert not layout.has_one_size
    assert len(codec.encode(array)) <= layout.code_nbytes - BOUND_NBYTES * isinstance(codec, S3dc)


@pytest.mark.parametrize(
    "codec", [S3dc(max_error=2), S3dc(slope=3.0), Zerobit(0.2), Zerobit(0.2, thresholds="block")]
)
def test_damaged_codes_are_refused_by_the_brick_or_are_codes(codec: S3dc | Zerobit) -> None:
    """A shader trusts what passes; so whatever passes must be what the codec itself decodes."""
    rng = np.random.default_rng(3)
    brick = (16, 20, 24)
    array = rng.integers(0, 99, brick).astype(np.int16)
    layout = CodeLayout.of(ArraySource(array, codec=codec, brick=brick), 0)
    sound = codec.encode(array)
    assert checked_code(layout, sound, "brick", 0, (0, 0, 0)).startswith(sound)
    messages = []
    for _ in range(300):
        code = bytearray(sound)
        for at in rng.integers(0, len(code) // 4 if rng.random() < 0.7 else len(code), 2):
            code[at] ^= int(rng.integers(1, 256))
        damaged = bytes(code[: rng.integers(len(code))] if rng.random() < 0.2 else code)
        try:
            checked_code(layout, damaged, "brick (1, 2, 3) of level 0", 0, (1, 2, 3))
        except CorruptBrickError as error:
            messages.append(str(error))
        else:
            codec.decode(damaged, brick, array.dtype)
    assert len(messages) > 50
    assert all(message.startswith("brick (1, 2, 3) of level 0: ") for message in messages)


def test_a_zerobit_code_of_another_shape_is_refused_with_both() -> None:
    array = np.arange(16**3, dtype=np.uint16).reshape(16, 16, 16)
    layout = CodeLayout.of(ArraySource(array, codec=Zerobit(), brick=16), 0)
    for other in (array[:8], array.astype(np.int16)):
        with pytest.raises(CorruptBrickError, match=r"expected \(16, 16, 16\) uint16"):
            checked_code(layout, Zerobit().encode(other), "brick", 0, (0, 0, 0))


def test_a_codec_that_nobody_decodes_is_named() -> None:
    source = ArraySource(np.ones((8, 8, 8), np.uint8), codec=None, brick=8)
    source.level_codec = lambda _: "huffman"  # type: ignore[assignment,return-value]
    with pytest.raises(UnsupportedError, match="not huffman"):
        CodeLayout.of(source, 0)
