from __future__ import annotations

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from octobrick.codec.errors import CorruptBrickError
from octobrick.store import frame

CONTENT = bytes(range(256)) * 40


@given(content=st.binary(max_size=5000), level=st.sampled_from([1, 3, 19]))
def test_a_frame_gives_back_its_content(content: bytes, level: int) -> None:
    assert frame.decompress(frame.compress(content, level), len(content)) == content


def test_a_damaged_checksum_is_named_with_the_computed_one() -> None:
    stored = frame.compress(CONTENT, 3)
    damaged = stored[:-4] + bytes(b ^ 0xFF for b in stored[-4:])
    with pytest.raises(CorruptBrickError, match="checksum") as caught:
        frame.decompress(damaged, len(CONTENT))
    good = int.from_bytes(stored[-4:], "little")
    bad = int.from_bytes(damaged[-4:], "little")
    assert caught.value.facts["computed_checksum"] == f"{good:08x}"
    assert caught.value.facts["stored_checksum"] == f"{bad:08x}"


def test_a_frame_that_announces_another_size_is_refused_before_it_is_decoded() -> None:
    bomb = frame.compress(bytes(50_000_000), 3)
    with pytest.raises(CorruptBrickError, match="50000000") as caught:
        frame.decompress(bomb, 4096)
    assert caught.value.facts["expected_nbytes"] == 4096


@given(st.data())
def test_damaged_frames_raise_a_corrupt_brick_error_or_give_the_content(
    data: st.DataObject,
) -> None:
    stored = bytearray(frame.compress(CONTENT, 3))
    if data.draw(st.booleans()):
        del stored[data.draw(st.integers(0, len(stored) - 1)) :]
    else:
        position = data.draw(st.integers(0, len(stored) - 1))
        stored[position] ^= data.draw(st.integers(1, 255))
    with contextlib.suppress(CorruptBrickError):
        assert frame.decompress(bytes(stored), len(CONTENT)) == CONTENT


def test_bytes_after_the_frame_are_refused() -> None:
    with pytest.raises(CorruptBrickError):
        frame.decompress(frame.compress(CONTENT, 3) + b"more", len(CONTENT))
