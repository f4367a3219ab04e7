"""Bricks without their zstd layer, for clients that do not take it: kept, and made once."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from concurrent.futures import Future

_ENTRY_NBYTES = 512  # what an entry takes beside its bytes: key, address, links


class DecodedCache:
    """Bytes by key, the least recently used dropped first. Safe to use from several threads.

    Several threads that ask for the same bytes at once wait for the first one, which makes them.

    Args:
        max_nbytes: of all that is kept; 0 keeps nothing.
    """

    def __init__(self, max_nbytes: int) -> None:
        self._max_nbytes = max_nbytes
        self._lock = threading.Lock()  # held for a few dictionary accesses, never while making
        self._kept: OrderedDict[Hashable, bytes] = OrderedDict()
        self._making: dict[Hashable, Future[bytes | None]] = {}
        self._nbytes = 0
        self._hits = 0
        self._misses = 0

    def get(self, key: Hashable, make: Callable[[], bytes | None]) -> bytes | None:
        """The bytes of a key, made where they are not kept; None, and not kept, if that is made.

        Raises:
            Exception: what ``make`` raises, to all who wait for it; the next one tries again.
        """
        with self._lock:
            if (content := self._found(key)) is not None:
                return content
            making = self._making.get(key)
            if making is not None:
                self._hits += 1
            else:
                mine = self._making[key] = Future()
                self._misses += 1
        if making is not None:
            return making.result()
        return self._made(key, make, mine)

    def peek(self, key: Hashable) -> bytes | None:
        """The bytes of a key if they are kept; never waits for them to be made."""
        with self._lock:
            return self._found(key)

    def stats(self) -> dict[str, float]:
        """Counts since the start, and what is kept now."""
        with self._lock:
            return {
                "hits": self._hits,
                "misses": self._misses,
                "entries": len(self._kept),
                "nbytes": self._nbytes,
            }

    def _found(self, key: Hashable) -> bytes | None:
        content = self._kept.get(key)
        if content is not None:
            self._kept.move_to_end(key)
            self._hits += 1
        return content

    def _made(
        self, key: Hashable, make: Callable[[], bytes | None], mine: Future[bytes | None]
    ) -> bytes | None:
        try:
            content = make()
        except BaseException as error:
            with self._lock:
                del self._making[key]
            mine.set_exception(error)
            raise
        with self._lock:
            del self._making[key]
            if content is not None:
                self._keep(key, content)
        mine.set_result(content)
        return content

    def _keep(self, key: Hashable, content: bytes) -> None:
        nbytes = len(content) + _ENTRY_NBYTES
        if nbytes > self._max_nbytes:
            return
        self._kept[key] = content
        self._nbytes += nbytes
        while self._nbytes > self._max_nbytes:
            _, dropped = self._kept.popitem(last=False)
            self._nbytes -= len(dropped) + _ENTRY_NBYTES
