"""The chain of directories of a TIFF file, walked before anything else believes in it.

Each page has a directory that says where the next one lies. A reader that stops where the chain
leaves the file would take a file that was cut short for one with fewer pages, so the chain is
followed to its end here, and so are the values of each directory: three small reads a page.
"""

from __future__ import annotations

import os
import struct
from io import FileIO
from pathlib import Path
from typing import NamedTuple

from octobrick.store.errors import SourceError, TruncatedSourceError
from octobrick.store.sources.head import open_file, require_file

MAGICS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")

# Directories have 10 to 30 entries; those of microscopes up to a hundred.
_ENTRIES_LIMIT = 4096
# Bytes of a value of each kind that the specifications know.
_NBYTES_OF_KIND = {
    **dict.fromkeys((1, 2, 6, 7), 1),
    **dict.fromkeys((3, 8), 2),
    **dict.fromkeys((4, 9, 11, 13), 4),
    **dict.fromkeys((5, 10, 12, 16, 17, 18), 8),
}


class _Form(NamedTuple):
    """How directories are written: classic or BigTIFF, in one of two byte orders."""

    first: int  # where the offset of the first directory lies
    entries: struct.Struct  # how many there are
    entry: struct.Struct  # tag, kind of value, number of values, the value or where it lies
    offset: struct.Struct


def is_tiff(head: bytes) -> bool:
    """Whether a file begins as TIFF or BigTIFF does."""
    return head.startswith(MAGICS)


def count_pages(path: Path) -> int:
    """How many pages a TIFF file has, at least 1.

    Raises:
        TruncatedSourceError: the chain of directories leaves the file.
        SourceError: it is no TIFF file, has no page, or the chain comes back to itself.
    """
    size = require_file(path)
    with open_file(path) as file:
        head = file.read(16)
        if not is_tiff(head):
            raise SourceError(
                f"{path}: does not begin as a TIFF file does; it is damaged or misnamed",
                path=str(path),
            )
        form = _form(head)
        position = _unpack(file, form.offset, form.first, path, size, page=0)
        seen: set[int] = set()
        while position:
            if position in seen:
                raise SourceError(
                    f"{path}: the directory of page {len(seen)} lies at byte {position}, as an "
                    "earlier one does: the chain has no end; export the file again",
                    path=str(path),
                    page=len(seen),
                )
            seen.add(position)
            position = _next(file, form, position, path, size, page=len(seen) - 1)
    if not seen:
        raise SourceError(f"{path}: the TIFF file has no page; export it again", path=str(path))
    return len(seen)


def _form(head: bytes) -> _Form:
    order = "<" if head.startswith(b"II") else ">"
    if b"+" in head[2:4]:
        return _Form(
            8, struct.Struct(order + "Q"), struct.Struct(order + "HHQQ"), struct.Struct(order + "Q")
        )
    return _Form(
        4, struct.Struct(order + "H"), struct.Struct(order + "HHII"), struct.Struct(order + "I")
    )


def _next(file: FileIO, form: _Form, position: int, path: Path, size: int, page: int) -> int:
    """Where the directory after the one at ``position`` lies; 0 where there is none."""
    count = _unpack(file, form.entries, position, path, size, page)
    if not 0 < count <= _ENTRIES_LIMIT:
        raise SourceError(
            f"{path}: the directory of page {page} at byte {position} has {count} entries; "
            f"1 to {_ENTRIES_LIMIT} are expected; export the file again",
            path=str(path),
            page=page,
        )
    position += form.entries.size
    entries = os.pread(file.fileno(), count * form.entry.size, position)
    end = position + count * form.entry.size
    if len(entries) < count * form.entry.size:
        raise _too_short(path, page, end, size)
    for _, kind, nvalues, offset in form.entry.iter_unpack(entries):
        nbytes = nvalues * _NBYTES_OF_KIND.get(kind, 0)
        if nbytes > form.offset.size and offset + nbytes > size:
            raise _too_short(path, page, offset + nbytes, size)
    return _unpack(file, form.offset, end, path, size, page)


def _unpack(
    file: FileIO, number: struct.Struct, position: int, path: Path, size: int, page: int
) -> int:
    """The number at ``position``."""
    if position + number.size <= size:
        found = os.pread(file.fileno(), number.size, position)
        if len(found) == number.size:
            return int(number.unpack(found)[0])
    raise _too_short(path, page, position + number.size, size)


def _too_short(path: Path, page: int, end: int, size: int) -> TruncatedSourceError:
    return TruncatedSourceError(
        f"{path}: the directory of page {page} needs bytes up to {end}, but the file has {size}; "
        "copy or export the file again",
        path=str(path),
        page=page,
        expected_nbytes=end,
        actual_nbytes=size,
    )
