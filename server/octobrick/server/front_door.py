"""The first and last that a request meets: its id, its log line, its counts, its safe headers.

Plain ASGI, and one layer for all of these, so that they cost microseconds together.
"""

from __future__ import annotations

import time

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from octobrick.server.error_replies import ERROR_KIND_HEADER, internal_error_reply
from octobrick.server.errors import ClientGoneError
from octobrick.server.operations.access_log import AccessLog, Passed
from octobrick.server.operations.metrics import Metrics
from octobrick.server.operations.request_id import RequestIds, current_request_id
from octobrick.server.operations.route_label import method_label, route_label
from octobrick.server.security.cache_headers import keep_private, keep_until
from octobrick.server.security.guard import Access
from octobrick.server.security.security_headers import DEFAULT_POLICY, RawHeaders


class FrontDoor:
    """Names, counts and logs each request, and answers errors that nobody foresaw.

    Args:
        app: what comes behind.
        metrics: where requests are counted.
        access_log: where they are written down.
        headers: what every answer has.
    """

    def __init__(
        self, app: ASGIApp, metrics: Metrics, access_log: AccessLog, headers: RawHeaders
    ) -> None:
        self.app = app
        self.metrics = metrics
        self.access_log = access_log
        self.headers = headers
        self._ids = RequestIds()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one ASGI scope."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        sent = None
        for name, value in scope["headers"]:
            if name == b"x-request-id":
                sent = value
                break
        request_id = self._ids.choose(sent)
        current_request_id.set(request_id)  # of this request's task, and gone with it
        passage = _Passage(self, scope, send, request_id)
        try:
            await self.app(scope, receive, passage.send)
        except ClientGoneError:
            pass  # counted and logged as answered with nothing
        except Exception as error:
            if passage.status:  # too late for another answer: the server cuts the connection
                raise
            await internal_error_reply(error)(scope, receive, passage.send)
        finally:
            passage.finish()


class _Passage:
    """One request on its way: what is known of its answer so far."""

    __slots__ = (
        "_door", "_error_kind", "_id", "_nbytes", "_raw_path", "_scope", "_send", "_started",
        "_timing", "_whole", "status",
    )  # fmt: skip

    def __init__(self, door: FrontDoor, scope: Scope, send: Send, request_id: str) -> None:
        self._started = time.perf_counter()
        self._door = door
        self._scope = scope
        self._send = send
        self._id = request_id.encode()
        self._raw_path: bytes = scope.get("raw_path") or b""  # with a signed prefix, if any
        self._nbytes = 0
        self._whole = False
        self._error_kind = self._timing = b""
        self.status = 0

    async def send(self, message: Message) -> None:
        """Pass a message of the answer on."""
        if message["type"] == "http.response.body":
            self._nbytes += len(message.get("body", b""))
            await self._send(message)
            self._whole = not message.get("more_body", False)
            return
        if message["type"] == "http.response.start":
            self.status = message["status"]
            message["headers"] = self._headers(list(message.get("headers", ())))
        await self._send(message)

    def _headers(self, headers: RawHeaders) -> RawHeaders:
        """What the answer's headers become, having learned from them."""
        policy = [DEFAULT_POLICY]
        for i, (name, value) in enumerate(headers):
            if name == b"cache-control":
                access = self._scope.get("state", {}).get("access")
                if access is not None:
                    headers[i] = (name, _cache_control(access, value))
            elif name == b"content-security-policy":
                policy = []  # it has one of its own
            elif name == b"server-timing":
                self._timing = value
            elif name == ERROR_KIND_HEADER:
                self._error_kind = value
        return [*headers, *policy, *self._door.headers, (b"x-request-id", self._id)]

    def finish(self) -> None:
        """Count the request, and write its line if it gets one."""
        seconds = time.perf_counter() - self._started
        scope, door = self._scope, self._door
        route, method = route_label(scope["path"]), method_label(scope)
        kind = self._error_kind.decode("ascii")
        door.metrics.count_request(route, method, self.status, self._nbytes, seconds)
        if kind:
            door.metrics.count_error(kind)
        if self._timing:
            door.metrics.count_stages(self._timing.decode("latin-1"))
        cut = bool(self.status) and not self._whole
        if door.access_log.wants(route, self.status, cut):
            client = scope.get("state", {}).get("client") or _peer(scope)
            door.access_log.write(
                Passed(
                    client, method, self._raw_path, route,
                    self.status, self._nbytes, seconds, kind, cut,
                )
            )  # fmt: skip


def _cache_control(access: Access, value: bytes) -> bytes:
    if access.expires_unix is None:
        return keep_private(value)
    return keep_until(value, access.expires_unix - int(time.time()))


def _peer(scope: Scope) -> str:
    peer = scope.get("client")
    return peer[0] if peer else "unknown"
