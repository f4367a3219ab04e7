"""A cache that is bounded in bytes and makes each value once, however many ask for it at once."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from concurrent.futures import Future
from typing import Generic, TypeVar

K = TypeVar("K", bound=Hashable)

# What an entry takes beside its value, about: key, node and bytes object. Without it, nothing
# would bound the number of empty values.
ENTRY_NBYTES = 512


class ByteCache(Generic[K]):
    """Keeps the values that were used last, up to a number of bytes. Safe to use from any thread.

    A value is ``bytes``, or None for the knowledge that there is nothing. An error is not kept:
    those who wait for the value get it, and the next one to ask makes the value again.

    Args:
        capacity_nbytes: bound of all values together, `ENTRY_NBYTES` more for each. A value that
            is larger is made and returned, but not kept; with 0 nothing is.
    """

    def __init__(self, capacity_nbytes: int) -> None:
        self._capacity_nbytes = capacity_nbytes
        self._lock = threading.Lock()  # guards all below; not held while a value is made
        self._values: OrderedDict[K, bytes | None] = OrderedDict()
        self._making: dict[K, Future[bytes | None]] = {}
        self._nbytes = 0
        self._hits = self._misses = self._joined = self._evictions = 0

    def get(self, key: K, make: Callable[[], bytes | None]) -> bytes | None:
        """The value of a key: the one that is kept, or what ``make`` gives.

        Where another thread makes it already, this one waits for that. So ``make`` must not ask
        for the same key.

        Raises:
            Exception: what ``make`` raises, here or in the thread that made the value.
        """
        with self._lock:
            if key in self._values:
                self._hits += 1
                self._values.move_to_end(key)
                return self._values[key]
            waiting = self._making.get(key)
            if waiting is None:
                self._misses += 1
                made = self._making[key] = Future()
            else:
                self._joined += 1
        return self._make(key, make, made) if waiting is None else waiting.result()

    def peek(self, key: K) -> bytes | None:
        """The value of a key if it is kept; never waits for one that is being made."""
        with self._lock:
            value = self._values.get(key)
            if value is not None:
                self._hits += 1
                self._values.move_to_end(key)
            return value

    def stats(self) -> dict[str, float]:
        """Bytes and entries now; hits, misses, joined (waited for another) and evictions so far."""
        with self._lock:
            return {
                "nbytes": self._nbytes,
                "entries": len(self._values),
                "hits_total": self._hits,
                "misses_total": self._misses,
                "joined_total": self._joined,
                "evictions_total": self._evictions,
            }

    def clear(self) -> None:
        """Forget all values."""
        with self._lock:
            self._values.clear()
            self._nbytes = 0

    def _make(
        self, key: K, make: Callable[[], bytes | None], made: Future[bytes | None]
    ) -> bytes | None:
        try:
            value = make()
        except BaseException as error:
            with self._lock:
                del self._making[key]
            made.set_exception(error)
            raise
        with self._lock:
            del self._making[key]
            self._keep(key, value)
        made.set_result(value)
        return value

    def _keep(self, key: K, value: bytes | None) -> None:
        nbytes = _cost(value)
        if nbytes > self._capacity_nbytes:
            return
        self._values[key] = value
        self._nbytes += nbytes
        while self._nbytes > self._capacity_nbytes:
            _, oldest = self._values.popitem(last=False)
            self._nbytes -= _cost(oldest)
            self._evictions += 1


def _cost(value: bytes | None) -> int:
    return ENTRY_NBYTES + (len(value) if value else 0)
