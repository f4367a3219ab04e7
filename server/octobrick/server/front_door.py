"""What every request passes before any route: plain ASGI, so that it costs microseconds."""

from __future__ import annotations

import re
from collections import deque

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from octobrick.codec.errors import InvalidInputError, OctobrickError
from octobrick.server.error_replies import error_reply, internal_error_reply
from octobrick.server.errors import LimitError

# Octets that some layer could take for a separator or an end once they are decoded: / \ % NUL.
_ENCODED_SEPARATOR = re.compile(rb"%(2f|5c|25|00)|\\", re.IGNORECASE)

ADDED_HEADERS = [(b"x-content-type-options", b"nosniff")]  # to every answer


class FrontDoor:
    """Refuses odd paths and long bodies, adds the security header, answers unexpected errors.

    Args:
        app: what comes behind.
        max_body_nbytes: longer request bodies are refused, announced or not.
    """

    def __init__(self, app: ASGIApp, max_body_nbytes: int) -> None:
        self._app = app
        self._max_body_nbytes = max_body_nbytes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one ASGI scope."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        started = False

        async def send_with_header(message: Message) -> None:
            nonlocal started
            if message["type"] == "http.response.start":
                started = True
                message["headers"] = [*message.get("headers", ()), *ADDED_HEADERS]
            await send(message)

        try:
            _require_plain_path(scope)
            receive = await self._body_within_limit(scope, receive)
            await self._app(scope, receive, send_with_header)
        except Exception as error:
            if started:  # too late for another answer: the server cuts the connection
                raise
            if isinstance(error, OctobrickError):
                reply = error_reply(error)
            else:
                reply = internal_error_reply(error)
            await reply(scope, receive, send_with_header)

    async def _body_within_limit(self, scope: Scope, receive: Receive) -> Receive:
        """Take in the whole body, which is short or refused; returns where to read it from."""
        announced = _header(scope, b"content-length")
        if announced is None and _header(scope, b"transfer-encoding") is None:
            return receive
        if announced is not None and (not announced.isdigit() or len(announced) > 18):
            raise InvalidInputError("The Content-Length header is not a whole number")
        self._require_length(int(announced or 0))
        messages: deque[Message] = deque()
        nbytes, more = 0, True
        while more:
            message = await receive()
            messages.append(message)
            nbytes += len(message.get("body", b""))
            self._require_length(nbytes)
            more = message["type"] == "http.request" and message.get("more_body", False)

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
    if _ENCODED_SEPARATOR.search(raw_path):
        raise InvalidInputError(
            "The path holds an encoded slash, backslash, percent sign or NUL; no address here does"
        )


def _header(scope: Scope, name: bytes) -> bytes | None:
    return next((value for key, value in scope["headers"] if key == name), None)
