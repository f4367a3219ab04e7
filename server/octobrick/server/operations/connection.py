"""One client's connection, with the limits that uvicorn does not have.

uvicorn's parser takes headers without end, and waits for ever for a request to be whole. Here the
bytes before a body are counted, connections beyond a number are answered 503, and a sweep every
second, which costs requests nothing, cuts off who takes too long to ask.
"""

from __future__ import annotations

import asyncio
import json
from typing import Any

from starlette.types import ASGIApp, Receive, Scope, Send
from uvicorn.config import Config
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol
from uvicorn.server import ServerState

from octobrick.codec.errors import InvalidInputError, OctobrickError
from octobrick.server.error_replies import error_reply
from octobrick.server.errors import BusyError, HeadersTooLongError, answer_to, public_view
from octobrick.server.settings import Settings

# Connections over the limit that are still told so; more are closed without a word.
_TOLD_BUSY = 64
_PROBES = frozenset({"/healthz", "/readyz", "/metrics"})  # answered however busy it is
_PHRASES = {400: "Bad Request", 408: "Request Timeout", 431: "Request Header Fields Too Large"}


class Connection(HttpToolsProtocol):
    """HTTP/1.1 on one socket.

    Args:
        settings: the limits. The rest is uvicorn's.
    """

    def __init__(
        self,
        settings: Settings,
        config: Config,
        server_state: ServerState,
        app_state: dict[str, Any],
        _loop: asyncio.AbstractEventLoop | None = None,
    ) -> None:
        super().__init__(config, server_state, app_state, _loop)
        self._max_header_nbytes = settings.max_header_nbytes
        self._max_connections = settings.max_connections
        self._head_nbytes = 0
        self._asking_since: float | None = None  # None while nothing is expected of the client

    @property
    def is_between_requests(self) -> bool:
        """Whether all that came was whole requests, at least one, and all of them are answered."""
        return (
            self._asking_since is None
            and self.cycle.response_complete
            and not self.transport.is_closing()
        )

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take a connection in, or not."""
        super().connection_made(transport)
        self._asking_since = self.loop.time()
        beyond = len(self.connections) - self._max_connections
        if beyond > _TOLD_BUSY:
            transport.abort()
        elif beyond > 0:
            self.app = _busy(self.app, self._max_connections)

    def data_received(self, data: bytes) -> None:
        """Parse what came, unless it is too much before a body."""
        if self._asking_since is None:
            self._asking_since = self.loop.time()
        self._head_nbytes += len(data)
        super().data_received(data)
        if self._head_nbytes > self._max_header_nbytes and not self._is_asked():
            self._refuse(
                431,
                HeadersTooLongError(
                    f"The request has more than {self._max_header_nbytes} bytes before its body",
                    limit_name="max_header_nbytes",
                    limit=self._max_header_nbytes,
                    value=self._head_nbytes,
                ),
            )

    def on_message_begin(self) -> None:
        """A request begins, perhaps right behind another one."""
        if self._asking_since is None:
            self._asking_since = self.loop.time()
        super().on_message_begin()

    def on_message_complete(self) -> None:
        """The request is whole: the client may take its time now."""
        self._asking_since = None
        self._head_nbytes = 0
        super().on_message_complete()

    def send_400_response(self, msg: str) -> None:
        """Answer what is no HTTP, in the one shape of errors."""
        self._refuse(400, InvalidInputError(msg.rstrip(".")))

    def cut_off_if_late(self, limit_seconds: float) -> None:
        """Close the connection if its client has been sending one request for longer than this."""
        since = self._asking_since
        if since is None or self.loop.time() - since <= limit_seconds:
            return
        if self._is_asked() or self._head_nbytes == 0:
            self.transport.abort()  # a route waits for the body, or nothing was asked: no answer
            return
        message = f"The request was not whole after {limit_seconds:g} seconds"
        self._refuse(408, InvalidInputError(message, limit_name="receive_seconds"))

    def _is_asked(self) -> bool:
        """Whether the head of the last request is whole, so that a route has it."""
        return self.cycle is not None and self.cycle.scope is self.scope

    def _refuse(self, status: int, error: OctobrickError) -> None:
        """Answer below all layers, where there is no request yet, and close."""
        if self.transport.is_closing():
            return
        if self.cycle is not None and not self.cycle.response_complete:
            self.transport.abort()  # another answer is under way on this connection
            return
        body = json.dumps(public_view(error)).encode()
        head = (
            f"HTTP/1.1 {status} {_PHRASES[status]}\r\ncontent-type: application/json\r\n"
            f"content-length: {len(body)}\r\ncache-control: no-store\r\n"
            "x-content-type-options: nosniff\r\n"
            f"x-octobrick-error: {error.kind}\r\nconnection: close\r\n\r\n"
        )
        self.transport.write(head.encode("ascii") + body)
        self.transport.close()


def _busy(app: ASGIApp, limit: int) -> ASGIApp:
    """Says that there are too many connections, but lets probes through."""

    async def answer(scope: Scope, receive: Receive, send: Send) -> None:
        if scope["path"] in _PROBES:
            await app(scope, receive, send)
            return
        error = BusyError(
            f"{limit} clients are connected already; try again later",
            limit_name="max_connections",
            limit=limit,
        )
        retry = str(answer_to(BusyError).retry_after_seconds)
        headers = {"connection": "close", "retry-after": retry}
        await error_reply(error, headers)(scope, receive, send)

    return answer
