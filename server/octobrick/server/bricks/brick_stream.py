"""Many bricks in one body, a few at a time, as the client takes them.

docs/spec/brick-stream.md has the format. What the system has in memory is read in the event loop,
which spares a way to another thread and back for each group of bricks. From the first brick on that
would have to wait for a disk, the reader threads read, one group while the one before it is sent.
When the client does not take what it has, nothing more is read.
"""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import AsyncIterator, Callable
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field
from typing import Any, Final

from starlette.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from octobrick.codec.errors import OctobrickError
from octobrick.server.catalog import OpenVolume
from octobrick.server.errors import InternalError, RevisionGoneError, public_view
from octobrick.store.brick_stream import (
    ERROR_NBYTES_MAX,
    MEDIA_TYPE,
    Kind,
    Status,
    pack_end,
    pack_header,
    pack_record,
)

logger = logging.getLogger(__name__)

GROUP_NBYTES: Final = 262_144
"""A group ends with the brick that reaches this: some large ones, or some hundred small ones, share
the cost of going to another thread and back. A thousand clients that take nothing hold half a
GB."""
GROUP_NOW_NBYTES: Final = 393_216
"""The same where no other group is read meanwhile."""
GROUP_BRICKS: Final = 128

Place = tuple[int, int, int, int, int, int]
"""Level, t, c, z, y, x."""


@dataclass(slots=True, eq=False)
class BrickStream:
    """The bricks of one answer.

    Args:
        lent: the volume, borrowed for as long as the stream lives.
        give_back: returns it; called once, when no thread reads any more.
        kind: of the bricks.
        places: of each brick, all of which the volume has.
        readers: threads to read in.
    """

    lent: OpenVolume
    give_back: Callable[[], None]
    kind: Kind
    places: list[Place]
    readers: Executor
    _reading: Future[tuple[bytes, int]] | None = field(default=None, init=False)
    _gone: bool = field(default=False, init=False)
    _closed: bool = field(default=False, init=False)
    _told: bool = field(default=False, init=False)

    async def pieces(self) -> AsyncIterator[bytes]:
        """The body, piece by piece; the first one has one brick, so that it comes at once."""
        yield pack_header(self.kind, len(self.places))
        count = len(self.places)
        start, stop = 0, min(count, 1)
        while start < count:
            found = None if self._reading is not None else self._group_now(start, stop)
            if found is not None:
                piece, start = found
                await asyncio.sleep(0)  # others want the event loop, too
            else:
                if self._reading is None:
                    self._read(start, stop)
                assert self._reading is not None
                piece, start = await asyncio.wrap_future(self._reading)
                self._reading = None
                self._read(start, min(count, start + GROUP_BRICKS))
            stop = min(count, start + GROUP_BRICKS)
            yield piece
        yield pack_end(count)

    def close(self) -> None:
        """Stop: what is not read yet never is. The volume goes back when the last read ends."""
        if self._closed:
            return
        self._closed = True
        if self._reading is None:
            self.give_back()
        elif not self._reading.cancel():
            self._reading.add_done_callback(lambda _: self.give_back())
        else:
            self.give_back()

    def _read(self, start: int, stop: int) -> None:
        if start < len(self.places):
            self._reading = self.readers.submit(self._group, start, stop)

    def _group_now(self, start: int, stop: int) -> tuple[bytes, int] | None:
        """What `_group` gives, of bricks in memory; None where it has to wait or to explain."""
        parts: list[bytes] = []
        nbytes, index = 0, start
        while index < stop and nbytes < GROUP_NOW_NBYTES:
            level, t, c, z, y, x = self.places[index]
            try:
                stored = self._bricks.stored_brick_now(level, (z, y, x), t, c)
            except (BlockingIOError, OctobrickError):
                break
            status = Status.ABSENT if stored is None else Status.STORED
            parts += pack_record(index, status, bytes(stored or b""))
            nbytes += len(parts[-1])
            index += 1
        return (b"".join(parts), index) if parts and self.lent.is_current() else None

    def _group(self, start: int, stop: int) -> tuple[bytes, int]:
        """The records from an index on, and the index after the last of them; in a thread."""
        parts: list[bytes] = []
        nbytes, index = 0, start
        while index < stop and nbytes < GROUP_NBYTES and not self._closed:
            status, payload = (Status.FAILED, b"") if self._gone else self._brick(index)
            parts += pack_record(index, status, payload)
            nbytes += len(payload)
            index += 1
        # What was read may be of another revision, unless the volume is still there as it was.
        if self._gone or not self.lent.is_current():
            self._gone = True
            gone = _as_json(self._replaced())
            parts = [part for i in range(start, index) for part in pack_record(i, *gone)]
        return b"".join(parts), index

    @property
    def _bricks(self) -> Any:
        """What gives bricks of the kind."""
        return self.lent.volume if self.kind is Kind.VOXELS else self.lent.volume.gradients

    def _brick(self, index: int) -> tuple[Status, bytes]:
        level, t, c, z, y, x = self.places[index]
        try:
            stored = self._bricks.stored_brick(level, (z, y, x), t, c)
        except OctobrickError as error:
            if not self._told and self.lent.is_current():  # a damaged shard holds many of them
                self._told = True
                logger.error("%s: %s", error.kind, error.message)
            return _as_json(error)
        except Exception:
            logger.exception("brick %s cannot be read", self.places[index])
            return _as_json(InternalError("The server met an unexpected error; its log says which"))
        return (Status.ABSENT, b"") if stored is None else (Status.STORED, stored)

    def _replaced(self) -> RevisionGoneError:
        return RevisionGoneError(
            "The volume was replaced while its bricks were sent; fetch its metadata again",
            revision=self.lent.volume.revision,
        )


class BrickStreamResponse(StreamingResponse):
    """Sends a stream, and closes it however that ends: the client may leave at any time."""

    def __init__(self, stream: BrickStream) -> None:
        headers = {
            "cache-control": "no-store",
            "x-octobrick-revision": stream.lent.volume.revision,
            "x-accel-buffering": "no",  # nginx: hand on the first brick before the last one is read
        }
        super().__init__(stream.pieces(), headers=headers, media_type=MEDIA_TYPE)
        self._stream = stream

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one ASGI scope."""
        try:
            await super().__call__(scope, receive, send)
        finally:
            self._stream.close()


def _as_json(error: OctobrickError) -> tuple[Status, bytes]:
    payload = _utf8(public_view(error))
    if len(payload) > ERROR_NBYTES_MAX:
        payload = _utf8(public_view(InternalError("The error is too long to be told here")))
    return Status.FAILED, payload


def _utf8(document: Any) -> bytes:
    return json.dumps(document, separators=(",", ":")).encode()
