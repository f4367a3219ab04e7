"""The brick stream: many stored bricks in one body, each checked, whole or known to be cut off.

docs/spec/brick-stream.md has the layout. This is the format alone: what a server packs, and a
reader that takes the bytes as they come. Neither reads files or sockets.
"""

from __future__ import annotations

import json
import struct
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final

import google_crc32c

from octobrick.store.errors import BrickStreamError

MEDIA_TYPE: Final = "application/vnd.octobrick.bricks"
MAGIC: Final = b"OBKS"
VERSION: Final = 1
ERROR_NBYTES_MAX: Final = 65_536
COUNT_MAX: Final = 2**32 - 1

_HEADER: Final = struct.Struct("<4sBBHII")
_RECORD: Final = struct.Struct("<IB3sII")
HEADER_NBYTES: Final = _HEADER.size
RECORD_NBYTES: Final = _RECORD.size
_NO_PADDING: Final = bytes(3)
_SMALL_NBYTES: Final = 4096
_ZSTD_MAGIC: Final = b"\x28\xb5\x2f\xfd"


class Kind(IntEnum):
    """What the bricks of a stream hold."""

    VOXELS = 0
    GRADIENTS = 1


class Status(IntEnum):
    """What became of one brick."""

    STORED = 0
    ABSENT = 1
    FAILED = 2
    END = 255


@dataclass(frozen=True, slots=True)
class Record:
    """One brick of a stream.

    Attributes:
        index: its place in the list that was asked for.
        status: STORED, ABSENT or FAILED.
        payload: one zstd frame, whose own checksum is not looked at here; of a failed brick the
            error as JSON; empty of an absent one.
    """

    index: int
    status: Status
    payload: bytes

    def error(self) -> dict[str, Any]:
        """The `kind`, `message` and `facts` of a failed brick."""
        fields: dict[str, Any] = json.loads(self.payload)["error"]
        return fields


def pack_header(kind: Kind, count: int) -> bytes:
    """The first bytes of a stream of so many bricks."""
    return _HEADER.pack(MAGIC, VERSION, kind, 0, count, 0)


def pack_record(index: int, status: Status, payload: bytes = b"") -> tuple[bytes, bytes]:
    """A record as its head and its payload, which is not copied."""
    head = _RECORD.pack(index, status, _NO_PADDING, len(payload), google_crc32c.value(payload))
    return head, payload


def pack_end(count: int) -> bytes:
    """The last record."""
    return _RECORD.pack(count, Status.END, _NO_PADDING, 0, 0)


def stored_nbytes_max(code_nbytes_max: int) -> int:
    """The most bytes of a zstd frame around a code of so many: what a reader lets a record have.

    zstd adds 3 bytes to each 128 KiB that it cannot compress, and at most 22 to the whole.
    """
    return code_nbytes_max + (code_nbytes_max >> 12) + 1024


class BrickStreamReader:
    """Takes a stream in pieces of any size and gives its records, each of which was checked.

    Holds the pieces that one record came in, with what else is in the first and last of them. Not
    thread-safe.

    Args:
        kind: that was asked for.
        count: bricks that were asked for.
        nbytes_max: the most bytes that the stored brick at a place in the list can have, as
            `stored_nbytes_max` tells.
    """

    def __init__(self, kind: Kind, count: int, nbytes_max: Callable[[int], int]) -> None:
        self._kind, self._count, self._nbytes_max = kind, count, nbytes_max
        self._pending = _Pending()
        self._has_header = False
        self._head: tuple[int, Status, int, int] | None = None  # of the record that is coming
        self._next = 0
        self._ended = False

    @property
    def ended(self) -> bool:
        """Whether the end record was read."""
        return self._ended

    @property
    def next_index(self) -> int:
        """The place of the record that comes next: all before it were given."""
        return self._next

    def feed(self, piece: bytes | bytearray | memoryview) -> Iterator[Record]:
        """The records that end in this piece. Take them all before the next piece.

        Raises:
            BrickStreamError: the bytes are no such stream, or damaged. Records that were given
                before are good; the stream is of no use any more.
        """
        pending = self._pending
        pending.add(piece)
        if not self._has_header:
            if pending.nbytes < HEADER_NBYTES:
                return
            self._check_header(pending.take(HEADER_NBYTES))
            self._has_header = True
        while not self._ended:
            if self._head is None:
                if pending.nbytes < RECORD_NBYTES:
                    break
                self._head = self._checked_head(pending.take(RECORD_NBYTES))
            index, status, nbytes, crc = self._head
            if pending.nbytes < nbytes:
                break
            self._head = None
            if status is Status.END:
                self._ended = True
                break
            record = self._checked_record(index, status, pending.take(nbytes), crc)
            self._next += 1
            yield record
        if self._ended and pending.nbytes:
            raise _damaged(f"{pending.nbytes} bytes or more follow the end record")

    def finish(self) -> None:
        """Say that no more bytes come.

        Raises:
            BrickStreamError: the stream was cut off.
        """
        if not self._ended:
            raise _damaged(
                f"it was cut off after {self._next} of {self._count} bricks",
                received=self._next,
                count=self._count,
            )

    def _check_header(self, header: bytes) -> None:
        magic, version, kind, zero, count, zeros = _HEADER.unpack(header)
        if magic != MAGIC:
            raise _damaged(f"it begins with {magic!r}, not with {MAGIC!r}")
        if version != VERSION:
            raise _damaged(f"it has version {version}, and this octobrick reads {VERSION}")
        if (kind, count) != (self._kind, self._count):
            raise _damaged(
                f"it holds {count} bricks of kind {kind}; {self._count} of kind "
                f"{self._kind:d} were asked for"
            )
        if zero or zeros:
            raise _damaged("reserved bytes of its header are not 0")

    def _checked_head(self, head: bytes) -> tuple[int, Status, int, int]:
        index, code, padding, nbytes, crc = _RECORD.unpack(head)
        if index != self._next:
            raise _damaged(f"record {index} comes where {self._next} should")
        try:
            status = Status(code)
        except ValueError:
            raise _damaged(f"record {index} has status {code}, which there is not") from None
        if padding != _NO_PADDING:
            raise _damaged(f"reserved bytes of record {index} are not 0")
        if (status is Status.END) != (index == self._count):
            raise _damaged(f"record {index} of {self._count} has status {code}")
        limit = self._limit(index, status)
        if nbytes > limit:
            raise _damaged(
                f"record {index} announces {nbytes} bytes; it can have {limit} at most",
                announced_nbytes=nbytes,
                limit=limit,
            )
        if status in (Status.ABSENT, Status.END) and crc:
            raise _damaged(f"record {index} has the checksum {crc:08x} of no bytes, not 0")
        return index, status, nbytes, crc

    def _limit(self, index: int, status: Status) -> int:
        if status is Status.STORED:
            return self._nbytes_max(index)
        return ERROR_NBYTES_MAX if status is Status.FAILED else 0

    def _checked_record(self, index: int, status: Status, payload: bytes, crc: int) -> Record:
        computed = google_crc32c.value(payload)
        if computed != crc:
            raise _damaged(
                f"checksum mismatch: record {index} stores {crc:08x}, its bytes give "
                f"{computed:08x}",
                stored_checksum=f"{crc:08x}",
                computed_checksum=f"{computed:08x}",
            )
        if status is Status.STORED and not payload.startswith(_ZSTD_MAGIC):
            raise _damaged(f"the payload of record {index} is not a zstd frame")
        record = Record(index, status, payload)
        if status is Status.FAILED:
            _require_error(record)
        return record


class _Pending:
    """Bytes in the order they came: a large payload is copied once, out of the pieces it came in.

    Small pieces are gathered, so that what is kept costs little more than its bytes.
    """

    def __init__(self) -> None:
        self._parts: deque[memoryview] = deque()
        self._small = bytearray()  # behind the parts
        self.nbytes = 0

    def add(self, piece: bytes | bytearray | memoryview) -> None:
        """Take a piece; what can change is copied."""
        self.nbytes += len(piece)
        if len(piece) < _SMALL_NBYTES:
            self._small += piece
            return
        self._flush()
        self._parts.append(memoryview(piece if isinstance(piece, bytes) else bytes(piece)))

    def take(self, nbytes: int) -> bytes:
        """The next bytes, of which there are so many."""
        self._flush()
        self.nbytes -= nbytes
        taken: list[memoryview] = []
        while nbytes:
            part = self._parts.popleft()
            if len(part) > nbytes:
                self._parts.appendleft(part[nbytes:])
                part = part[:nbytes]
            taken.append(part)
            nbytes -= len(part)
        return b"".join(taken)

    def _flush(self) -> None:
        if self._small:
            self._parts.append(memoryview(self._small))
            self._small = bytearray()


def _require_error(record: Record) -> None:
    try:
        fields = record.error()
        sound = isinstance(fields["kind"], str) and isinstance(fields["message"], str)
    except (ValueError, TypeError, LookupError, RecursionError):
        sound = False
    if not sound:
        raise _damaged(f"the payload of record {record.index} is not an error as JSON")


def _damaged(what: str, **facts: Any) -> BrickStreamError:
    return BrickStreamError(f"the brick stream is damaged: {what}; ask for the rest again", **facts)
