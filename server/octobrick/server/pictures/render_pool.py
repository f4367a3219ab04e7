"""The pool that renders: workers, a fair queue before them, and what becomes of broken ones."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import Final

from octobrick.codec.errors import OctobrickError, ResourceError
from octobrick.server.errors import BusyError, RenderCrashedError, RenderingOffError
from octobrick.server.errors import RenderTimeoutError as TimedOutError
from octobrick.server.pictures.fair_queue import FairQueue
from octobrick.server.pictures.render_job import Event, RenderJob
from octobrick.server.pictures.render_task import RenderTask
from octobrick.server.pictures.worker_process import RenderWorker, WorkerLostError

logger = logging.getLogger(__name__)

BACKOFF_SECONDS: Final = 0.5
"""Pause before a third worker in a row is started; it doubles with each that is lost."""
BACKOFF_MAX_SECONDS: Final = 30.0
KILL_SECONDS: Final = 5.0
"""How long threads may take to end once their workers are killed."""


class RenderPool:
    """Gives jobs to workers, one to each at a time. Safe to use from any thread.

    A worker is started when a job needs it and kept for the next ones. One that dies, hangs or
    takes too much costs the picture that it was making, and a fresh one takes its place; where one
    after the other is lost, pauses between them grow and the queue waits.

    Args:
        make_worker: starts a worker, in the thread that will use it.
        nworkers: that run at once; 0 renders nothing.
        queue_length: jobs that may wait besides those that run.
        queue_per_client: of these, of one client.
        limit_seconds: a worker that is at one job for longer is killed.
    """

    def __init__(
        self,
        make_worker: Callable[[], RenderWorker],
        *,
        nworkers: int,
        queue_length: int,
        queue_per_client: int,
        limit_seconds: float,
    ) -> None:
        self._make_worker = make_worker
        self._limit_seconds = limit_seconds
        self._changed = threading.Condition()  # guards all that follows
        self._queue = FairQueue(queue_length, queue_per_client)
        self._running: set[RenderJob] = set()
        self._memory: dict[str, dict[str, int]] = {}
        self._counts = dict.fromkeys(_COUNTS, 0.0)
        self._closing = False
        self._threads = [
            threading.Thread(target=self._supervise, name=f"octobrick-render-{i}", daemon=True)
            for i in range(nworkers)
        ]

    def start(self) -> None:
        """Start the threads; workers are started when they are needed."""
        for thread in self._threads:
            thread.start()

    def submit(self, task: RenderTask, client: str, deliver: Callable[[Event], None]) -> RenderJob:
        """Queue a picture.

        Args:
            task: what to render.
            client: who asks; clients take turns.
            deliver: takes its parts and then an error or None, from another thread; not called
                any more once the job was stopped.

        Raises:
            BusyError: all places are taken, or the pool is closing.
            RenderingOffError: there are no workers.
        """
        if not self._threads:
            raise RenderingOffError(
                "This server renders no pictures; ask one that does, or take bricks",
                setting="render_workers",
            )
        job = RenderJob(task, client, deliver)
        with self._changed:
            if self._closing:
                raise BusyError("The server is shutting down")
            try:
                self._queue.put(job)
            except BusyError:
                self._counts["refused"] += 1
                raise
            self._changed.notify_all()  # one alone may be that of a worker in its pause
        return job

    def stop(self, job: RenderJob) -> None:
        """Nobody waits for a job any more: it is not begun, or stopped where that can be."""
        with self._changed:
            job.stopped = True
            if self._queue.remove(job) or job in self._running:
                self._counts["stopped"] += 1

    def stats(self) -> dict[str, float]:
        """Counts since the start, and what is now: for metrics.

        "waiting" and "running" are jobs; "bricks_nbytes" and "slab_nbytes" what renderers hold.
        With "_total" behind them: "rendered", "failed" (with an error that names its reason),
        "crashed", "timed_out", "stopped" and "refused" jobs, and their "render_seconds".
        """
        with self._changed:
            memory = {
                f"{name}_nbytes": float(sum(one.get(name, 0) for one in self._memory.values()))
                for name in ("bricks", "slab")
            }
            now = {"waiting": float(len(self._queue)), "running": float(len(self._running))}
            return now | {f"{name}_total": n for name, n in self._counts.items()} | memory

    def close(self, timeout_seconds: float) -> None:
        """Refuse new jobs, fail those that wait, let those that run end, and end the workers.

        What is still running after the timeout, or is running for nobody, is killed.
        """
        with self._changed:
            self._closing = True
            while (job := self._queue.take()) is not None:
                job.give(BusyError("The server is shutting down"))
            for job in self._running:
                job.abandoned = job.stopped
            self._changed.notify_all()
        self._join(time.monotonic() + timeout_seconds)
        with self._changed:
            for job in self._running:
                job.abandoned = True
        self._join(time.monotonic() + KILL_SECONDS)
        if any(thread.is_alive() for thread in self._threads):
            logger.warning("a picture was still being rendered when the server stopped")

    def _join(self, deadline: float) -> None:
        for thread in self._threads:
            if thread.ident is not None:
                thread.join(max(0.0, deadline - time.monotonic()))

    def _supervise(self) -> None:
        """Run jobs with one worker after the other, until the pool closes."""
        worker: RenderWorker | None = None
        nlost = 0
        while (job := self._take(_pause_seconds(nlost))) is not None:
            if worker is not None and not worker.is_usable():
                logger.warning("a render worker ended, or grew too large, between two pictures")
                self._forget(worker)
                worker = None
            try:
                worker = worker or self._make_worker()
                worker.run(job, self._limit_seconds)
                nlost = 0
            except WorkerLostError as lost:
                nlost += 1
                self._count(lost.error)
                logger.error("render worker lost: %s", lost.error.message)
                assert worker is not None
                self._forget(worker)
                worker = None
                job.give(lost.error)
            except Exception as error:  # it could not be started
                nlost += 1
                job.give(_not_started(error))
            self._finish(job, worker)
            del job  # or its last picture stays in memory until the next one
        if worker is not None:
            self._forget(worker)

    def _take(self, pause_seconds: float) -> RenderJob | None:
        """The next job, after a pause; None where the pool closes."""
        not_before = time.monotonic() + pause_seconds
        with self._changed:
            while not self._closing:
                left = not_before - time.monotonic()
                job = self._queue.take() if left <= 0 else None
                if job is not None:
                    job.started = time.monotonic()
                    job.deliver = self._counted(job.deliver)
                    self._running.add(job)
                    return job
                self._changed.wait(left if left > 0 else None)
        return None

    def _counted(self, deliver: Callable[[Event], None]) -> Callable[[Event], None]:
        def count_and_deliver(event: Event) -> None:
            if event is None:
                with self._changed:
                    self._counts["rendered"] += 1
            elif isinstance(event, Exception) and not isinstance(
                event, RenderCrashedError | TimedOutError
            ):
                with self._changed:
                    self._counts["failed"] += 1
            deliver(event)

        return count_and_deliver

    def _count(self, error: OctobrickError) -> None:
        name = "timed_out" if isinstance(error, TimedOutError) else "crashed"
        if not isinstance(error, BusyError):  # that one was killed on purpose
            with self._changed:
                self._counts[name] += 1

    def _finish(self, job: RenderJob, worker: RenderWorker | None) -> None:
        with self._changed:
            self._running.discard(job)
            if job.started is not None:
                self._counts["render_seconds"] += time.monotonic() - job.started
            if worker is not None:
                self._memory[threading.current_thread().name] = worker.memory()

    def _forget(self, worker: RenderWorker) -> None:
        worker.close()
        with self._changed:
            self._memory.pop(threading.current_thread().name, None)


_COUNTS = ("rendered", "failed", "crashed", "timed_out", "stopped", "refused", "render_seconds")


def _pause_seconds(nlost: int) -> float:
    """None after the first loss, which may be one picture's fault; then more and more."""
    if nlost < 2:
        return 0.0
    return min(BACKOFF_SECONDS * 2.0 ** min(nlost - 2, 10), BACKOFF_MAX_SECONDS)


def _not_started(error: Exception) -> Exception:
    if isinstance(error, OSError):
        return ResourceError(f"No render worker could be started ({error.strerror})")
    return error
