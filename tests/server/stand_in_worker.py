"""A render worker that needs no OpenGL and does as it is told: also dies, hangs and babbles."""

from __future__ import annotations

import os
import signal
import socket
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from octobrick.codec.errors import CorruptBrickError, InvalidInputError
from octobrick.server.pictures.message_pipe import MessagePipe
from octobrick.server.pictures.render_task import PicturePart, RenderTask
from octobrick.server.pictures.render_worker import work


class Painter:
    """Does what the word under "do" says."""

    def paint(self, task: RenderTask, is_stopped: Callable[[], bool]) -> Iterator[PicturePart]:
        """A part that holds the number of this process."""
        do, argument = task.picture["do"], task.picture.get("argument")
        part = PicturePart(
            str(os.getpid()).encode(), "image/png", False, 1, 2.5, True, {"render": 1}, {"slab": 7}
        )
        match do:
            case "die":
                os.kill(os.getpid(), signal.Signals[argument])
            case "hang":
                if argument:
                    partial = Path(f"{argument}.partial")
                    partial.write_text(str(os.getpid()))
                    partial.rename(argument)
                time.sleep(1000)
            case "raise":
                raise ZeroDivisionError("nobody foresaw this")
            case "refuse":
                raise CorruptBrickError("checksums differ in /this/file", level=3)
            case "long part":
                yield PicturePart(bytes(10**6), "image/png", True, 1, 0, True, {}, {})
            case "evil part":
                yield PicturePart(b"", "text/html", True, 1, 0, True, {}, {})
            case "grow":
                ballast = b"x" * (200 << 20)
                time.sleep(1000 + len(ballast))
            case "until stopped":
                yield part
                while not is_stopped():
                    time.sleep(0.01)
                return
            case "picture":
                pass
            case _:
                raise InvalidInputError(f"do what? {do}")
        yield part


if __name__ == "__main__":
    if sys.argv[2:] == ["broken"]:
        sys.exit("no such library")
    if sys.argv[2:] == ["babbles"]:
        os.write(int(sys.argv[1]), b"GET / HTTP/1.1\r\n" * 100)
        time.sleep(1000)
    work(MessagePipe(socket.socket(fileno=int(sys.argv[1])), 1000), Painter())
