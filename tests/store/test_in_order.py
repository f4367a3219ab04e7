"""Work done by many threads, its results in order."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import pytest

from octobrick.store.in_order import in_order


def test_results_come_in_the_order_of_the_calls() -> None:
    def slow(i: int) -> int:
        time.sleep(0.002 * (5 - i % 5))
        return i

    with ThreadPoolExecutor(4) as executor:
        assert list(in_order(executor, [partial(slow, i) for i in range(40)], 7)) == list(range(40))
        assert list(in_order(executor, [], 7)) == []


def test_no_more_calls_are_drawn_than_was_said() -> None:
    drawn = 0

    def calls() -> Iterator[Callable[[], None]]:
        nonlocal drawn
        for _ in range(30):
            drawn += 1
            yield lambda: None

    with ThreadPoolExecutor(2) as executor:
        for taken, _ in enumerate(in_order(executor, calls(), 3), start=1):
            assert drawn <= taken + 3


def test_a_call_that_fails_cancels_those_behind_it() -> None:
    released = threading.Event()
    ran: list[int] = []

    def fail() -> None:
        raise ValueError("no")

    def wait(i: int) -> None:
        released.wait()
        ran.append(i)

    with ThreadPoolExecutor(1) as executor:
        with pytest.raises(ValueError, match="no"):
            list(in_order(executor, [fail, *(partial(wait, i) for i in range(5))], 9))
        released.set()
    assert ran in ([], [0])  # the first may have begun before the failure was seen
