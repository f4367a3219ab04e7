"""The grids of a NanoVDB file: where each lies, and its bytes, unpacked where they are packed.

A file is segments, each a header, a description of every grid, and the grids themselves: memory
images that begin with a magic number. What is packed is unpacked into a file without a name, so
that memory stays small whatever the size.
"""

from __future__ import annotations

import os
import struct
import tempfile
import zlib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from octobrick.codec.errors import ResourceError
from octobrick.store.errors import SourceError, TruncatedSourceError, UnsupportedSourceError
from octobrick.store.sources.head import missing_package, open_file, printable, require_file
from octobrick.store.sources.nanovdb_values import kind_name

MAGICS = (b"NanoVDB0", b"NanoVDB1", b"NanoVDB2")
GRID_NBYTES = 672  # the description at the start of a grid
MAJOR_VERSION = 32

_RAW_MAGIC = b"NanoVDB1"  # of a file that is a grid, without segments
_CODECS = ("none", "zip", "blosc")
_HEADER = struct.Struct("<8sIHH")
_META = struct.Struct("<QQ16xI100xI28xHHI")  # sizes, kind, length of the name, codec, version
_GRID = struct.Struct("<8s8xI12xQ256s")
_MOST_GRIDS = 1 << 14
_MOST_NAME_NBYTES = 1 << 16
# Deflate's limit; LZ4, which is what blosc packs with here, stays below 256.
_MOST_EXPANSION = 1032
_PIECE_NBYTES = 1 << 20
_BLOSC_CHUNK_NBYTES = 1 << 30
_BLOSC_HEADER_NBYTES = 16


class Entry(NamedTuple):
    """One grid of a file: its name, the number of its kind of values, and where it lies."""

    name: str
    kind: int
    codec: str
    start: int
    stored_nbytes: int
    nbytes: int


class GridFile:
    """The bytes of one grid, read at any place; safe from several threads."""

    def __init__(self, path: Path, entry: Entry) -> None:
        self._path = path
        self.nbytes = entry.nbytes
        self._file: BinaryIO = open_file(path)
        self._start = entry.start
        if entry.codec == "none":
            return
        try:
            self._unpack(entry)
        except BaseException:
            self.close()
            raise

    def read(self, start: int, nbytes: int) -> bytes:
        """Bytes of the grid.

        Raises:
            SourceError: they are not inside of it.
        """
        if start < 0 or start + nbytes > self.nbytes:
            raise self.damaged(f"bytes {start} to {start + nbytes} of a node lie outside of it")
        data = _pread(self._file, self._start + start, nbytes, self._path)
        if len(data) < nbytes:
            raise _truncated(self._path, self._start + start + nbytes)
        return data

    def damaged(self, reason: str) -> SourceError:
        """The error for a grid that contradicts itself."""
        return SourceError(
            f"{self._path}: the grid of {self.nbytes} bytes is damaged: {reason}; "
            "copy or export it again",
            path=str(self._path),
            reason=reason,
        )

    def close(self) -> None:
        """Let go of the file."""
        self._file.close()

    def _unpack(self, entry: Entry) -> None:
        """Put the grid into a file without a name, and read from that."""
        unpacked = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115 - closed by close
        packed, self._file = self._file, unpacked
        pieces = self._inflated if entry.codec == "zip" else self._unblosced
        written = 0
        try:
            for piece in pieces(packed, entry):
                written += len(piece)
                if written > entry.nbytes:
                    raise self.damaged(f"it unpacks to more than {entry.nbytes} bytes")
                view = memoryview(piece)
                while view:
                    view = view[unpacked.write(view) :]
        except OSError as error:
            raise ResourceError(
                f"{self._path}: unpacking {entry.nbytes} bytes into {tempfile.gettempdir()} "
                f"failed: {error.strerror}; make room there, or set TMPDIR to another folder",
                path=str(self._path),
                nbytes=entry.nbytes,
            ) from error
        finally:
            packed.close()
        if written != entry.nbytes:
            raise self.damaged(f"it unpacks to {written} bytes")
        self._start = 0

    def _inflated(self, packed: BinaryIO, entry: Entry) -> Iterator[bytes]:
        position, end = self._part(packed, entry, entry.start)
        inflater = zlib.decompressobj()
        while not inflater.eof:
            data = inflater.unconsumed_tail
            if not data:
                data = _pread(packed, position, min(_PIECE_NBYTES, end - position), self._path)
                position += len(data)
            if not data:
                raise self.damaged("its packed data end before their checksum")
            try:
                yield inflater.decompress(data, _PIECE_NBYTES)
            except zlib.error as error:
                raise self.damaged(str(error)) from error

    def _unblosced(self, packed: BinaryIO, entry: Entry) -> Iterator[bytes]:
        try:
            from numcodecs import blosc  # type: ignore[import-untyped]
        except ImportError as error:
            raise missing_package("numcodecs", self._path) from error
        end, left = entry.start, entry.nbytes
        while left:
            start, end = self._part(packed, entry, end)
            data = _pread(packed, start, end - start, self._path)
            if len(data) < _BLOSC_HEADER_NBYTES:
                raise self.damaged("a packed part is shorter than its header")
            nbytes, _, packed_nbytes = struct.unpack_from("<III", data, 4)
            expected = min(left, _BLOSC_CHUNK_NBYTES)
            # Looked at before unpacking, which would have so much memory at once.
            if nbytes != expected or packed_nbytes != len(data):
                raise self.damaged(
                    f"a packed part is said to hold {nbytes} bytes in {packed_nbytes}, "
                    f"not {expected} in {len(data)}"
                )
            try:
                piece = bytes(blosc.decompress(data))
            except Exception as error:  # numcodecs promises no kind
                raise self.damaged(printable(str(error))) from error
            left -= len(piece)
            yield piece

    def _part(self, packed: BinaryIO, entry: Entry, start: int) -> tuple[int, int]:
        """Where the part begins and ends whose length stands at ``start``."""
        data = _pread(packed, start, 8, self._path)
        end = start + 8 + (int.from_bytes(data, "little") if len(data) == 8 else 1 << 64)
        if end > entry.start + entry.stored_nbytes:
            raise self.damaged("a packed part is longer than the grid")
        return start + 8, end


def list_grids(path: Path) -> list[Entry]:
    """The grids of a file, in its order.

    Raises:
        SourceError: it is damaged; `TruncatedSourceError` if it ends before a grid does.
        UnsupportedSourceError: another major version, an unknown codec, or too many grids.
    """
    size = require_file(path)
    with open_file(path) as file:
        head = _exactly(file, 0, 8, path)
        find = _raw_grids if head == _RAW_MAGIC else _segments
        entries: list[Entry] = []
        for entry in find(file, size, path):
            entries.append(_checked(entry, size, path))
            if len(entries) > _MOST_GRIDS:
                raise UnsupportedSourceError(
                    f"{path}: holds more than {_MOST_GRIDS} grids; save those wanted on their own",
                    path=str(path),
                )
    return _told_apart(entries)


def _told_apart(entries: list[Entry]) -> list[Entry]:
    """Entries of which those of one name have their number behind it, as OpenVDB has it."""
    counts, seen = Counter(entry.name for entry in entries), Counter[str]()
    apart = []
    for entry in entries:
        if counts[entry.name] > 1:
            apart.append(entry._replace(name=f"{entry.name}[{seen[entry.name]}]"))
            seen[entry.name] += 1
        else:
            apart.append(entry)
    return apart


def require_version(version: int, path: Path) -> None:
    """Refuse another major version, whose nodes differ."""
    major, minor = version >> 21, version >> 10 & 0x7FF
    if major != MAJOR_VERSION:
        raise UnsupportedSourceError(
            f"{path}: is of NanoVDB {major}.{minor}; {MAJOR_VERSION} is read; "
            "convert the original with the tools of OpenVDB 10 or newer",
            path=str(path),
            version=f"{major}.{minor}",
        )


def _segments(file: BinaryIO, size: int, path: Path) -> Iterator[Entry]:
    position = 0
    while position < size:
        magic, version, ngrids, codec = _HEADER.unpack(_exactly(file, position, 16, path))
        if magic not in MAGICS:
            raise SourceError(
                f"{path}: at byte {position} a segment of NanoVDB begins with {magic!r}, not "
                f"{MAGICS[0]!r}; copy or export the file again",
                path=str(path),
                position=position,
            )
        require_version(version, path)
        position += _HEADER.size
        found = []
        for _ in range(ngrids):
            nbytes, stored, kind, name_nbytes, own, *_ = _META.unpack(
                _exactly(file, position, _META.size, path)
            )
            if name_nbytes > _MOST_NAME_NBYTES:
                raise SourceError(
                    f"{path}: the name of a grid takes {name_nbytes} bytes, where "
                    f"{_MOST_NAME_NBYTES} is the most; copy or export the file again",
                    path=str(path),
                )
            name = _exactly(file, position + _META.size, name_nbytes, path)
            position += _META.size + name_nbytes
            found.append((_text(name), kind, own if own < len(_CODECS) else codec, stored, nbytes))
        for name_text, kind, own, stored, nbytes in found:
            if own >= len(_CODECS):
                raise UnsupportedSourceError(
                    f"{path}: grids are packed by codec {own}; none, zip and blosc are read",
                    path=str(path),
                )
            yield Entry(name_text, kind, _CODECS[own], position, stored, nbytes)
            position += stored


def _raw_grids(file: BinaryIO, size: int, path: Path) -> Iterator[Entry]:
    """Grids one after another, each of which says how long it is."""
    position = 0
    while position < size:
        head = _exactly(file, position, GRID_NBYTES, path)
        _, version, nbytes, name = _GRID.unpack_from(head)
        require_version(version, path)
        kind = int.from_bytes(head[636:640], "little")
        yield Entry(_text(name), kind, "none", position, nbytes, nbytes)
        position += max(nbytes, 1)


def _checked(entry: Entry, size: int, path: Path) -> Entry:
    """The entry, if the file can hold such a grid."""
    if entry.start + entry.stored_nbytes > size:
        raise _truncated(path, entry.start + entry.stored_nbytes)
    most = entry.stored_nbytes * (1 if entry.codec == "none" else _MOST_EXPANSION)
    if not GRID_NBYTES < entry.nbytes <= most:
        raise SourceError(
            f"{path}: grid {printable(entry.name)!r} of kind {kind_name(entry.kind)} is said to "
            f"have {entry.nbytes} bytes, in {entry.stored_nbytes} of the file "
            f"(codec {entry.codec}); copy or export the file again",
            path=str(path),
            nbytes=entry.nbytes,
        )
    return entry


def _text(name: bytes) -> str:
    return name.split(b"\0")[0].decode("utf-8", "replace")


def _exactly(file: BinaryIO, start: int, nbytes: int, path: Path) -> bytes:
    data = _pread(file, start, nbytes, path)
    if len(data) < nbytes:
        raise _truncated(path, start + nbytes)
    return data


def _pread(file: BinaryIO, start: int, nbytes: int, path: Path) -> bytes:
    """Bytes of a file, fewer where it ends."""
    try:
        data = os.pread(file.fileno(), nbytes, start)
        while data and len(data) < nbytes:
            more = os.pread(file.fileno(), nbytes - len(data), start + len(data))
            if not more:
                break
            data += more
    except (OSError, OverflowError) as error:
        raise SourceError(
            f"{path}: reading {nbytes} bytes at byte {start} failed: {error}; check the disk",
            path=str(path),
            position=start,
        ) from error
    return data


def _truncated(path: Path, expected: int) -> TruncatedSourceError:
    have = require_file(path)
    return TruncatedSourceError(
        f"{path}: ends after {have} bytes, where {expected} at least are needed; "
        "copy or export it again",
        path=str(path),
        expected_nbytes=expected,
        actual_nbytes=have,
    )
