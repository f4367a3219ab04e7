"""The bricks of a volume on a server: from the disk cache, one by one, or many in a stream."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final

from octobrick.codec.errors import CorruptBrickError, InvalidInputError, OctobrickError
from octobrick.store import frame as zstd_frame
from octobrick.store.box import Zyx
from octobrick.store.brick_cache import BrickCache
from octobrick.store.brick_stream import (
    BrickStreamReader,
    Kind,
    Record,
    Status,
    stored_nbytes_max,
)
from octobrick.store.errors import BrickStreamError, ServerUnreachableError
from octobrick.store.http_address import VolumeAddress
from octobrick.store.http_link import Answer, HttpLink, Incoming, TransientError
from octobrick.store.server_error import error_of_fields

Place = tuple[int, Zyx, int, int]
"""Level, (z, y, x), time step, channel."""

BATCH_MAX: Final = 256
"""Bricks in one request; what more there are is asked for next."""


class RemoteBricks:
    """Bricks of one kind and revision, each checked. Safe to use from several threads.

    Args:
        link: to the server.
        address: of the volume.
        revision: of the volume.
        kind: voxels, or directions of gradients.
        cache: where bricks are kept.
        code_nbytes_max: the most bytes that a code takes at a level.
        decompressed: takes the entropy layer off a stored brick of a level, and checks it.
    """

    def __init__(
        self,
        link: HttpLink,
        address: VolumeAddress,
        revision: str,
        kind: Kind,
        cache: BrickCache,
        code_nbytes_max: Callable[[int], int],
        decompressed: Callable[[bytes, int], bytes],
    ) -> None:
        self.link, self.address, self.kind, self.cache = link, address, kind, cache
        self._revision = revision
        self._code_nbytes_max = code_nbytes_max
        self._decompressed = decompressed
        self.batch_max = BATCH_MAX

    def stored(self, place: Place) -> bytes | None:
        """A brick as it is stored, one zstd frame; None where it is absent."""
        kept = self.cache.get(self._key(place))
        return kept.payload if kept is not None else self._fetched(place)[0]

    def code(self, place: Place) -> bytes | None:
        """A brick without the entropy layer; None where it is absent."""
        found, code = self.kept_code(place)
        return code if found else self._fetched(place)[1]

    def kept_code(self, place: Place) -> tuple[bool, bytes | None]:
        """Whether a brick is in the cache, and its code."""
        kept = self.cache.get(self._key(place))
        if kept is None:
            return False, None
        if kept.payload is None:
            return True, None
        try:
            return True, self._decompressed(kept.payload, place[0])
        except CorruptBrickError:
            self.cache.drop(self._key(place))
            return False, None

    def where(self, place: Place) -> str:
        """The address of a brick, for messages."""
        return self.address.shown(self._path(place))

    def batch(self, places: Sequence[Place]) -> BrickBatch:
        """Codes of many bricks, as they come."""
        return BrickBatch(self, places)

    def request(self, places: Sequence[Place]) -> bytes:
        """What is asked for to get a stream of bricks."""
        asked = [[level, t, c, *zyx] for level, zyx, t, c in places]
        body = {"revision": self._revision, "kind": self.kind.name.lower(), "bricks": asked}
        return json.dumps(body, separators=(",", ":")).encode()

    def reader(self, places: Sequence[Place]) -> BrickStreamReader:
        """What takes that stream."""
        return BrickStreamReader(self.kind, len(places), lambda i: self._nbytes_max(places[i]))

    def received(self, place: Place, record: Record) -> bytes | None:
        """The code of a brick of a stream, which is kept if it is good, else asked for again.

        Raises:
            OctobrickError: what the server says of it, or that it came damaged twice.
        """
        if record.status is Status.FAILED:
            raise error_of_fields(record.error(), self.where(place))
        if record.status is Status.ABSENT:
            self.cache.put(self._key(place), None)
            return None
        try:
            code = self._decompressed(record.payload, place[0])
        except CorruptBrickError:
            return self._fetched(place, tries=1)[1]
        self.cache.put(self._key(place), record.payload)
        return code

    def _fetched(self, place: Place, tries: int = 2) -> tuple[bytes | None, bytes | None]:
        """A brick and its code from the server; a damaged one is fetched once more."""
        while True:
            answer = self.link.get(self._path(place), self._nbytes_max(place))
            tries -= 1
            try:
                frame = self._frame(answer, place)
                code = None if frame is None else self._decompressed(frame, place[0])
            except CorruptBrickError as error:
                if tries > 0:
                    continue
                level, zyx, t, c = place
                raise CorruptBrickError(
                    f"{self.where(place)}: the brick came damaged twice: {error.message}; the "
                    "server's copy or what lies between needs mending",
                    **error.facts | {"level": level, "brick": [t, c, *zyx]},
                ) from error
            self.cache.put(self._key(place), frame)
            return frame, code

    def _frame(self, answer: Answer, place: Place) -> bytes | None:
        if answer.status == 204:
            return None
        if answer.encoding == "identity":  # a proxy took it off
            return zstd_frame.compress(answer.body, level=1)
        if answer.encoding != "zstd":
            raise ServerUnreachableError(
                f"{self.where(place)}: comes as {answer.encoding!r:.40}, which was not asked for; "
                "check what lies between you and the server"
            )
        return answer.body

    def _nbytes_max(self, place: Place) -> int:
        return stored_nbytes_max(self._code_nbytes_max(place[0]))

    def _path(self, place: Place) -> str:
        route = "bricks" if self.kind is Kind.VOXELS else "gradients"
        return self.address.brick_path(self._revision, route, *place)

    def _key(self, place: Place) -> str:
        level, (z, y, x), t, c = place
        return f"{self._revision} {self.kind.name} {level} {t} {c} {z} {y} {x}"


class BrickBatch:
    """Many bricks, each given as (place in the list, code or error) once it is here.

    Those in the cache come first, then the others, both in the order asked for. One thread takes
    them; any may close it, which wakes the one that waits.

    Raises:
        OctobrickError: the server cannot be reached any more; of one brick it is given, not raised.
    """

    def __init__(self, bricks: RemoteBricks, places: Sequence[Place]) -> None:
        self._bricks, self._places = bricks, places
        self._closed = threading.Event()
        self._incoming: Incoming | None = None
        self._lock = threading.Lock()

    def close(self) -> None:
        """Give no more. Never waits; idempotent."""
        with self._lock:
            self._closed.set()
            if self._incoming is not None:
                self._incoming.cut_off()

    def __iter__(self) -> Iterator[tuple[int, bytes | OctobrickError | None]]:
        missing: list[int] = []
        for number, place in enumerate(self._places):
            if self._closed.is_set():
                return
            found, code = self._bricks.kept_code(place)
            if found:
                yield number, code
            else:
                missing.append(number)
        retries = self._bricks.link.retries()
        while missing and not self._closed.is_set():
            asked = missing[: self._bricks.batch_max]
            came = 0
            try:
                for number, outcome in self._stream(asked):
                    came += 1
                    retries.progressed()
                    yield number, outcome
            except TransientError as failure:
                if self._closed.is_set():
                    return
                if not came:
                    retries.wait_after(failure.error, failure.asked_seconds)
            except InvalidInputError as error:
                if error.kind != "too-large" or len(asked) == 1:
                    raise
                self._bricks.batch_max = len(asked) // 2  # the server's limit is lower
            missing = missing[came:]

    def _stream(self, asked: Sequence[int]) -> Iterator[tuple[int, bytes | OctobrickError | None]]:
        bricks = self._bricks
        places = [self._places[number] for number in asked]
        reader = bricks.reader(places)
        path = bricks.address.batch_path
        try:
            with bricks.link.open("POST", path, bricks.request(places)) as response:
                incoming = self._begin(response)
                deadline = time.monotonic() + bricks.link.body_seconds
                for piece in incoming.pieces():
                    for record in reader.feed(piece):
                        yield asked[record.index], self._outcome(places[record.index], record)
                        deadline = time.monotonic() + bricks.link.body_seconds
                    if self._closed.is_set():
                        return
                    if time.monotonic() > deadline:
                        raise BrickStreamError("no brick came for too long", received=0)
                reader.finish()
        except BrickStreamError as error:
            where = bricks.address.shown(path)
            raise TransientError(BrickStreamError(f"{where}: {error.message}")) from error
        finally:
            with self._lock:
                self._incoming = None

    def _begin(self, response: Any) -> Incoming:
        incoming = Incoming(response)
        with self._lock:
            self._incoming = incoming
            if self._closed.is_set():
                incoming.cut_off()
        return incoming

    def _outcome(self, place: Place, record: Record) -> bytes | OctobrickError | None:
        try:
            return self._bricks.received(place, record)
        except OctobrickError as error:
            if error.kind == "revision-gone":
                raise
            return error


def codes_of(places: Sequence[Place], batch: BrickBatch) -> Iterator[tuple[Place, bytes | None]]:
    """Places and codes of a batch of which every brick is needed, each once it is here.

    Raises:
        OctobrickError: of the first brick that has one; no more of the others comes then.
    """
    try:
        for number, code in batch:
            if isinstance(code, OctobrickError):
                raise code
            yield places[number], code
    finally:
        batch.close()
