"""Flat voxels in gzip or zlib data, decoded forward with bounded memory.

Deflate data have no index: to reach byte n, all before it must be decoded. The reader therefore
leaves *marks* on its way, snapshots of the decoder (about 40 KiB each, its 32 KiB window above
all), and going back resumes at the last mark before the place asked for. With 64 marks the way
back costs at most 1/64 of the data.
"""

from __future__ import annotations

import math
import os
import threading
import zlib
from bisect import bisect_right
from copy import copy
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy.typing as npt

from octobrick.store.box import Box
from octobrick.store.errors import SourceError, TruncatedSourceError
from octobrick.store.sources.base import Description
from octobrick.store.sources.flat import FlatSource, Layout
from octobrick.store.sources.head import (
    GZIP_MAGIC,
    GZIP_OR_ZLIB_WBITS,
    open_file,
    require_file,
)

if TYPE_CHECKING:
    from zlib import _Decompress

_INPUT_NBYTES = 1 << 16
_OUTPUT_NBYTES = 1 << 18
_MARKS = 64
# Readers that go forward at once, a third of a megabyte each.
_MOST_READERS = 16
# Deflate's densest code is one bit for each half of a 258-byte copy: 1032 to 1, no more.
_MAX_EXPANSION = 1032
# Bytes after the last voxel that are still decoded to reach the checksum behind them.
_SURPLUS_LIMIT_NBYTES = 1 << 26


@dataclass(frozen=True, slots=True)
class _Mark:
    """The state of the decoder before it decodes byte ``position``."""

    position: int
    input_position: int
    inflater: _Decompress
    crc32: int


class GzipReader:
    """The bytes inside gzip (one member or many) or zlib data; not safe from several threads.

    Args:
        path: the file.
        start_nbytes: where the compressed data begin in it.
        expected_nbytes: how many decompressed bytes will be wanted; marks are spread over them,
            and errors name them.
        crc32: of plain deflate data, without a wrapping, the checksum that they shall have.
    """

    def __init__(
        self, path: Path, start_nbytes: int, expected_nbytes: int, crc32: int | None = None
    ) -> None:
        self._path = path
        self._expected_nbytes = expected_nbytes
        self._file = open_file(path)
        self._mark_step = max(_OUTPUT_NBYTES, expected_nbytes // _MARKS)
        self._expected_crc32 = crc32
        wbits = GZIP_OR_ZLIB_WBITS if crc32 is None else -zlib.MAX_WBITS
        self._marks = [_Mark(0, start_nbytes, zlib.decompressobj(wbits), 0)]
        self._ready = memoryview(b"")  # decoded, not yet asked for
        self._resume(self._marks[0])

    @property
    def position(self) -> int:
        """The decompressed byte that comes next."""
        return self._decoded_nbytes - len(self._ready)

    def seek(self, position: int) -> None:
        """Go to a decompressed byte: forward by decoding, back to a mark and then forward."""
        if position < self.position:
            self.rewind(position)
        while self.position < position:
            self._require_ready()
            self._ready = self._ready[min(position - self.position, len(self._ready)) :]

    def rewind(self, position: int) -> None:
        """Go to the last mark before a position."""
        at = bisect_right(self._marks, position, key=lambda mark: mark.position)
        self._resume(self._marks[at - 1])

    def fork(self) -> GzipReader:
        """Another reader of the same data and file, at their start; both use the marks of each."""
        other = copy(self)
        other._resume(self._marks[0])
        return other

    def distance(self, position: int, *, by_mark: bool) -> float:
        """Bytes to decode up to a position, from a mark or from here; infinite if it is behind."""
        if by_mark:
            at = bisect_right(self._marks, position, key=lambda mark: mark.position)
            return position - self._marks[at - 1].position
        return position - self.position if position >= self.position else math.inf

    def readinto(self, into: memoryview) -> None:
        """Fill ``into`` with the bytes that come next.

        Raises:
            TruncatedSourceError: the data end before that.
            SourceError: the data are damaged.
        """
        while into:
            self._require_ready()
            nbytes = min(len(into), len(self._ready))
            into[:nbytes] = self._ready[:nbytes]
            into, self._ready = into[nbytes:], self._ready[nbytes:]

    def drain(self, limit_nbytes: int) -> int:
        """Decode on to the checksum at the end, for at most about ``limit_nbytes``; count bytes.

        Raises:
            SourceError: what remains is damaged, cut off, or does not fit the checksum.
        """
        nbytes = len(self._ready)
        self._ready = memoryview(b"")
        while nbytes < limit_nbytes and (data := self._decode()):
            nbytes += len(data)
        return nbytes

    def close(self) -> None:
        """Let go of the file."""
        self._file.close()

    def _resume(self, mark: _Mark) -> None:
        self._inflater = mark.inflater.copy()
        self._input_position = mark.input_position
        self._pending = b""  # read from the file, not yet given to the decoder
        self._decoded_nbytes = mark.position
        self._crc32 = mark.crc32
        self._ready = memoryview(b"")
        self._ended = False

    def _require_ready(self) -> None:
        if not self._ready:
            self._ready = memoryview(self._decode())
            if not self._ready:
                raise self._truncated()

    def _decode(self) -> bytes:
        """Decode some of what comes next; nothing once the data have ended with a checksum."""
        self._leave_mark()
        while not self._ended:
            at_end_of_file = not self._fill(1)
            try:
                data = self._inflater.decompress(self._pending, _OUTPUT_NBYTES)
            except zlib.error as error:
                raise self._damaged(error) from error
            self._pending = self._inflater.unconsumed_tail
            if self._expected_crc32 is not None:
                self._crc32 = zlib.crc32(data, self._crc32)
            if self._inflater.eof:
                self._begin_next_member(self._inflater.unused_data)
            elif at_end_of_file and not data:
                raise self._truncated()
            if data:
                self._decoded_nbytes += len(data)
                return data
        return b""

    def _begin_next_member(self, rest: bytes) -> None:
        """A gzip file may be several in a row; anything else after the data is not ours."""
        if self._expected_crc32 is not None:
            self._ended = True
            if self._crc32 != self._expected_crc32:
                raise self._damaged(
                    f"their CRC-32 is {self._crc32:08x}, not {self._expected_crc32:08x}"
                )
            return
        self._pending = rest
        if self._fill(len(GZIP_MAGIC)) and self._pending.startswith(GZIP_MAGIC):
            self._inflater = zlib.decompressobj(GZIP_OR_ZLIB_WBITS)
        else:
            self._ended = True

    def _fill(self, nbytes: int) -> bool:
        """Have at least ``nbytes`` compressed bytes pending, if the file has them."""
        while len(self._pending) < nbytes:
            try:
                data = os.pread(self._file.fileno(), _INPUT_NBYTES, self._input_position)
            except OSError as error:
                raise self._damaged(error) from error
            if not data:
                return False
            self._input_position += len(data)
            self._pending += data
        return True

    def _leave_mark(self) -> None:
        due = self._marks[-1].position + self._mark_step
        if due <= self._decoded_nbytes < self._expected_nbytes and not self._ended:
            unread = self._input_position - len(self._pending)
            mark = _Mark(self._decoded_nbytes, unread, self._inflater.copy(), self._crc32)
            self._marks.append(mark)

    def _truncated(self) -> TruncatedSourceError:
        have, expected = self._decoded_nbytes, self._expected_nbytes
        what = f"end after {have} of {expected} bytes"
        if have >= expected:
            what = f"end after all {expected} bytes but before the checksum that proves them"
        return TruncatedSourceError(
            f"{self._path}: compressed data {what}; "
            "copy or export the file again, or correct the sizes given for it",
            path=str(self._path),
            expected_nbytes=expected,
            actual_nbytes=have,
        )

    def _damaged(self, error: Exception | str) -> SourceError:
        return SourceError(
            f"{self._path}: compressed data are damaged after {self._decoded_nbytes} of "
            f"{self._expected_nbytes} bytes ({error}); copy or export the file again",
            path=str(self._path),
            expected_nbytes=self._expected_nbytes,
            actual_nbytes=self._decoded_nbytes,
            reason=str(error),
        )


class GzipSource(FlatSource):
    """A source whose voxels are in gzip, zlib or deflate data.

    That the data are whole is known only at their end: reading the last voxel also checks the
    checksum behind it. Boxes of whole planes going up in z are read in one pass.

    Raises:
        TruncatedSourceError: the file is so short that no data of this shape can be in it.
        SourceNotFoundError: the file of the voxels does not exist.
    """

    _skips_cost = True

    def __init__(self, path: Path, description: Description, layout: Layout) -> None:
        super().__init__(path, description, layout)
        size = require_file(layout.path, named_by=None if layout.path == path else path)
        self._end = layout.offset_nbytes + layout.nbytes_of(description)
        most = max(0, size - layout.stream_offset_nbytes) * _MAX_EXPANSION
        if most < self._end:
            raise TruncatedSourceError(
                f"{layout.path}: {self._end} bytes are asked for, but {size} compressed "
                f"bytes hold {most} at the very most; copy or export the file again, "
                "or correct the sizes given for it",
                path=str(layout.path),
                expected_nbytes=self._end,
                actual_nbytes=most,
            )
        self._checked = False
        self._lock = threading.Lock()
        reader = GzipReader(
            layout.path, layout.stream_offset_nbytes, self._end, layout.deflate_crc32
        )
        self._readers = [reader]  # the one that was used last is the last
        self._most_readers = min(description.nc, _MOST_READERS)

    @property
    def ascending(self) -> bool:
        """True: going down in z decodes again from the last mark before."""
        return True

    def _read_samples(self, box: Box, t: int, c: int, nc: int) -> npt.NDArray[Any]:
        with self._lock:
            return super()._read_samples(box, t, c, nc)

    def _read_at(self, position: int, into: memoryview) -> None:
        reader = self._reader_near(position)
        reader.seek(position)
        reader.readinto(into)
        if reader.position == self._end and not self._checked:
            surplus = reader.drain(_SURPLUS_LIMIT_NBYTES)
            self._checked = True
            if surplus:
                self.warnings += (
                    f"{surplus} bytes or more follow the last voxel; check the sizes",
                )

    def _reader_near(self, position: int) -> GzipReader:
        """The reader that has least to decode up to a position.

        Channels that lie behind each other come to have a reader each, so that reading slabs of
        all of them decodes each channel once, not from a mark for every slab.
        """
        readers = self._readers
        nearest = min(readers, key=lambda reader: reader.distance(position, by_mark=False))
        here = nearest.distance(position, by_mark=False)
        if nearest.distance(position, by_mark=True) < here:  # then by a reader to spare
            nearest = readers[0]
            if len(readers) < self._most_readers:
                nearest = nearest.fork()
                readers.append(nearest)
            nearest.rewind(position)
        readers.remove(nearest)
        readers.append(nearest)
        return nearest

    def _close(self) -> None:
        self._readers[0].close()  # all of them have one file
