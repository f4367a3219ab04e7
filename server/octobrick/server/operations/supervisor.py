"""Several server processes on one socket: started, watched, replaced, and stopped together.

uvicorn's own supervisor restarts workers without a pause, hears no second signal, and does not say
when all of them serve; so this is ours. Workers are spawned, never forked: no lock or thread of
this process is copied into them.
"""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import os
import signal
import socket
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection as Pipe
from multiprocessing.connection import wait
from multiprocessing.context import SpawnProcess
from pathlib import Path

from octobrick.server.operations.metrics_folder import MetricsFolder
from octobrick.server.settings import Settings

logger = logging.getLogger(__name__)

_READY, _STOP = b"ready", b"stop"
_BACKOFF_SECONDS = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 30.0)  # before a worker is started again
_STEADY_SECONDS = 60.0  # a worker that lived as long is replaced at once
_GRACE_SECONDS = 5.0  # beyond what a worker takes by its settings; then it is killed


@dataclass(slots=True)
class _Worker:
    """One place for a worker: the process in it now, if any, and how often it failed."""

    process: SpawnProcess | None = None
    pipe: Pipe | None = None
    started: float = 0.0
    failures: int = 0
    start_at: float = 0.0
    was_ready: bool = False


@dataclass(slots=True)
class _Signals:
    """Signals that arrived, and a descriptor that wakes who waits for other things too."""

    read_end: int
    received: list[int] = field(default_factory=list)


class Supervisor:
    """Runs ``settings.workers`` processes until a signal, or until they cannot be started.

    Args:
        settings: the server's settings.
        listener: a listening socket; all workers accept from it.
        on_ready: called once all workers answer requests.
    """

    def __init__(
        self, settings: Settings, listener: socket.socket, on_ready: Callable[[], None]
    ) -> None:
        self._settings = settings
        self._listener = listener
        self._on_ready = on_ready
        self._announced = False
        self._clean = True
        self._spawn = multiprocessing.get_context("spawn")
        self._workers = [_Worker() for _ in range(settings.workers)]

    def run(self) -> int:
        """Serve; returns the exit status: 0 after an orderly stop of all workers, else 1.

        It is 1, too, where a worker ended before all of them served: it would do so again.
        """
        with _signals() as signals, tempfile.TemporaryDirectory(prefix="octobrick-") as folder:
            self._folder = Path(folder)
            while not signals.received:
                for worker in self._workers:
                    if worker.process is None and time.monotonic() >= worker.start_at:
                        self._start(worker)
                self._wait(signals, self._until_next_start())
                if not self._announced and not self._clean:
                    break  # it failed before it ever served, and would do so again
            stopped_in_order = self._stop(signals)
        return 0 if stopped_in_order and self._clean else 1

    def _start(self, worker: _Worker) -> None:
        ours, theirs = self._spawn.Pipe()
        worker.process = self._spawn.Process(
            target=_work, args=(self._settings, self._listener, theirs, self._folder)
        )
        worker.process.start()
        theirs.close()
        worker.pipe, worker.started, worker.was_ready = ours, time.monotonic(), False

    def _until_next_start(self) -> float | None:
        now = time.monotonic()
        waits = [max(w.start_at - now, 0.0) for w in self._workers if w.process is None]
        return min(waits, default=None)

    def _wait(self, signals: _Signals, timeout: float | None) -> None:
        """Wait until a worker says something or ends, or a signal comes."""
        pipes = {w.pipe: w for w in self._workers if w.pipe is not None}
        ends = {w.process.sentinel: w for w in self._workers if w.process is not None}
        for source in wait([signals.read_end, *pipes, *ends], timeout):
            if source == signals.read_end:
                os.read(signals.read_end, 64)
            elif isinstance(source, Pipe):
                self._hear(pipes[source])
            elif isinstance(source, int):
                self._reap(ends[source])

    def _hear(self, worker: _Worker) -> None:
        assert worker.pipe is not None
        try:
            worker.was_ready = worker.pipe.recv_bytes(64) == _READY
        except (EOFError, OSError):  # it has ended, as its sentinel says too
            worker.pipe.close()
            worker.pipe = None
        if not self._announced and all(w.was_ready for w in self._workers):
            self._announced = True
            self._on_ready()

    def _reap(self, worker: _Worker) -> None:
        """A worker has ended though nobody asked it to: have it replaced."""
        process = worker.process
        assert process is not None
        assert process.pid is not None
        process.join()
        MetricsFolder(self._folder).retire(process.pid)
        if not self._announced:
            self._clean = False
        steady = worker.was_ready and time.monotonic() - worker.started >= _STEADY_SECONDS
        worker.failures = 0 if steady else worker.failures + 1
        pause = _BACKOFF_SECONDS[min(worker.failures, len(_BACKOFF_SECONDS) - 1)]
        worker.start_at = time.monotonic() + pause
        logger.error(
            "worker %d ended with status %s; another one starts in %g s",
            process.pid, process.exitcode, pause,
        )  # fmt: skip
        self._forget(worker)

    def _stop(self, signals: _Signals) -> bool:
        """Stop all workers; at once at a second signal. Returns whether all stopped in order."""
        self._listener.close()  # or new clients would wait here for a worker that never comes
        for worker in self._workers:
            if worker.pipe is not None:
                with contextlib.suppress(OSError):
                    worker.pipe.send_bytes(_STOP)
        settings = self._settings
        # Rendering may take its own share of the time after requests had theirs.
        end = time.monotonic() + settings.drain_seconds + 2 * settings.shutdown_seconds
        end += _GRACE_SECONDS
        running = [w.process for w in self._workers if w.process is not None]
        while running and len(signals.received) < 2 and time.monotonic() < end:
            sentinels = [process.sentinel for process in running]
            if signals.read_end in wait([signals.read_end, *sentinels], end - time.monotonic()):
                os.read(signals.read_end, 64)
            running = [process for process in running if process.is_alive()]
        for process in running:
            process.kill()
        statuses = []
        for worker in self._workers:
            if worker.process is not None:
                worker.process.join()
                statuses.append(worker.process.exitcode)
                self._forget(worker)
        return not any(statuses)

    def _forget(self, worker: _Worker) -> None:
        assert worker.process is not None
        worker.process.close()
        worker.process = None
        if worker.pipe is not None:
            worker.pipe.close()
            worker.pipe = None


def _work(settings: Settings, listener: socket.socket, pipe: Pipe, folder: Path) -> None:
    """What a worker does: serve until the supervisor says stop, or is no more."""
    from octobrick.server.operations.server_process import ServerProcess

    server = ServerProcess(settings, lambda: pipe.send_bytes(_READY), folder)

    def obey() -> None:
        with contextlib.suppress(EOFError, OSError):
            pipe.recv_bytes(64)
        server.stop()

    threading.Thread(target=obey, name="octobrick-obey", daemon=True).start()
    # A terminal or a service manager sends signals to all processes at once: the supervisor
    # alone counts them, and tells.
    server.handle_exit = lambda *_: server.stop()  # type: ignore[method-assign]
    server.run(sockets=[listener])


@contextlib.contextmanager
def _signals() -> Iterator[_Signals]:
    read_end, write_end = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
    signals = _Signals(read_end)
    before = {
        number: signal.signal(number, lambda number, _frame: signals.received.append(number))
        for number in (signal.SIGTERM, signal.SIGINT)
    }
    wakeup = signal.set_wakeup_fd(write_end, warn_on_full_buffer=False)
    try:
        yield signals
    finally:
        signal.set_wakeup_fd(wakeup)
        for number, handler in before.items():
            signal.signal(number, handler)
        os.close(read_end)
        os.close(write_end)
