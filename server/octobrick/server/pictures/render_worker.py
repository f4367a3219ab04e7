"""A process that renders: tasks come through a socket, pictures go back.

    python -m octobrick.server.pictures.render_worker FD MEMORY_BUDGET_NBYTES PAYLOAD_MAX_NBYTES

It ends when the other end of the socket closes, whatever it does at that moment, so it never
outlives its server. Nothing that it meets in a volume or in a driver can harm another process.
"""

from __future__ import annotations

import logging
import os
import queue
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Final, Protocol

from octobrick.codec.errors import OctobrickError
from octobrick.server.pictures.message_pipe import MessagePipe
from octobrick.server.pictures.render_task import PicturePart, RenderTask, error_to_json

if TYPE_CHECKING:
    from octobrick.renderer import Renderer

logger = logging.getLogger(__name__)

NICENESS: Final = 5
"""The processes that answer everything else go first."""


class Paints(Protocol):
    """What the loop needs of a painter."""

    def paint(self, task: RenderTask, is_stopped: Callable[[], bool]) -> Iterator[PicturePart]:
        """The parts of a picture."""


class _Inbox:
    """Reads messages in a thread of its own, so that a stop is heard while a picture is made."""

    def __init__(self, pipe: MessagePipe) -> None:
        self._pipe = pipe
        self._tasks: queue.SimpleQueue[tuple[int, Any]] = queue.SimpleQueue()
        self._stopped = -1  # numbers ascend, and one task runs at a time
        threading.Thread(target=self._read, name="octobrick-inbox", daemon=True).start()

    def next_task(self) -> tuple[int, Any]:
        """Number and JSON of the next task."""
        return self._tasks.get()

    def is_stopped(self, number: int) -> bool:
        """Whether nobody waits for this task any more."""
        return number <= self._stopped

    def _read(self) -> None:
        while True:
            try:
                message, _ = self._pipe.receive()
            except Exception:  # the server is gone, or not itself
                os._exit(0)
            if "task" in message:
                self._tasks.put((message["number"], message["task"]))
            else:
                self._stopped = max(self._stopped, message["stop"])


def work(pipe: MessagePipe, painter: Paints) -> None:
    """Answer tasks until the other end closes; then the process ends, so this never returns."""
    inbox = _Inbox(pipe)
    while True:
        number, given = inbox.next_task()
        reply: dict[str, Any] = {"number": number, "end": None}
        try:
            task = RenderTask.from_json(given)
            for part in painter.paint(task, lambda number=number: inbox.is_stopped(number)):  # type: ignore[misc]
                pipe.send({"number": number, "part": part.to_json()}, part.body)
        except OctobrickError as error:
            reply["end"] = error_to_json(error)
        except OSError:
            os._exit(1)
        except Exception as error:  # the loop goes on; the painter has let go of its renderer
            logger.exception("unexpected error")
            reply["end"] = {"unexpected": repr(error)[:1000]}
        pipe.send(reply)


def main(arguments: list[str]) -> None:
    """Run as a process of its own; see the module."""
    sock = socket.socket(fileno=int(arguments[0]))
    # The server says when to stop, by closing: signals to its whole group are not for us.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    with suppress(OSError):
        os.nice(NICENESS)
    logging.basicConfig(level=logging.INFO, format="%(levelname)s %(name)s: %(message)s")
    budget_nbytes, payload_max_nbytes = int(arguments[1]), int(arguments[2])

    from octobrick.server.pictures.painter import Painter

    def make_renderer() -> Renderer:
        from octobrick.renderer import Renderer  # needs the extra, and only pictures need it

        return Renderer(memory_budget=budget_nbytes)

    work(MessagePipe(sock, payload_max_nbytes), Painter(make_renderer))


if __name__ == "__main__":
    main(sys.argv[1:])
