"""A progressive picture as one answer: multipart, each part a picture that replaces the last.

``multipart/x-mixed-replace``, because browsers show it in ``<img>`` as it comes, and whatever reads
``multipart/mixed`` reads it too: RFC 2046, 5.1.7, has unknown kinds of multipart taken for that.
"""

from __future__ import annotations

import secrets
from collections.abc import AsyncIterator, Awaitable, Callable

from starlette.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from octobrick.codec.errors import OctobrickError
from octobrick.server.error_replies import error_reply, internal_error_reply
from octobrick.server.errors import ClientGoneError

Part = tuple[dict[str, str], bytes, bool]
"""Headers, body, and whether it is the last one."""


class PartsReply(StreamingResponse):
    """The answer; it ends where the client leaves.

    Args:
        parts: as they come.
        headers: of the whole.
        at_end: called when nothing more will be sent, whyever.
    """

    def __init__(
        self,
        parts: AsyncIterator[Part],
        headers: dict[str, str],
        at_end: Callable[[], Awaitable[None]],
    ) -> None:
        boundary = f"octobrick-{secrets.token_hex(16)}"  # in no part, but for a chance of 2^-128
        self._at_end = at_end
        super().__init__(
            multipart_body(parts, boundary),
            headers=headers,
            media_type=f"multipart/x-mixed-replace; boundary={boundary}",
        )

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:  # noqa: ARG002
        """Send it. The parts themselves tell when the client is gone."""
        try:
            await self.stream_response(send)
        except ClientGoneError:
            pass
        finally:
            await self._at_end()


async def multipart_body(parts: AsyncIterator[Part], boundary: str) -> AsyncIterator[bytes]:
    """The body: parts as they come, and where one fails its error as the last one.

    The line that ends a part is sent with it, not before the next one: browsers show a part only
    when they have seen its end. Chromium waits for the headers of the next one, too, so a part that
    is not the last is sent twice; the second time it replaces itself.
    """
    yield f"--{boundary}\r\n".encode()
    try:
        async for headers, content, last in parts:
            part = _part(headers, content, boundary, last=last)
            yield part if last else part + part
    except ClientGoneError:
        raise
    except OctobrickError as error:
        yield _error_part(bytes(error_reply(error).body), boundary)
    except Exception as error:
        yield _error_part(bytes(internal_error_reply(error).body), boundary)


def _part(headers: dict[str, str], content: bytes, boundary: str, *, last: bool) -> bytes:
    lines = [f"{name}: {value}" for name, value in headers.items()]
    head = "\r\n".join([*lines, f"content-length: {len(content)}", "", ""]).encode()
    return head + content + f"\r\n--{boundary}{'--' if last else ''}\r\n".encode()


def _error_part(content: bytes, boundary: str) -> bytes:
    return _part({"content-type": "application/json"}, content, boundary, last=True)
