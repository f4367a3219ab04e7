"""The cache of decoded bricks: bounded, made once, and honest about failures."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from octobrick.codec.errors import CorruptBrickError
from octobrick.server.decoded_cache import DecodedCache


def test_it_never_holds_more_bytes_than_it_may_and_drops_the_oldest_use() -> None:
    cache = DecodedCache(10_000)
    for key in range(5):
        cache.get(key, lambda: bytes(4_000))
        cache.peek(0)
        assert cache.stats()["nbytes"] <= 10_000
    assert cache.peek(0) is not None
    assert cache.peek(3) is None
    assert cache.peek(4) is not None


@pytest.mark.parametrize("max_nbytes", [0, 1_000])
def test_what_does_not_fit_is_made_each_time_and_not_kept(max_nbytes: int) -> None:
    cache, made = DecodedCache(max_nbytes), []

    def make() -> bytes:
        made.append(1)
        return bytes(4_000)

    assert cache.get("a", make) == cache.get("a", make) == bytes(4_000)
    assert len(made) == 2
    assert cache.stats()["nbytes"] == 0


def test_several_at_once_wait_for_the_first() -> None:
    cache, made = DecodedCache(10_000), []
    begun, go_on = threading.Event(), threading.Event()

    def make() -> bytes:
        made.append(1)
        begun.set()
        assert go_on.wait(10)
        return b"content"

    with ThreadPoolExecutor(5) as pool:
        first = pool.submit(cache.get, "a", make)
        assert begun.wait(10)
        others = [pool.submit(cache.get, "a", make) for _ in range(4)]
        assert cache.peek("a") is None  # who must not wait is not kept
        go_on.set()
        assert {future.result() for future in (first, *others)} == {b"content"}
    assert len(made) == 1


def test_a_failure_is_everyones_and_not_kept() -> None:
    cache = DecodedCache(10_000)

    def fail() -> bytes:
        raise CorruptBrickError("checksum mismatch")

    with pytest.raises(CorruptBrickError):
        cache.get("a", fail)
    assert cache.get("a", lambda: b"mended") == b"mended"


def test_an_absent_brick_is_none_and_takes_no_room() -> None:
    cache = DecodedCache(10_000)
    assert cache.get("a", lambda: None) is None
    assert cache.stats()["entries"] == 0
