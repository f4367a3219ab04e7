"""What every request must pass before any route: plain ASGI, so that it costs microseconds."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from octobrick.codec.errors import InvalidInputError, OctobrickError
from octobrick.server.error_replies import error_reply
from octobrick.server.errors import (
    AddressTooLongError,
    ClientGoneError,
    HeadersTooLongError,
    LimitError,
)
from octobrick.server.security.guard import Guard
from octobrick.server.settings import Settings

# Octets that some layer could take for a separator or an end once they are decoded: / \ % NUL.
_ENCODED_SEPARATOR = re.compile(rb"%(2f|5c|25|00)|\\", re.IGNORECASE)


class Gate:
    """Refuses odd addresses, long requests and callers who may not pass; says who the others are.

    Behind it ``scope["state"]`` has ``client``, the caller's name for fair queues (the token's
    name, ``signed``, or the network address), and ``access``, an `Access` or None.

    Args:
        app: what comes behind.
        settings: the limits.
        guard: gives the guard, once the server is open; None where everybody may pass.
    """

    def __init__(self, app: ASGIApp, settings: Settings, guard: Callable[[], Guard | None]) -> None:
        self._app = app
        self._guard = guard
        self._max_body_nbytes = settings.max_body_nbytes
        self._max_target_nbytes = settings.max_target_nbytes
        self._max_header_count = settings.max_header_count

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one ASGI scope."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        try:
            self._require_short(scope)
            _require_plain_path(scope)
            guard = self._guard()
            access = guard.admit(scope) if guard is not None else None
            receive = await self._body_within_limit(scope, receive)
        except OctobrickError as error:
            await error_reply(error)(scope, receive, send)
            return
        state = scope.setdefault("state", {})
        state["access"] = access
        peer = scope.get("client")
        state["client"] = access.client if access else peer[0] if peer else "unknown"
        await self._app(scope, receive, send)

    def _require_short(self, scope: Scope) -> None:
        nbytes = len(scope.get("raw_path") or b"") + len(scope["query_string"])
        if nbytes > self._max_target_nbytes:
            raise AddressTooLongError(
                f"The address has {nbytes} bytes; this server accepts {self._max_target_nbytes}",
                limit_name="max_target_nbytes",
                limit=self._max_target_nbytes,
                value=nbytes,
            )
        count = len(scope["headers"])
        if count > self._max_header_count:
            raise HeadersTooLongError(
                f"The request has {count} headers; this server accepts {self._max_header_count}",
                limit_name="max_header_count",
                limit=self._max_header_count,
                value=count,
            )

    async def _body_within_limit(self, scope: Scope, receive: Receive) -> Receive:
        """Take in the whole body, which is short or refused; returns where to read it from."""
        announced = transfer = None
        for name, value in scope["headers"]:
            if name == b"content-length":
                announced = value
            elif name == b"transfer-encoding":
                transfer = value
        if announced is None and transfer is None:
            return receive
        if announced is not None and (not announced.isdigit() or len(announced) > 18):
            raise InvalidInputError("The Content-Length header is not a whole number")
        self._require_length(int(announced or 0))
        messages: deque[Message] = deque()
        nbytes, more = 0, True
        while more:
            message = await receive()
            if message["type"] == "http.disconnect":
                raise ClientGoneError
            messages.append(message)
            nbytes += len(message.get("body", b""))
            self._require_length(nbytes)
            more = message.get("more_body", False)

        async def replay() -> Message:
            return messages.popleft() if messages else await receive()

        return replay

    def _require_length(self, nbytes: int) -> None:
        if nbytes > self._max_body_nbytes:
            raise LimitError(
                f"The request body has {nbytes} bytes or more; this server accepts "
                f"{self._max_body_nbytes}",
                limit_name="max_body_nbytes",
                limit=self._max_body_nbytes,
                value=nbytes,
            )


def _require_plain_path(scope: Scope) -> None:
    raw_path = scope.get("raw_path") or b""
    if b"%" not in raw_path and b"\\" not in raw_path:  # nearly always, and sooner known
        return
    if _ENCODED_SEPARATOR.search(raw_path):
        raise InvalidInputError(
            "The path holds an encoded slash, backslash, percent sign or NUL; no address here does"
        )
