"""The shortest way to a brick: answered where the request was parsed, without a task of its own.

An ASGI server makes a task, an event and two messages for each request, which take longer than a
brick does. So uvicorn's protocol asks a :class:`DirectLane` first, which answers what is in memory
and needs nothing that stands between: a plain GET or HEAD of a brick that is there. All else,
every error too, goes on to the application, whose answers are the same.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from http import HTTPStatus
from typing import Any, NamedTuple

from starlette.types import Scope
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from octobrick.codec.errors import OctobrickError
from octobrick.server.bricks.brick_headers import header_lines
from octobrick.server.bricks.brick_lane import conditions, parse_brick_path
from octobrick.server.bricks.brick_reply import Content
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

    def answer(self, scope: Scope) -> DirectAnswer | None:
        """The answer to a request; None where the application has to give it. Never waits."""
        started = time.perf_counter()
        method = scope["method"]
        if method not in ("GET", "HEAD") or b"%" in scope["raw_path"]:
            return None
        address = parse_brick_path(scope["path"])
        if address is None:
            return None
        for name, _ in scope["headers"]:
            if name in _NEEDS_THE_APPLICATION:
                return None
        try:
            added = self._admit(scope)
            if added is None:
                return None
            reply = self._services.bricks.reply_now(address, *conditions(scope))
        except OctobrickError:
            return None  # the application finds the same, and explains it
        if reply is None:
            return None
        body = b"" if method == "HEAD" else reply.body
        if self._note is not None:
            self._note(scope, reply.status, len(body), time.perf_counter() - started)
        return DirectAnswer(_STATUS_LINES[reply.status] + reply.lines + added, body)


def direct_protocol(
    lane: DirectLane, base: type[HttpToolsProtocol] = HttpToolsProtocol
) -> type[HttpToolsProtocol]:
    """Uvicorn's HTTP protocol with a direct lane, for the ``http`` of ``uvicorn.Config``.

    Args:
        lane: asked first.
        base: uvicorn's protocol, or one that adds to it.
    """

    class DirectProtocol(base):  # type: ignore[misc, valid-type]  # a class that is a value
        def _start_asgi_task(self, cycle: Any, app: Any) -> None:
            # Not where the client is slow to take what it has, the server is full, or logs.
            is_open = app is self.config.loaded_app
            is_plain = is_open and not (self.flow.write_paused or self.access_log)
            answer = lane.answer(cycle.scope) if is_plain else None
            if answer is None:
                super()._start_asgi_task(cycle, app)
                return
            last = header_lines(cycle.default_headers)
            if not cycle.keep_alive:
                last += b"connection: close\r\n"
            self.transport.writelines((answer.head + last + b"\r\n", answer.body))
            cycle.response_started = cycle.response_complete = True
            if not cycle.keep_alive:
                self.transport.close()
            self.on_response_complete()

    return DirectProtocol
