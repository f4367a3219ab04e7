"""The server's end of a render worker: starts the process, gives it tasks, and ends it."""

from __future__ import annotations

import logging
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, Final, Protocol

from octobrick.codec.errors import OctobrickError
from octobrick.server.errors import (
    BusyError,
    InternalError,
    RenderCrashedError,
    RenderTimeoutError,
)
from octobrick.server.pictures.message_pipe import MessageError, MessagePipe
from octobrick.server.pictures.painter import Painter
from octobrick.server.pictures.render_job import RenderJob
from octobrick.server.pictures.render_task import PicturePart, error_from_json

logger = logging.getLogger(__name__)

LOOK_SECONDS: Final = 0.05
"""How often one looks, while a picture is made, whether it is still wanted and what it takes."""
DEATH_SECONDS: Final = 2.0
"""How long a process that closed its socket, or was killed, may take to be gone."""
LOG_LINE_MAX: Final = 2_000
_OWN_SETTINGS = "OCTOBRICK_"  # tokens and keys among them, which no worker needs


class WorkerLostError(Exception):
    """A worker died, hung or was killed; a fresh one is needed.

    Args:
        error: what whoever waited for the picture is told.
    """

    def __init__(self, error: OctobrickError) -> None:
        super().__init__(error.message)
        self.error = error


class RenderWorker(Protocol):
    """What a pool needs of a worker."""

    def run(self, job: RenderJob, limit_seconds: float) -> None:
        """Make a picture: its parts, and the end, are given to the job.

        Raises:
            WorkerLostError: the worker is of no use any more, and the job has had no end.
        """

    def is_usable(self) -> bool:
        """Whether it can be given another job."""

    def memory(self) -> dict[str, int]:
        """Bytes that its renderer held after its last picture, by what."""

    def close(self) -> None:
        """End it, and free what it holds. Idempotent."""


class ThreadWorker:
    """Renders in the thread that calls it: for tests, and where a process cannot be started.

    Args:
        painter: makes the pictures.
    """

    def __init__(self, painter: Painter) -> None:
        self._painter = painter
        self._memory: dict[str, int] = {}

    def run(self, job: RenderJob, limit_seconds: float) -> None:  # noqa: ARG002  (no way to end it)
        """Make a picture."""
        try:
            for part in self._painter.paint(job.task, lambda: job.stopped):
                self._memory = part.memory
                job.give(part)
        except Exception as error:
            job.give(error)
        else:
            job.give(None)

    def is_usable(self) -> bool:
        """Always."""
        return True

    def memory(self) -> dict[str, int]:
        """Bytes by what."""
        return self._memory

    def close(self) -> None:
        """Release the renderer."""
        self._painter.close()


class ProcessWorker:
    """A process of `pictures.render_worker`, or of another command that speaks as it does.

    One thread uses it.

    Args:
        command: program and arguments; the descriptor of its socket is put in for ``{fd}``.
        payload_max_nbytes: longest picture file that is believed.
        memory_limit_nbytes: resident memory beyond which it is killed; None for no limit.

    Raises:
        OSError: the system refuses to start a process.
    """

    def __init__(
        self,
        command: Sequence[str],
        payload_max_nbytes: int,
        memory_limit_nbytes: int | None = None,
    ) -> None:
        ours, theirs = socket.socketpair()
        self._pipe = MessagePipe(ours, payload_max_nbytes)
        self._memory_limit_nbytes = memory_limit_nbytes
        self._memory: dict[str, int] = {}
        self._number = 0
        try:
            with theirs:
                self._process = subprocess.Popen(  # noqa: S603  (the command is ours)
                    [part.replace("{fd}", str(theirs.fileno())) for part in command],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.STDOUT,
                    pass_fds=[theirs.fileno()],
                    start_new_session=True,  # Ctrl-C at a terminal is for the server alone
                    env={k: v for k, v in os.environ.items() if not k.startswith(_OWN_SETTINGS)},
                )
        except OSError:
            self._pipe.close()
            raise
        assert self._process.stdout
        self._log = threading.Thread(
            target=_log_lines,
            args=(self._process.stdout, self.pid),
            name=f"octobrick-render-log-{self.pid}",
            daemon=True,
        )
        self._log.start()

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    def run(self, job: RenderJob, limit_seconds: float) -> None:
        """Make a picture; see `RenderWorker`."""
        self._number += 1
        deadline = time.monotonic() + limit_seconds
        try:
            self._pipe.send({"number": self._number, "task": job.task.to_json()})
            while not self._receive(job, deadline):
                pass
        except (EOFError, OSError) as error:
            raise WorkerLostError(_crashed(self._how_it_ended())) from error
        except (MessageError, KeyError, TypeError, ValueError, AttributeError) as error:
            if time.monotonic() >= deadline:
                raise WorkerLostError(_timed_out(limit_seconds)) from error
            logger.error("render worker %d does not speak as it should: %r", self.pid, error)
            raise WorkerLostError(_crashed("what it sent cannot be read")) from error

    def is_usable(self) -> bool:
        """Whether the process runs, within its memory, and says nothing unasked."""
        runs = self._process.poll() is None and not self._pipe.arrives(0)
        return runs and not self._is_too_large()

    def memory(self) -> dict[str, int]:
        """Bytes by what."""
        return self._memory

    def close(self) -> None:
        """Kill the process; nothing of it is left."""
        self._pipe.close()
        with suppress(ProcessLookupError):
            self._process.kill()
        try:
            self._process.wait(DEATH_SECONDS)
        except subprocess.TimeoutExpired:  # in the kernel, such as in a driver's call
            logger.error("render worker %d cannot be killed", self.pid)
            return
        self._log.join(DEATH_SECONDS)

    def _receive(self, job: RenderJob, deadline: float) -> bool:
        """Wait for one message and pass it on; True where it was the last one."""
        self._wait(job, deadline)
        message, body = self._pipe.receive(deadline)
        if message["number"] != self._number:
            raise MessageError(f"job {message['number']} is not {self._number}")
        if "part" in message:
            part = PicturePart.from_json(message["part"], body)
            self._memory = part.memory
            job.give(part)
            return False
        end = message["end"]
        if end is None:
            job.give(None)
        elif "unexpected" in end:
            job.give(InternalError("The server met an unexpected error; its log has the details"))
        else:
            job.give(error_from_json(end))
        return True

    def _wait(self, job: RenderJob, deadline: float) -> None:
        """Return when something arrives; meanwhile hold the worker to its limits."""
        told = False
        while not self._pipe.arrives(LOOK_SECONDS):
            if job.stopped and not told:
                self._pipe.send({"stop": self._number})
                told = True
            if job.abandoned:
                raise WorkerLostError(BusyError("The server is shutting down"))
            if time.monotonic() >= deadline:
                raise MessageError("nothing arrived in time")
            if self._is_too_large():
                raise WorkerLostError(_crashed("it took more memory than this server allows"))

    def _is_too_large(self) -> bool:
        if self._memory_limit_nbytes is None:
            return False
        try:
            resident_pages = int(Path(f"/proc/{self.pid}/statm").read_text().split()[1])
        except (OSError, ValueError, IndexError):  # gone, or a system without /proc
            return False
        return resident_pages * os.sysconf("SC_PAGE_SIZE") > self._memory_limit_nbytes

    def _how_it_ended(self) -> str:
        try:
            code = self._process.wait(DEATH_SECONDS)
        except subprocess.TimeoutExpired:
            return "it closed its end of the line"
        if code >= 0:
            return f"exit code {code}"
        try:
            return signal.Signals(-code).name
        except ValueError:
            return f"signal {-code}"


def process_worker_factory(
    memory_budget_nbytes: int, payload_max_nbytes: int, memory_limit_nbytes: int | None
) -> Callable[[], ProcessWorker]:
    """What makes workers that render, with a budget for bricks."""
    # -P: no module of the folder in which the server happens to run is taken for ours.
    module = [sys.executable, "-P", "-m", "octobrick.server.pictures.render_worker", "{fd}"]
    command = [*module, str(memory_budget_nbytes), str(payload_max_nbytes)]
    return lambda: ProcessWorker(command, payload_max_nbytes, memory_limit_nbytes)


def _crashed(how: str) -> RenderCrashedError:
    return RenderCrashedError(
        f"The process that rendered the picture ended ({how}); a fresh one takes its place: ask "
        "again, or for less",
        how=how,
    )


def _timed_out(limit_seconds: float) -> RenderTimeoutError:
    return RenderTimeoutError(
        f"The picture was not ready within {limit_seconds:g} seconds; ask for a smaller one, or "
        "try again later",
        limit_name="render_timeout_seconds",
        limit=limit_seconds,
    )


def _log_lines(stream: IO[Any], pid: int) -> None:
    """Pass what a worker prints to the log, until it is gone."""
    with stream:
        while line := stream.readline(LOG_LINE_MAX):
            text = line.decode(errors="replace").rstrip()
            if text:
                logger.warning("render worker %d: %s", pid, text)
