"""Work done by many threads, its results in the order in which it was given."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future
from typing import TypeVar

_T = TypeVar("_T")


def in_order(executor: Executor, calls: Iterable[Callable[[], _T]], nahead: int) -> Iterator[_T]:
    """The results of calls, made by an executor, in their order.

    Unlike ``Executor.map`` it draws calls only as far ahead as is said, so what they hold on to,
    and the results that wait, are bounded. When a call fails, those behind it are cancelled.

    Args:
        executor: makes the calls.
        calls: drawn by the thread that takes the results.
        nahead: at most so many have been drawn and not been taken.
    """
    pending: deque[Future[_T]] = deque()
    try:
        for call in calls:
            pending.append(executor.submit(call))
            if len(pending) > nahead:
                yield pending.popleft().result()
        while pending:
            yield pending.popleft().result()
    finally:
        for future in pending:
            future.cancel()
