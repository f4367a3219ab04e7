"""The fast lane: well-formed requests for bricks, answered before the framework sees them.

Routing, validation and dependency injection cost several times what it takes to read a brick
from the page cache. So this plain ASGI layer answers the addresses that its pattern knows;
everything else, also a malformed address, goes on to the route of the same path, which explains
and documents. Both answer through :class:`octobrick.server.bricks.brick_reply.BrickReplies`.

What is in memory is answered in the event loop, which never waits for a disk; a thread does.
"""

from __future__ import annotations

import asyncio
import re

from starlette.types import ASGIApp, Receive, Scope, Send

from octobrick.codec.errors import OctobrickError
from octobrick.server.bricks.brick_reply import BrickAddress, BrickReply
from octobrick.server.error_replies import error_reply
from octobrick.server.services import Services

# Nine digits: beyond any grid, and short enough to turn into an integer without a thought.
_INDEX = r"([0-9]{1,9})"
_PATH = re.compile(
    r"/v1/volumes/([A-Za-z0-9][A-Za-z0-9._-]{0,127})/([0-9a-f]{1,128})/(bricks|gradients)/"
    + "/".join([_INDEX] * 6)
)


class BrickLane:
    """Answers GET and HEAD of one brick; passes all else on."""

    def __init__(self, app: ASGIApp, services: Services) -> None:
        self._app = app
        self._services = services

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one ASGI scope."""
        if scope["type"] == "http" and scope["method"] in ("GET", "HEAD"):
            address = parse_brick_path(scope["path"])
            if address is not None:
                await self._answer(address, scope, receive, send)
                return
        await self._app(scope, receive, send)

    async def _answer(
        self, address: BrickAddress, scope: Scope, receive: Receive, send: Send
    ) -> None:
        accept_encoding, if_none_match = conditions(scope)
        services = self._services
        try:
            reply = services.bricks.reply_now(address, accept_encoding, if_none_match)
            if reply is None:
                reply = await asyncio.get_running_loop().run_in_executor(
                    services.readers, services.bricks.reply, address, accept_encoding, if_none_match
                )
        except OctobrickError as error:
            await error_reply(error)(scope, receive, send)
            return
        await _send(reply, scope["method"], send)


def parse_brick_path(path: str) -> BrickAddress | None:
    """The address in a brick's path; None where it is another path, or malformed."""
    match = _PATH.fullmatch(path)
    if match is None:
        return None
    volume_id, revision, what, level, t, c, z, y, x = match.groups()
    return BrickAddress(
        volume_id,
        revision,
        int(level),
        int(t),
        int(c),
        (int(z), int(y), int(x)),
        "voxels" if what == "bricks" else "gradients",
    )


async def _send(reply: BrickReply, method: str, send: Send) -> None:
    body = b"" if method == "HEAD" else reply.body
    await send({"type": "http.response.start", "status": reply.status, "headers": reply.headers})
    await send({"type": "http.response.body", "body": body})


def conditions(scope: Scope) -> tuple[str, str]:
    """Accept-Encoding and If-None-Match, all values of each joined as RFC 9110 (5.3) allows."""
    accept_encoding = if_none_match = b""
    for name, value in scope["headers"]:
        if name == b"accept-encoding":
            accept_encoding += b"," + value if accept_encoding else value
        elif name == b"if-none-match":
            if_none_match += b"," + value if if_none_match else value
    return accept_encoding.decode("latin-1"), if_none_match.decode("latin-1")
