"""One read of an array whose requests run at the same time: where one fails, all are given up.

zarr-python raises the first error and leaves the other requests to themselves; they would go on
asking a server that is lost, and asyncio complain of them when the program ends.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from zarr.core.sync import sync

_PAUSE_SECONDS = 0.01
_PAUSES = 100


class Reading:
    """The tasks of one read; requests run in the loop of zarr-python."""

    def __init__(self) -> None:
        self._tasks: set[asyncio.Task[object]] = set()
        self._is_given_up = False

    @contextmanager
    def requesting(self) -> Iterator[None]:
        """A request of the task that runs.

        Raises:
            asyncio.CancelledError: the read was given up.
        """
        task = asyncio.current_task()
        if self._is_given_up or task is None:
            raise asyncio.CancelledError
        self._tasks.add(task)
        try:
            yield
        finally:
            self._tasks.discard(task)

    def abandon(self) -> None:
        """End it from another thread than the one that waits for it."""
        sync(self.give_up())

    async def give_up(self) -> None:
        """End what is under way, and wait until it is, or for a second."""
        self._is_given_up = True
        for task in tuple(self._tasks):
            task.cancel()
        for _ in range(_PAUSES):
            if len(asyncio.all_tasks()) <= 1:
                return
            await asyncio.sleep(_PAUSE_SECONDS)


# The tasks of a call inherit it from the thread that calls.
_CURRENT: ContextVar[Reading | None] = ContextVar("octobrick_reading", default=None)


@contextmanager
def reading() -> Iterator[Reading]:
    """What zarr-python is asked in this block is one read."""
    current = Reading()
    token = _CURRENT.set(current)
    try:
        yield current
    except Exception:
        sync(current.give_up())
        raise
    finally:
        _CURRENT.reset(token)


@contextmanager
def requesting() -> Iterator[None]:
    """A request, of the read under way if there is one."""
    current = _CURRENT.get()
    if current is None:
        yield
        return
    with current.requesting():
        yield
