"""The cache: bounded in bytes, one maker for each value, no error kept."""

from __future__ import annotations

import threading
from collections import Counter
from concurrent.futures import ThreadPoolExecutor

import pytest
from hypothesis import given
from hypothesis import strategies as st

from octobrick.server.byte_cache import ENTRY_NBYTES, ByteCache

WAIT_SECONDS = 30  # only a failing test waits as long


def fail() -> bytes:
    raise AssertionError("the value was kept; nobody should make it")


def test_a_kept_value_is_not_made_again_even_where_it_is_none() -> None:
    cache: ByteCache[str] = ByteCache(10_000)
    assert cache.get("a", lambda: b"A") == b"A"
    assert cache.get("b", lambda: None) is None
    assert cache.get("a", fail) == b"A"
    assert cache.get("b", fail) is None
    assert cache.stats() == {
        "nbytes": 2 * ENTRY_NBYTES + 1,
        "entries": 2,
        "hits_total": 2,
        "misses_total": 2,
        "joined_total": 0,
        "evictions_total": 0,
    }


def test_the_least_recently_used_value_goes_first() -> None:
    cache: ByteCache[str] = ByteCache(2 * (ENTRY_NBYTES + 100))
    for key in ("old", "used"):
        cache.get(key, lambda: bytes(100))
    cache.get("old", fail)
    cache.get("new", lambda: bytes(100))
    cache.get("old", fail)
    assert cache.get("used", lambda: b"made again") == b"made again"


@given(
    st.integers(0, 8_000),
    st.lists(st.tuples(st.integers(0, 9), st.integers(0, 3_000)), max_size=60),
)
def test_never_more_bytes_than_the_capacity(
    capacity_nbytes: int, requests: list[tuple[int, int]]
) -> None:
    cache: ByteCache[int] = ByteCache(capacity_nbytes)
    for key, nbytes in requests:
        cache.get(key, lambda nbytes=nbytes: bytes(nbytes))  # type: ignore[misc]
        stats = cache.stats()
        assert stats["nbytes"] <= capacity_nbytes
        assert stats["entries"] * ENTRY_NBYTES <= stats["nbytes"]


def test_a_value_that_is_too_large_is_returned_and_displaces_nothing() -> None:
    cache: ByteCache[str] = ByteCache(ENTRY_NBYTES + 10)
    cache.get("small", lambda: bytes(10))
    assert cache.get("large", lambda: bytes(11)) == bytes(11)
    cache.get("small", fail)


def test_many_who_ask_at_once_get_one_making() -> None:
    cache: ByteCache[str] = ByteCache(10_000)
    made: Counter[str] = Counter()
    all_wait = threading.Event()

    def make() -> bytes:
        made["a"] += 1
        assert all_wait.wait(WAIT_SECONDS)
        return b"A"

    with ThreadPoolExecutor(8) as threads:
        answers = [threads.submit(cache.get, "a", make) for _ in range(8)]
        while cache.stats()["joined_total"] < 7:
            threading.Event().wait(0.001)
        assert cache.get("b", lambda: b"B") == b"B"  # nobody else waits meanwhile
        all_wait.set()
        assert [answer.result(WAIT_SECONDS) for answer in answers] == [b"A"] * 8
    assert made["a"] == 1


def test_an_error_reaches_all_who_wait_and_is_not_kept() -> None:
    cache: ByteCache[str] = ByteCache(10_000)
    one_waits = threading.Event()

    def make() -> bytes:
        assert one_waits.wait(WAIT_SECONDS)
        raise OSError("no such disk")

    with ThreadPoolExecutor(2) as threads:
        answers = [threads.submit(cache.get, "a", make) for _ in range(2)]
        while cache.stats()["joined_total"] < 1:
            threading.Event().wait(0.001)
        one_waits.set()
        for answer in answers:
            with pytest.raises(OSError, match="no such disk"):
                answer.result(WAIT_SECONDS)
    assert cache.get("a", lambda: b"A") == b"A"


def test_with_no_room_nothing_is_kept() -> None:
    cache: ByteCache[str] = ByteCache(0)
    assert cache.get("a", lambda: b"A") == b"A"
    assert cache.get("a", lambda: b"again") == b"again"
    assert cache.stats()["nbytes"] == 0


def test_clear_forgets_all() -> None:
    cache: ByteCache[str] = ByteCache(10_000)
    cache.get("a", lambda: b"A")
    cache.clear()
    assert cache.stats()["nbytes"] == 0
    assert cache.get("a", lambda: b"again") == b"again"
