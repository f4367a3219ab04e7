"""Bricks of any length share pages under a hard budget, and none lies on another."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from octobrick.codec.errors import CorruptBrickError, ResourceError
from octobrick.renderer.brick_codes import BrickCodes
from octobrick.renderer.brick_pool import ALIGNMENT, BrickPool, Page
from octobrick.renderer.code_layout import CodeLayout
from octobrick.renderer.free_list import FreeList
from octobrick.store.box import Zyx


class Memory:
    """Stands in for GL: buffers that can be read back."""

    info: dict[str, Any] = {"GL_MAX_SHADER_STORAGE_BLOCK_SIZE": 1 << 27}  # noqa: RUF012

    def __init__(self) -> None:
        self.nbytes = 0

    def buffer(self, reserve: int) -> Buffer:
        self.nbytes += reserve
        return Buffer(self, reserve)


class Buffer:
    def __init__(self, memory: Memory, nbytes: int) -> None:
        self.memory, self.data = memory, bytearray(nbytes)

    def write(self, data: bytes, offset: int) -> None:
        assert offset % ALIGNMENT == 0
        assert offset + len(data) <= len(self.data)
        self.data[offset : offset + len(data)] = data

    def release(self) -> None:
        self.memory.nbytes -= len(self.data)


# Of form "zerobit" bricks may have any length; codes are not checked here.
LAYOUT = CodeLayout("zerobit", "uint8", (16, 16, 16))


class Codes(BrickCodes):
    def upload(self, zyx: Zyx) -> bytes | None:
        return self.read(zyx)


def codes_of(read: Callable[[Zyx], bytes | None], revision: str = "r") -> BrickCodes:
    return Codes(("voxels", revision, 0, 0, 0), LAYOUT, read)


def content(nbytes: int, seed: int) -> bytes:
    return np.random.default_rng(seed).bytes(nbytes)


@given(st.lists(st.tuples(st.booleans(), st.integers(1, 40)), max_size=60))
def test_what_is_taken_never_overlaps_and_what_is_given_back_becomes_one_hole(
    steps: list[tuple[bool, int]],
) -> None:
    free, taken = FreeList(100), []
    for is_take, n in steps:
        if is_take:
            start = free.take(n)
            if start is None:
                used = {i for a, k in taken for i in range(a, a + k)}
                assert all(used & set(range(i, i + n)) for i in range(100 - n + 1))
                continue
            assert 0 <= start <= 100 - n
            assert all(start + n <= a or a + k <= start for a, k in taken)
            taken.append((start, n))
        elif taken:
            free.give_back(*taken.pop(n % len(taken)))
        assert free.free_nbytes == 100 - sum(k for _, k in taken)
    for hole in taken:
        free.give_back(*hole)
    assert free.is_empty
    assert free.take(100) == 0


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.lists(st.integers(0, 30), min_size=1, max_size=12, unique=True), max_size=8),
    st.lists(st.integers(1, 900), min_size=31, max_size=31),
    st.integers(900, 4000),
    st.integers(904, 2048),
)
def test_every_brick_of_a_batch_has_its_bytes_under_any_budget(
    frames: list[list[int]], sizes: list[int], budget_nbytes: int, page_nbytes: int
) -> None:
    memory = Memory()
    budget_nbytes, page_nbytes = max(budget_nbytes, 912), max(page_nbytes, 912)
    pool = BrickPool(memory, budget_nbytes, page_nbytes)  # type: ignore[arg-type]
    for frame in frames:
        bricks = [(0, 0, i) for i in frame]
        found = []
        codes = codes_of(lambda zyx: content(sizes[zyx[2]], zyx[2]) if zyx[2] % 7 else None)
        for batch in pool.batches(codes, bricks):
            for brick in batch:
                i, page = brick.brick_zyx[2], brick.page
                assert (page is None) == (i % 7 == 0)
                if page is not None:
                    end = brick.offset_nbytes + sizes[i]
                    assert page.buffer.data[brick.offset_nbytes : end] == content(sizes[i], i)  # type: ignore[attr-defined]
                found.append(brick.brick_zyx)
            assert memory.nbytes == pool.allocated_nbytes <= budget_nbytes
            assert pool.resident_nbytes <= pool.allocated_nbytes
        assert sorted(found) == sorted(bricks)
    pool.release()
    assert memory.nbytes == pool.resident_nbytes == 0


def test_the_longest_unused_brick_makes_room() -> None:
    reads: list[int] = []

    def read(zyx: Zyx) -> bytes:
        reads.append(zyx[2])
        return bytes(100)

    pool, codes = BrickPool(Memory(), 3 * 112), codes_of(read)  # type: ignore[arg-type]
    for x in (0, 1, 2, 0, 3, 0, 2, 1):
        list(pool.batches(codes, [(0, 0, x)]))
    assert reads == [0, 1, 2, 3, 1]


def test_a_brick_longer_than_a_page_gets_one_of_its_own() -> None:
    pages: set[Page] = set()
    pool = BrickPool(Memory(), 1 << 28)  # type: ignore[arg-type]
    sizes = {0: 100, 1: 20 << 20, 2: 100}
    codes = codes_of(lambda zyx: bytes(sizes[zyx[2]]))
    for batch in pool.batches(codes, [(0, 0, x) for x in sizes]):
        pages |= {brick.page for brick in batch if brick.page}
    assert sorted(page.nbytes for page in pages) == [16 << 20, 20 << 20]


def test_absent_bricks_are_looked_up_once() -> None:
    reads: list[Zyx] = []
    pool = BrickPool(Memory(), 1 << 20)  # type: ignore[arg-type]
    codes = codes_of(lambda zyx: reads.append(zyx))
    for _ in range(3):
        [batch] = pool.batches(codes, [(0, 0, 0), (0, 0, 1)])
        assert all(brick.page is None for brick in batch)
    assert len(reads) == 2


def test_bricks_of_another_revision_are_others() -> None:
    pool = BrickPool(Memory(), 1 << 20)  # type: ignore[arg-type]
    for revision in "ab":
        list(pool.batches(codes_of(lambda _: b"1234", revision), [(0, 0, 0)]))
    assert pool.uploaded_nbytes == 8


def test_a_brick_beyond_what_shaders_can_read_is_refused_with_both_sizes() -> None:
    pool = BrickPool(Memory(), 1 << 20, page_nbytes_max=4096)  # type: ignore[arg-type]
    with pytest.raises(ResourceError, match="5000 bytes, more than the 4096 bytes"):
        list(pool.batches(codes_of(lambda _: bytes(5000)), [(0, 0, 0)]))


def test_bytes_that_are_no_code_name_the_brick() -> None:
    codes = BrickCodes(
        ("voxels", "r", 3, 0, 0), CodeLayout("raw", "uint8", (4, 4, 4)), lambda _: b"?"
    )
    pool = BrickPool(Memory(), 1 << 20)  # type: ignore[arg-type]
    with pytest.raises(CorruptBrickError, match=r"brick \(1, 2, 3\) of level 3: 1 bytes"):
        list(pool.batches(codes, [(1, 2, 3)]))
