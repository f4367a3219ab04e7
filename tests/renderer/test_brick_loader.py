"""Bricks are read in the order of their urgency, in bounded memory, and nobody waits for ever."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from octobrick.codec.errors import CorruptBrickError, InvalidInputError, ResourceError
from octobrick.renderer.brick_loader import PENDING, BrickLoader
from octobrick.renderer.brick_request import BrickAddress, BrickRequest
from octobrick.renderer.load_queue import ENTRY_NBYTES, LoadQueue, Outcome
from octobrick.store.box import Zyx

TIMEOUT_SECONDS = 30.0
"""Of events that always come: a test that waits so long has failed."""


class FakeSource:
    """Bricks of ten bytes, noted as they are read; brick 0 is held back until it is released."""

    def __init__(self) -> None:
        self.release, self.begun = threading.Event(), threading.Event()
        self.reads: list[int] = []
        self.broken: set[int] = set()

    def brick_code(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> bytes | None:
        number = zyx[2]
        self.reads.append(number)
        if number == 0:
            self.begun.set()
            assert self.release.wait(TIMEOUT_SECONDS)
        if number in self.broken:
            raise CorruptBrickError(f"brick {number} is damaged")
        return None if number == 99 else bytes([number] * 10)

    def request(self, number: int) -> BrickRequest:
        return BrickRequest(BrickAddress("r", "voxels", 0, 0, 0, (0, 0, number)), self)

    def requests(self, *numbers: int) -> list[BrickRequest]:
        return [self.request(n) for n in numbers]


def held_back(loader: BrickLoader, source: FakeSource) -> None:
    """Occupy the loader's only thread with brick 0."""
    loader.want(source.requests(0))
    assert source.begun.wait(TIMEOUT_SECONDS)


def wait_until(loader: BrickLoader, condition: Callable[[], bool]) -> None:
    with loader._changed:
        assert loader._changed.wait_for(condition, TIMEOUT_SECONDS)


@pytest.fixture
def source() -> FakeSource:
    return FakeSource()


def test_a_new_view_cancels_what_is_not_begun_and_the_most_urgent_come_first(
    source: FakeSource,
) -> None:
    with BrickLoader(threads=1) as loader:
        held_back(loader, source)
        loader.want(source.requests(1, 2, 3))
        loader.prefetch(source.requests(7, 6))
        loader.want(source.requests(5, 3))
        loader.want(source.requests(8, 5), keep=True)
        loader.urge(source.requests(4, 3))
        source.release.set()
        wait_until(loader, lambda: len(source.reads) == 7 and loader._queue.nbytes == 7 * 138)
        assert source.reads == [0, 4, 3, 5, 8, 7, 6]
        assert loader.stats.cancelled == 2
        assert loader.take(source.request(6), wait=False) == bytes([6] * 10)
        assert loader.take(source.request(4), wait=False) == bytes([4] * 10)
        assert loader.stats.prefetch_hits == 1
        assert loader.stats.read_nbytes == 70


def test_what_is_under_way_when_the_view_changes_is_kept(source: FakeSource) -> None:
    with BrickLoader(threads=1) as loader:
        held_back(loader, source)
        loader.want(source.requests(1))
        source.release.set()
        assert loader.take(source.request(1)) == bytes([1] * 10)
        assert loader.take(source.request(0)) == bytes(10)
        assert source.reads.count(0) == 1


def test_taking_without_waiting_says_that_it_is_pending(source: FakeSource) -> None:
    with BrickLoader(threads=1) as loader:
        held_back(loader, source)
        assert loader.take(source.request(0), wait=False) is PENDING
        assert loader.take(source.request(1), wait=False) is PENDING
        source.release.set()


def test_a_waiting_taker_reads_by_itself_what_no_thread_has_begun(source: FakeSource) -> None:
    with BrickLoader(threads=1) as loader:
        held_back(loader, source)
        loader.want(source.requests(1, 99))
        assert loader.take(source.request(1)) == bytes([1] * 10)
        assert loader.take(source.request(99)) is None
        assert loader.take(source.request(5)) == bytes([5] * 10)
        source.release.set()
        assert loader.take(source.request(0)) == bytes(10)
        assert source.reads == [0, 1, 99, 5]


def test_an_error_reaches_its_taker_and_nobody_else(source: FakeSource) -> None:
    source.release.set()
    source.broken = {0, 2}
    with BrickLoader(threads=1) as loader:
        loader.want(source.requests(0, 1, 2))
        for number in (0, 2):
            with pytest.raises(CorruptBrickError, match=f"brick {number} is damaged"):
                loader.take(source.request(number))
        assert loader.take(source.request(1)) == bytes([1] * 10)
        source.broken.clear()
        assert loader.take(source.request(2)) == bytes([2] * 10)


def test_memory_is_bounded_and_a_full_loader_serves_who_waits(source: FakeSource) -> None:
    source.release.set()
    entry = ENTRY_NBYTES + 10
    with BrickLoader(threads=1, budget_nbytes=3 * entry) as loader:
        loader.want(source.requests(*range(10)))
        wait_until(loader, lambda: loader._queue.nbytes == 3 * entry)
        assert loader.take(source.request(9)) == bytes([9] * 10)
        for number in range(9):
            assert loader.take(source.request(number)) == bytes([number] * 10)
            assert loader.held_nbytes <= 3 * entry
        assert sorted(source.reads) == list(range(10))


def test_a_budget_below_one_brick_reads_nothing_ahead_for_long_and_gives_all(
    source: FakeSource,
) -> None:
    source.release.set()
    with BrickLoader(threads=2, budget_nbytes=ENTRY_NBYTES) as loader:
        loader.want(source.requests(*range(5)))
        assert [loader.take(source.request(n)) for n in range(5)] == [
            bytes([n] * 10) for n in range(5)
        ]
        assert loader.held_nbytes == 0


def test_many_takers_of_one_brick_all_get_it(source: FakeSource) -> None:
    taken: list[object] = []
    with BrickLoader(threads=1) as loader:
        held_back(loader, source)
        takers = [
            threading.Thread(target=lambda: taken.append(loader.take(source.request(0))))
            for _ in range(4)
        ]
        for taker in takers:
            taker.start()
        source.release.set()
        for taker in takers:
            taker.join(TIMEOUT_SECONDS)
    assert taken == [bytes(10)] * 4


def test_closing_ends_the_threads_drops_wishes_and_wakes_who_waits(source: FakeSource) -> None:
    loader = BrickLoader(threads=2)
    held_back(loader, source)
    failures: list[Exception] = []

    def take() -> None:
        try:
            loader.take(source.request(0))
        except InvalidInputError as error:
            failures.append(error)

    taker = threading.Thread(target=take)
    taker.start()
    wait_until(loader, lambda: bool(loader._queue._awaited))
    loader.close(timeout_seconds=0)  # while a source hangs
    taker.join(TIMEOUT_SECONDS)
    assert len(failures) == 1
    source.release.set()
    loader.close()
    assert not any(thread.is_alive() for thread in loader._threads)
    assert loader.held_nbytes == 0
    loader.close()
    with pytest.raises(InvalidInputError, match="closed"):
        loader.take(source.request(1))


class BatchingSource(FakeSource):
    """Gives many at once; a batch stops before brick 0 until it is released or closed."""

    def __init__(self) -> None:
        super().__init__()
        self.batches: list[list[int]] = []
        self.closed: list[list[int]] = []

    def brick_codes(self, places: Sequence[tuple[int, Zyx, int, int]]) -> FakeBatch:
        self.batches.append([zyx[2] for _, zyx, _, _ in places])
        return FakeBatch(self, self.batches[-1])


class FakeBatch:
    def __init__(self, source: BatchingSource, numbers: list[int]) -> None:
        self.source, self.numbers, self.stopped = source, numbers, threading.Event()

    def close(self) -> None:
        self.source.closed.append(self.numbers)
        self.stopped.set()

    def __iter__(self) -> Iterator[tuple[int, bytes | Exception | None]]:
        for place, number in enumerate(self.numbers):
            if number == 0:
                self.source.begun.set()
                while not (self.source.release.is_set() or self.stopped.wait(0.001)):
                    pass
            if self.stopped.is_set():
                return
            if number == 66:
                raise ResourceError("the line is down")
            broken = number in self.source.broken
            yield place, CorruptBrickError(f"brick {number}") if broken else bytes([number] * 10)


def test_a_source_of_batches_is_asked_once_for_all_and_in_order() -> None:
    source, other = BatchingSource(), BatchingSource()
    source.release.set()
    mixed = [*source.requests(3, 1, 2), *other.requests(9), *source.requests(4)]
    mixed[3] = BrickRequest(BrickAddress("other", "voxels", 0, 0, 0, (0, 0, 9)), other)
    with BrickLoader(threads=3) as loader:
        loader.want(mixed)
        wait_until(loader, lambda: loader._queue.nbytes == 5 * 138)
        assert loader.take(mixed[0], wait=False) == bytes([3] * 10)
    assert source.batches == [[3, 1, 2, 4]]
    assert other.batches == [[9]]
    assert source.reads == []


def test_a_new_view_ends_a_batch_that_it_does_not_want_and_asks_for_its_own() -> None:
    source = BatchingSource()
    with BrickLoader(threads=2) as loader:
        loader.want(source.requests(5, 0, 1, 2, 3))
        assert source.begun.wait(TIMEOUT_SECONDS)
        loader.want(source.requests(7, 3))
        wait_until(loader, lambda: loader._queue.nbytes == 3 * 138)
        assert loader.take(source.request(7), wait=False) == bytes([7] * 10)
        assert loader.stats.cancelled == 3
    assert source.batches == [[5, 0, 1, 2, 3], [7, 3]] or source.batches[1:] == [[3, 7]]
    assert source.closed[0] == [5, 0, 1, 2, 3]


def test_a_batch_that_the_next_view_wants_too_goes_on() -> None:
    source = BatchingSource()
    with BrickLoader(threads=2) as loader:
        loader.want(source.requests(5, 0, 1, 2))
        assert source.begun.wait(TIMEOUT_SECONDS)
        loader.want(())
        loader.want(source.requests(0, 1, 2, 8), keep=True)
        source.release.set()
        wait_until(loader, lambda: loader._queue.nbytes == 5 * 138)
    assert source.batches == [[5, 0, 1, 2], [8]]


def test_urgent_bricks_do_not_wait_for_a_batch_read_ahead() -> None:
    source = BatchingSource()
    with BrickLoader(threads=2) as loader:
        loader.prefetch(source.requests(0, 1))
        assert source.begun.wait(TIMEOUT_SECONDS)
        loader.urge(source.requests(4, 6))
        wait_until(loader, lambda: loader._queue.nbytes == 2 * 138)
        source.release.set()
        wait_until(loader, lambda: loader._queue.nbytes == 4 * 138)
    assert source.batches == [[0, 1], [4, 6], [0, 1]]


def test_errors_of_one_brick_and_of_the_whole_batch_reach_their_takers() -> None:
    source = BatchingSource()
    source.broken = {2}
    source.release.set()
    with BrickLoader(threads=1) as loader:
        loader.want(source.requests(1, 2, 3, 66, 5))
        wait_until(loader, lambda: loader._queue.idle)
        assert loader.take(source.request(3)) == bytes([3] * 10)
        with pytest.raises(CorruptBrickError, match="brick 2"):
            loader.take(source.request(2))
        with pytest.raises(ResourceError, match="down"):
            loader.take(source.request(5))


def test_closing_ends_a_batch_that_hangs() -> None:
    source = BatchingSource()
    loader = BrickLoader(threads=2)
    loader.want(source.requests(1, 0, 2))
    assert source.begun.wait(TIMEOUT_SECONDS)
    loader.close()
    assert not any(thread.is_alive() for thread in loader._threads)


numbers = st.lists(st.integers(0, 7), max_size=6, unique=True)


class QueueMachine(RuleBasedStateMachine):
    """Any sequence of wishes, reads and takes keeps the queue's promises."""

    def __init__(self) -> None:
        super().__init__()
        self.budget = 3 * (ENTRY_NBYTES + 40)
        self.queue = LoadQueue(self.budget)
        self.source = FakeSource()
        self.reading: list[BrickRequest] = []
        self.wanted: list[int] = []

    @rule(wishes=numbers)
    def want(self, wishes: list[int]) -> None:
        self.queue.want(self.source.requests(*wishes))
        self.wanted = wishes

    @rule(wishes=numbers)
    def want_more(self, wishes: list[int]) -> None:
        self.queue.want(self.source.requests(*wishes), keep=True)
        self.wanted += [n for n in wishes if n not in self.wanted]

    @rule(wishes=numbers)
    def urge(self, wishes: list[int]) -> None:
        self.queue.urge(self.source.requests(*wishes))
        self.wanted = wishes + [n for n in self.wanted if n not in wishes]

    @rule(wishes=numbers)
    def prefetch(self, wishes: list[int]) -> None:
        self.queue.prefetch(self.source.requests(*wishes))

    @rule()
    def begin(self) -> None:
        request = self.queue.begin()
        if request is None:
            return
        number = request.address.zyx[2]
        under_way = [r.address.zyx[2] for r in self.reading]
        assert number not in under_way
        left = [n for n in self.wanted if n not in under_way and not self.is_here(n)]
        assert number == left[0] if left else True
        self.reading.append(request)

    @rule(count=st.integers(1, 4))
    def begin_many(self, count: int) -> None:
        first = self.queue.begin()
        if first is not None:
            begun = self.queue.begin_like(first, count, lambda _: True)
            assert begun[0] is first
            assert len(begun) <= count
            self.reading += begun

    @rule()
    def give_back(self) -> None:
        self.queue.give_back(self.reading)
        given = [r.address.zyx[2] for r in self.reading if self.queue.is_wanted(r.address)]
        self.reading = []
        here = [r.address.zyx[2] for r in self.queue._wanted.values()]
        assert set(given) <= set(here)
        self.wanted = here

    @rule(nbytes=st.sampled_from([0, 10, 40, 10_000]), which=st.integers(0, 7))
    def end(self, nbytes: int, which: int) -> None:
        if self.reading:
            request = self.reading.pop(which % len(self.reading))
            self.queue.end(request.address, Outcome(bytes(nbytes)))

    @rule(number=st.integers(0, 7))
    def take(self, number: int) -> None:
        was_here = self.is_here(number)
        assert (self.queue.take(self.source.request(number).address) is not None) == was_here
        if was_here and number in self.wanted:
            self.wanted.remove(number)

    def is_here(self, number: int) -> bool:
        return self.source.request(number).address in self.queue._ready

    @invariant()
    def memory_is_bounded_and_counted(self) -> None:
        ready = self.queue._ready.values()
        assert self.queue.nbytes == sum(r.outcome.nbytes for r in ready)
        assert self.queue.nbytes <= self.budget

    @invariant()
    def nothing_is_at_hand_and_wished_for(self) -> None:
        wished = self.queue._wanted.keys() | self.queue._ahead.keys()
        assert not wished & self.queue._ready.keys()
        assert not wished & self.queue._under_way.keys()
        assert not self.queue._wanted.keys() & self.queue._ahead.keys()


QueueMachine.TestCase.settings = settings(max_examples=60, stateful_step_count=30, deadline=None)
TestQueue = QueueMachine.TestCase
