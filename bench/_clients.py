"""What measurements of the service share: requests, streams of bricks, checks of both."""

from __future__ import annotations

import http.client
import json
import struct
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import google_crc32c
import zstandard

Place = tuple[int, int, int, int, int, int]
"""Level, t, c, z, y, x of a brick."""

HEADER = struct.Struct("<4sBBHII")  # docs/spec/brick-stream.md
RECORD = struct.Struct("<IB3xII")
STORED, ABSENT, UNREADABLE, END = 0, 1, 2, 255


@dataclass(frozen=True)
class Reply:
    """An answer that came whole."""

    status: int
    headers: dict[str, str]
    body: bytes

    def json(self) -> Any:
        """The body as JSON."""
        return json.loads(self.body)

    def kind(self) -> str:
        """The kind of an error."""
        return str(self.json()["error"]["kind"])


class Client:
    """One connection, opened again when it broke. For one thread.

    Args:
        host: an address.
        port: of the server there.
        timeout_seconds: longest silence.
    """

    def __init__(self, host: str, port: int, timeout_seconds: float = 60.0) -> None:
        self._connection = http.client.HTTPConnection(host, port, timeout=timeout_seconds)
        self.received_nbytes = 0
        self.opened_seconds = 0.0  # when the connection was made, as time.monotonic has it

    def ask(self, method: str, path: str, body: Any = None, **headers: str) -> Reply:
        """One request and its whole answer.

        Raises:
            OSError, http.client.HTTPException: the connection broke before the answer was whole.
        """
        with closing(self.open(method, path, body, **headers)) as reply:
            content = reply.read()
            self.received_nbytes += len(content)
            names = {name.lower(): value for name, value in reply.getheaders()}
            return Reply(reply.status, names, content)

    def open(
        self, method: str, path: str, body: Any = None, **headers: str
    ) -> http.client.HTTPResponse:
        """One request; its answer is read by the caller."""
        names = {name.replace("_", "-"): value for name, value in headers.items()}
        data = None
        if body is not None:
            data = json.dumps(body).encode()
            names["Content-Type"] = "application/json"
        if self._connection.sock is None:
            self.opened_seconds = time.monotonic()
        try:
            self._connection.request(method, path, data, names)
            return self._connection.getresponse()
        except BaseException:
            self._connection.close()
            raise

    def close(self) -> None:
        """Leave, whatever is under way."""
        self._connection.close()


def zstd_checked(frame: bytes, limit_nbytes: int = 1 << 28) -> bytes:
    """A frame's content; its checksum is verified.

    Raises:
        AssertionError: the frame has no checksum.
        zstandard.ZstdError: it is damaged.
    """
    assert zstandard.get_frame_parameters(frame).has_checksum, "a frame without a checksum"
    return zstandard.ZstdDecompressor().decompress(frame, max_output_size=limit_nbytes)


def records(reply: http.client.HTTPResponse, asked: int) -> Iterator[tuple[int, int, bytes]]:
    """Index, status and payload of each record of a stream, checked as its page demands.

    Raises:
        AssertionError: the stream is not what its page says.
        EOFError: it was cut off.
    """
    magic, version, _, _, count, _ = HEADER.unpack(_exactly(reply, HEADER.size))
    assert (magic, version, count) == (b"OBKS", 1, asked)
    before = -1
    while True:
        index, status, nbytes, crc = RECORD.unpack(_exactly(reply, RECORD.size))
        if status == END:
            assert (index, nbytes) == (asked, 0), "a wrong end record"
            assert not reply.read(1), "bytes after the end record"
            return
        assert before < index < asked, "indices out of order"
        assert nbytes <= 1 << 28, "a record that is too long"
        payload = _exactly(reply, nbytes)
        assert google_crc32c.value(payload) == crc, f"wrong checksum of record {index}"
        before = index
        yield index, status, payload


def _exactly(reply: http.client.HTTPResponse, nbytes: int) -> bytes:
    content = reply.read(nbytes)
    if len(content) < nbytes:
        raise EOFError(f"the stream ends {nbytes - len(content)} bytes early")
    return content
