"""Reads bricks in the background, most urgent first. No GL: any thread may use it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Final, Literal, Self

from octobrick.codec.errors import InvalidInputError
from octobrick.renderer.brick_request import BrickAddress, BrickRequest
from octobrick.renderer.load_batch import BATCH_MAX, LoadBatch, comes_in_batches
from octobrick.renderer.load_queue import LoadQueue, Outcome

CLOSE_SECONDS: Final = 10.0
"""How long `close` waits for reads under way; a source that hangs must not hang its renderer."""


class Pending(Enum):
    """The type of `PENDING`."""

    PENDING = "pending"


PENDING: Final = Pending.PENDING
"""Stands for a brick that has not been read yet."""


@dataclass(frozen=True, slots=True)
class LoadStats:
    """What a loader has done since it was made.

    Attributes:
        read_nbytes: bytes of bricks, of those read by waiting callers too.
        cancelled: wishes that were not begun before the view changed.
        prefetch_hits: bricks taken that had been read ahead.
    """

    read_nbytes: int
    cancelled: int
    prefetch_hits: int


class BrickLoader:
    """Threads that read what views want, and keep it until it is taken.

    Close it, or use it in a with statement. All methods may be called from any thread.

    Args:
        threads: how many read at once.
        budget_nbytes: for bricks that were read and not taken; nothing is read beyond, but for
            callers that wait.
    """

    def __init__(self, threads: int = 4, budget_nbytes: int = 64 << 20) -> None:
        if threads < 1 or budget_nbytes < 1:
            raise InvalidInputError(
                f"threads is {threads} and budget_nbytes {budget_nbytes}; give at least 1 of each"
            )
        self._queue = LoadQueue(budget_nbytes)
        self._changed = threading.Condition()
        self._closed = False
        self._batches: list[LoadBatch] = []  # one of a source at most
        self._read_nbytes = 0
        self._threads = [
            threading.Thread(target=self._work, name=f"octobrick-loader-{i}", daemon=True)
            for i in range(threads)
        ]
        for thread in self._threads:
            thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def want(self, requests: Iterable[BrickRequest], *, keep: bool = False) -> None:
        """A new view's bricks, most urgent first. What earlier views wanted is not begun any more.

        What is under way is finished, and kept if it fits.

        Args:
            keep: these are of the same view, and come behind those that it wants already.
        """
        wishes = list(requests)
        with self._changed:
            self._queue.want(wishes, keep=keep)
            self._close_batches(wishes, self._queue.is_wanted)
            self._changed.notify_all()

    def urge(self, requests: Iterable[BrickRequest]) -> None:
        """Put bricks of the present view before all others."""
        wishes = list(requests)
        urged = {request.address for request in wishes}
        with self._changed:
            self._queue.urge(wishes)
            self._close_batches(wishes, urged.__contains__)
            self._changed.notify_all()

    def prefetch(self, requests: Iterable[BrickRequest]) -> None:
        """Bricks that views to come may want, read when nothing wanted is left."""
        with self._changed:
            self._queue.prefetch(requests)
            self._changed.notify_all()

    def take(
        self, request: BrickRequest, *, wait: bool = True
    ) -> bytes | Literal[Pending.PENDING] | None:
        """A brick, no longer kept here; None where it is absent, `PENDING` where it is not read.

        Args:
            request: need not have been wanted.
            wait: what is not under way yet is read at once, by the calling thread.

        Raises:
            InvalidInputError: the loader is closed.
            Exception: what the source raised.
        """
        address = request.address
        with self._changed:
            self._require_open()
            outcome = self._queue.take(address)
            if outcome is None and not wait:
                return PENDING
            if outcome is None:
                outcome = self._wait_for(address)
            if outcome is None:
                self._queue.take_over(address)
            self._changed.notify_all()
        return outcome.result() if outcome is not None else self._read_here(request)

    def take_waiting(self, request: BrickRequest) -> bytes | None:
        """A brick, waited for; None where it is absent.

        Raises:
            InvalidInputError: the loader is closed.
            Exception: what the source raised.
        """
        code = self.take(request)
        assert code is not PENDING
        return code

    def wait_for_arrivals(self, timeout_seconds: float) -> None:
        """Return when something was read, when there is nothing to read, or when time is over."""
        with self._changed:
            read_nbytes = self._read_nbytes
            self._changed.wait_for(
                lambda: self._closed or self._queue.idle or self._read_nbytes > read_nbytes,
                timeout_seconds,
            )

    @property
    def stats(self) -> LoadStats:
        """Counts so far."""
        with self._changed:
            queue = self._queue
            return LoadStats(self._read_nbytes, queue.ncancelled, queue.nhits_ahead)

    @property
    def held_nbytes(self) -> int:
        """Memory of what was read and not taken."""
        with self._changed:
            return self._queue.nbytes

    def close(self, timeout_seconds: float = CLOSE_SECONDS) -> None:
        """Forget all wishes and end the threads, which wait for the reads under way. Idempotent.

        A read that takes longer than the timeout ends its thread when it ends; nobody sees it.
        """
        with self._changed:
            self._closed = True
            self._queue.clear()
            for batch in self._batches:
                batch.close()
            self._changed.notify_all()
        deadline = time.monotonic() + timeout_seconds
        for thread in self._threads:
            if thread is not threading.current_thread():
                thread.join(max(0.0, deadline - time.monotonic()))

    def _require_open(self) -> None:
        if self._closed:
            raise InvalidInputError("this loader is closed; make a new one")

    def _wait_for(self, address: BrickAddress) -> Outcome | None:
        """What another thread reads; None where none does. To be called with the lock."""
        self._queue.begin_waiting(address)
        try:
            while self._queue.is_under_way(address):
                self._changed.wait()
                self._require_open()
                outcome = self._queue.take(address)
                if outcome is not None:
                    return outcome
            return None
        finally:
            self._queue.end_waiting(address)

    def _read_here(self, request: BrickRequest) -> bytes | None:
        code = None
        try:
            code = request.read()
        finally:
            with self._changed:
                self._queue.end_take_over(request.address)
                self._read_nbytes += len(code or b"")
                self._changed.notify_all()
        return code

    def _close_batches(
        self, wishes: Iterable[BrickRequest], useful: Callable[[BrickAddress], bool]
    ) -> None:
        """End what stands in the way of new wishes; to be called with the lock.

        A batch does where they have to wait for it, and most of what it still brings is not what
        they ask for. What is wanted of it is asked for again, behind them.
        """
        waiting = [r for r in wishes if self._queue.is_unread(r.address)]
        for batch in self._batches:
            if any(r.source is batch.source for r in waiting):
                nuseful = sum(map(useful, batch.left))
                if 2 * nuseful < len(batch.left):
                    batch.close()

    def _work(self) -> None:
        while (work := self._next()) is not None:
            if isinstance(work, LoadBatch):
                self._read_batch(work)
            else:
                self._read_one(work)
            del work  # what is not kept is not kept by an idle thread

    def _read_one(self, request: BrickRequest) -> None:
        try:
            outcome = Outcome(request.read())
        except Exception as error:  # whatever a source raises, its taker gets
            outcome = Outcome(error=error)
        self._end(request, outcome)

    def _end(self, request: BrickRequest, outcome: Outcome) -> None:
        with self._changed:
            self._read_nbytes += len(outcome.code or b"")
            if not self._closed:
                self._queue.end(request.address, outcome)
            self._changed.notify_all()

    def _read_batch(self, work: LoadBatch) -> None:
        failure: Exception | None = None
        try:
            batch = work.begin()
            if work.closed:  # meanwhile
                batch.close()
            for request, outcome in work.outcomes(batch):
                with self._changed:
                    del work.left[request.address]
                self._end(request, outcome)
            failure = InvalidInputError(
                "the source of a batch gave fewer bricks than were asked for"
            )
        except Exception as error:  # whatever a source raises, its takers get
            failure = error
        with self._changed:
            self._batches.remove(work)
            if not self._closed:
                if work.closed:
                    self._queue.give_back(work.left.values())
                else:
                    for address in work.left:
                        self._queue.end(address, Outcome(error=failure))
            self._changed.notify_all()

    def _next(self) -> BrickRequest | LoadBatch | None:
        """The next to read, when there is one; None when the loader is closed."""
        with self._changed:
            while not self._closed:
                request = self._queue.begin(self._is_free)
                if request is not None:
                    return self._batch_of(request) if comes_in_batches(request) else request
                self._changed.wait()
            return None

    def _is_free(self, request: BrickRequest) -> bool:
        """Whether no batch of its source is under way, behind which it has to wait."""
        return not any(batch.source is request.source for batch in self._batches)

    def _batch_of(self, request: BrickRequest) -> LoadBatch:
        def alike(other: BrickRequest) -> bool:
            return other.source is request.source and other.address.kind == request.address.kind

        batch = LoadBatch(request.source, self._queue.begin_like(request, BATCH_MAX, alike))
        self._batches.append(batch)
        return batch
