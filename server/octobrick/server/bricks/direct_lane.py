"""The shortest way to a brick: answered where the request was parsed, without a task of its own.

An ASGI server makes a task, an event and two messages for each request, which take longer than a
brick does. So the connection asks a :class:`DirectLane` first, which answers what is in memory and
needs nothing that stands between: a plain GET or HEAD of a brick that is there. All else, every
error too, goes on to the application, whose answers are the same.

A client writes the headers of all its requests alike, to the byte. So a block of headers that was
parsed and answered once need not be parsed again: what follows the request line is looked up.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from functools import lru_cache
from http import HTTPStatus
from typing import Any, NamedTuple

from starlette.types import Scope

from octobrick.codec.errors import OctobrickError
from octobrick.server.bricks.brick_lane import conditions, parse_brick_path
from octobrick.server.bricks.brick_reply import BrickAddress, Content
from octobrick.server.services import Services

Admit = Callable[[Scope], bytes | None]
Note = Callable[[Scope, int, int, float], None]

# A request with one of these has a body, wants another protocol, or an answer with more headers.
_NEEDS_THE_APPLICATION = frozenset(
    (
        b"content-length",
        b"transfer-encoding",
        b"expect",
        b"upgrade",
        b"origin",
        b"x-request-id",
    )
)
_STATUS_LINES = {
    status: f"HTTP/1.1 {status} {HTTPStatus(status).phrase}\r\n".encode()
    for status in (200, 204, 304)
}
_REQUEST_LINE = re.compile(rb"GET (/v1/volumes/[^ ?%\r\n]+) HTTP/1\.1")
_LINE_NBYTES_MAX = 512  # a brick's is shorter
_END = b"\r\n\r\n"
_KEPT_BLOCKS = 64
_KEPT_BLOCK_NBYTES = 2_048


class _Block(NamedTuple):
    """A block of headers that was parsed: as ASGI has them, and what bricks want to know."""

    headers: list[tuple[bytes, bytes]]
    conditions: tuple[str, str]


@lru_cache(4_096)
def _parse_request_line(line: bytes) -> tuple[dict[str, Any], BrickAddress] | None:
    """The request as ASGI has it, but for the headers, and its brick; None for anything else."""
    found = _REQUEST_LINE.fullmatch(line)
    path = "" if found is None else found[1].decode("latin-1")
    address = parse_brick_path(path)
    if found is None or address is None:
        return None
    return {"method": "GET", "path": path, "raw_path": found[1], "query_string": b""}, address


class DirectAnswer(NamedTuple):
    """An answer as it goes out: all up to the empty line, but for the server's own headers."""

    head: bytes
    body: Content


class DirectLane:
    """Answers plain requests for bricks without the application. For one event loop.

    Args:
        services: open before the first request comes.
        admit: what stands before the application, for a request that it would let pass: the
            lines of headers that it adds to the answer; None where the application has to see it.
        note: told of each answer: request, status, bytes of body, seconds.
    """

    def __init__(self, services: Services, admit: Admit, note: Note | None = None) -> None:
        self._services = services
        self._admit = admit
        self._note = note
        self._blocks: dict[bytes, _Block] = {}

    def answer(self, scope: Scope) -> DirectAnswer | None:
        """The answer to a request; None where the application has to give it. Never waits."""
        started = time.perf_counter()
        if scope["method"] not in ("GET", "HEAD") or b"%" in scope["raw_path"]:
            return None
        address = parse_brick_path(scope["path"])
        if address is None:
            return None
        for name, _ in scope["headers"]:
            if name in _NEEDS_THE_APPLICATION:
                return None
        return self._answer(scope, address, conditions(scope), started)

    def answer_again(self, message: bytes) -> DirectAnswer | None:
        """The answer to a request whose headers were all there before.

        Args:
            message: all that came since the last request was whole.

        Returns:
            What `answer` would; None as it would, or where the message is not one whole GET with
            a block of headers that was kept.
        """
        started = time.perf_counter()
        line, _, rest = message.partition(b"\r\n")
        block = self._blocks.get(rest)
        if block is None or len(line) > _LINE_NBYTES_MAX:
            return None
        asked = _parse_request_line(line)
        if asked is None:
            return None
        scope, address = asked
        return self._answer(scope | {"headers": block.headers}, address, block.conditions, started)

    def keep(self, message: bytes, scope: Scope) -> None:
        """Remember the headers of a request that was answered, for `answer_again`.

        Args:
            message: all that came since the request before it was whole.
            scope: of the request; its connection stays open.
        """
        line, _, rest = message.partition(b"\r\n")
        found = _REQUEST_LINE.fullmatch(line)
        is_one = rest.find(_END) == len(rest) - len(_END) and len(rest) <= _KEPT_BLOCK_NBYTES
        accept_encoding, if_none_match = conditions(scope)
        # A block with the ETag of a brick does not come again.
        if found is None or found[1] != scope["raw_path"] or not is_one or if_none_match:
            return
        if len(self._blocks) >= _KEPT_BLOCKS:
            self._blocks.clear()
        self._blocks[rest] = _Block(list(scope["headers"]), (accept_encoding, ""))

    def _answer(
        self, scope: Scope, address: BrickAddress, asked: tuple[str, str], started: float
    ) -> DirectAnswer | None:
        try:
            added = self._admit(scope)
            if added is None:
                return None
            reply = self._services.bricks.reply_now(address, *asked)
        except OctobrickError:
            return None  # the application finds the same, and explains it
        if reply is None:
            return None
        body = b"" if scope["method"] == "HEAD" else reply.body
        if self._note is not None:
            self._note(scope, reply.status, len(body), time.perf_counter() - started)
        return DirectAnswer(_STATUS_LINES[reply.status] + reply.lines + added, body)
