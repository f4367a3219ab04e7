"""A web server of the tests, over a folder, which fails on demand; with paths as S3 has them."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from email.utils import formatdate
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

# Gives the answer to a path in place of the file; False leaves it to the file.
Trick = Callable[["Handler"], bool]


class Web:
    """Serves a folder on a free port of this machine while a ``with`` block runs.

    Attributes:
        url: its address, without a slash at the end.
        ranges: whether it knows HTTP Range.
        trick: looks at each request before it is answered.
        asked: the requests so far: path, Range or None, headers.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.ranges = True
        self.trick: Trick = lambda handler: False
        self.asked: list[tuple[str, str | None, dict[str, str]]] = []
        handler = type("BoundHandler", (Handler,), {"web": self})
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
        self.url = f"http://127.0.0.1:{self._server.server_address[1]}"

    def paths(self) -> list[str]:
        return [path for path, _, _ in self.asked]

    @contextmanager
    def running(self) -> Iterator[Web]:
        thread = threading.Thread(target=self._server.serve_forever, args=(0.02,), daemon=True)
        thread.start()
        try:
            yield self
        finally:
            self._server.shutdown()
            self._server.server_close()
            thread.join()


class Handler(BaseHTTPRequestHandler):
    web: Web
    protocol_version = "HTTP/1.1"
    wbufsize = 1 << 16  # head and body in one packet

    def do_GET(self) -> None:
        path = self.path.split("?")[0]
        self.web.asked.append((path, self.headers.get("Range"), dict(self.headers)))
        try:
            if not self.web.trick(self):
                self._send_file(self.web.folder / path.lstrip("/"))
        except (BrokenPipeError, ConnectionResetError):
            self.close_connection = True

    def _send_file(self, path: Path) -> None:
        if not path.is_file():
            self.answer(404, b"not here")
            return
        data = path.read_bytes()
        status = path.stat()
        headers = {
            "ETag": f'"{status.st_mtime_ns:x}-{status.st_size:x}"',
            "Last-Modified": formatdate(status.st_mtime, usegmt=True),
        }
        wanted = self.headers.get("Range") if self.web.ranges else None
        if wanted is None:
            self.answer(200, data, headers)
            return
        match = re.fullmatch(r"bytes=(\d*)-(\d*)", wanted)
        assert match is not None
        size = len(data)
        if match[1]:
            start, stop = int(match[1]), min(int(match[2] or size) + 1, size)
        else:
            start, stop = max(0, size - int(match[2])), size
        if start >= stop:
            self.answer(416, b"", {"Content-Range": f"bytes */{size}"})
            return
        headers["Content-Range"] = f"bytes {start}-{stop - 1}/{size}"
        self.answer(206, data[start:stop], headers)

    def answer(self, status: int, body: bytes = b"", headers: dict[str, str] | None = None) -> None:
        self.send_response(status)
        for name, value in ({"Content-Length": str(len(body))} | (headers or {})).items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)
        self.wfile.flush()

    def log_message(self, *args: Any) -> None:
        pass


def status(code: int, end: str = "", times: int | None = None) -> Trick:
    """Answers a status to paths of an ending, for ever or the first ``times`` times."""
    left = [times]

    def trick(handler: Handler) -> bool:
        if not handler.path.endswith(end) or left[0] == 0:
            return False
        if left[0] is not None:
            left[0] -= 1
        handler.answer(code, b"<Error><Code>no</Code></Error>")
        return True

    return trick


def broken_off(end: str, times: int | None = None) -> Trick:
    """Sends half of an answer to paths of an ending, and goes."""
    left = [times]

    def trick(handler: Handler) -> bool:
        if not handler.path.endswith(end) or left[0] == 0:
            return False
        if left[0] is not None:
            left[0] -= 1
        handler.answer(200, b"1234", {"Content-Length": "1000"})
        handler.close_connection = True
        return True

    return trick


def dead_after(count: int) -> Trick:
    """Answers so many requests; then it takes connections and drops them."""
    answered = []

    def trick(handler: Handler) -> bool:
        answered.append(handler.path)
        if len(answered) <= count:
            return False
        handler.close_connection = True
        return True

    return trick


def silent(end: str, seconds: float) -> Trick:
    """Does not answer paths of an ending in time."""

    def trick(handler: Handler) -> bool:
        if not handler.path.endswith(end):
            return False
        time.sleep(seconds)
        handler.close_connection = True
        return True

    return trick


def fixed(code: int, body: bytes, headers: dict[str, str], end: str = "") -> Trick:
    """One answer to all paths of an ending."""

    def trick(handler: Handler) -> bool:
        if not handler.path.endswith(end):
            return False
        handler.answer(code, body, headers)
        return True

    return trick
