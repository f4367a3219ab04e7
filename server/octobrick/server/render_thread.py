"""One thread that owns the renderer, and the queue before it.

A renderer makes one picture at a time. So pictures wait here, in the order they were asked for and
no more than can be waited for, and the threads that read bricks never wait behind them.
"""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, Generic, Protocol, TypeVar

from octobrick.codec.errors import OctobrickError
from octobrick.server.errors import BusyError

logger = logging.getLogger(__name__)

T = TypeVar("T")


class Closable(Protocol):
    """What the thread must be able to do with its renderer by itself."""

    def close(self) -> None:
        """Release the renderer's context and memory."""


R = TypeVar("R", bound=Closable)
_Task = tuple["Future[Any]", Callable[[Any], Any]]


class RenderThread(Generic[R]):
    """Runs jobs with a renderer, one after the other, in the order they came.

    The renderer is made when the first job needs it, so a machine without OpenGL serves all
    else; where making it fails, each job gets that error and the next one tries again. A job
    whose future was cancelled while it waited is not run. Safe to use from any thread.

    Args:
        make_renderer: called in the thread; its result never leaves it.
        queue_length: jobs that may wait besides the one that runs.
    """

    def __init__(self, make_renderer: Callable[[], R], queue_length: int) -> None:
        self._make_renderer = make_renderer
        self._tasks: queue.Queue[_Task | None] = queue.Queue(queue_length)
        self._lock = threading.Lock()  # keeps jobs from entering the queue behind the last one
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="octobrick-render", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def submit(self, job: Callable[[R], T]) -> Future[T]:
        """Queue a job.

        Raises:
            BusyError: the queue is full, or the thread is closing.
        """
        future: Future[T] = Future()
        with self._lock:
            if self._closing:
                raise BusyError("The server is shutting down")
            try:
                self._tasks.put_nowait((future, job))
            except queue.Full:
                raise BusyError(
                    f"{self._tasks.maxsize} pictures wait for the renderer already; "
                    "try again later",
                    limit_name="render_queue_length",
                    limit=self._tasks.maxsize,
                ) from None
        return future

    def close(self, timeout_seconds: float) -> None:
        """Refuse new jobs, fail those that wait, let the running one end, release the renderer.

        A job that is still running after the timeout is left behind, to die with the process.
        """
        with self._lock:
            first, self._closing = not self._closing, True
            while not self._tasks.empty():
                task = self._tasks.get_nowait()
                if task is not None and task[0].set_running_or_notify_cancel():
                    task[0].set_exception(BusyError("The server is shutting down"))
            if first:
                self._tasks.put_nowait(None)
        self._thread.join(timeout_seconds)
        if self._thread.is_alive():
            logger.warning("a picture was still being rendered when the server stopped")

    def _run(self) -> None:
        renderer: R | None = None
        while (task := self._tasks.get()) is not None:
            future, job = task
            if not future.set_running_or_notify_cancel():
                continue
            try:
                if renderer is None:
                    renderer = self._make_renderer()
                future.set_result(job(renderer))
            except OctobrickError as error:
                future.set_exception(error)
            except Exception as error:
                future.set_exception(error)
                # The context may be in any state now: the next job gets a fresh one.
                _release(renderer)
                renderer = None
            del task, future, job  # or the last picture stays in memory until the next one
        _release(renderer)


def _release(renderer: Closable | None) -> None:
    if renderer is None:
        return
    try:
        renderer.close()
    except Exception:
        logger.exception("the renderer could not be closed")
