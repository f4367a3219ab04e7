"""numpy's archives: ``.npz``, zip files of ``.npy`` members, stored or deflated.

zipfile reads the directory of the archive; the elements are read by our own readers, stored ones
in place and deflated ones as a stream.
"""

from __future__ import annotations

import struct
import zipfile
import zlib
from pathlib import Path

from octobrick.codec.errors import InvalidInputError
from octobrick.store.errors import SourceError, TruncatedSourceError, UnsupportedSourceError
from octobrick.store.sources.base import Pick, Source
from octobrick.store.sources.gzip_stream import GzipSource
from octobrick.store.sources.head import (
    HEADER_LIMIT_NBYTES,
    open_file,
    parsing,
    printable,
    require_file,
)
from octobrick.store.sources.npy import parse_header
from octobrick.store.sources.raw import RawSource

MAGIC = b"PK\x03\x04"
_SUFFIX = ".npy"
_LISTED = 20
_LOCAL_HEADER = struct.Struct("<4s22xHH")
_ENCRYPTED = 1


def open_npz(path: Path, pick: Pick) -> Source:
    """One array of an archive: that of the name ``pick.dataset``, or the only one.

    Raises:
        SourceError: the archive or the array is damaged.
        InvalidInputError: several arrays and no name, no array of this name, or axes that do not
            fit it.
        UnsupportedSourceError: no arrays, another compression than deflate, or a sample type that
            is not read.
    """
    member = _choose(_members(path), pick.dataset, path)
    start_nbytes = _data_start(member, path)
    is_stored = member.compress_type == zipfile.ZIP_STORED
    with open_file(path) as file:
        file.seek(start_nbytes)
        head = file.read(min(HEADER_LIMIT_NBYTES, member.compress_size))
    if not is_stored:
        with parsing(path, f"{printable(member.filename)} (deflate)"):
            head = zlib.decompressobj(-zlib.MAX_WBITS).decompress(head, HEADER_LIMIT_NBYTES)
    header = parse_header(head, path)
    description = header.describe("npz", pick.axes, path)
    layout = header.layout(pick.axes, path, start_nbytes if is_stored else 0)
    nbytes = header.nbytes + layout.nbytes_of(description)
    if member.file_size < nbytes:
        raise TruncatedSourceError(
            f"{path}: {printable(member.filename)} ends after {member.file_size} of {nbytes} "
            "bytes; save the archive again",
            path=str(path),
            expected_nbytes=nbytes,
            actual_nbytes=member.file_size,
        )
    if is_stored:
        return RawSource(path, description, layout)
    return GzipSource(path, description, layout.in_stream(start_nbytes, deflate_crc32=member.CRC))


def _members(path: Path) -> list[zipfile.ZipInfo]:
    require_file(path)
    with parsing(path, "zip"), zipfile.ZipFile(path) as archive:
        return [member for member in archive.infolist() if member.filename.endswith(_SUFFIX)]


def _choose(members: list[zipfile.ZipInfo], dataset: str | None, path: Path) -> zipfile.ZipInfo:
    names = [member.filename.removesuffix(_SUFFIX) for member in members]
    listed = ", ".join(printable(name) for name in names[:_LISTED]) or "none"
    if not members:
        raise UnsupportedSourceError(
            f"{path}: a zip archive without arrays ({_SUFFIX} files); unpack it and give the path "
            "of what is in it",
            path=str(path),
        )
    if dataset is None:
        if len(members) == 1:
            return members[0]
        raise InvalidInputError(
            f"{path}: holds {len(members)} arrays: {listed}; choose one with --dataset NAME",
            path=str(path),
            datasets=names[:_LISTED],
        )
    wanted = dataset.removesuffix(_SUFFIX)
    if wanted not in names:
        raise InvalidInputError(
            f"{path}: no array {printable(dataset)!r}; there are: {listed}",
            path=str(path),
            datasets=names[:_LISTED],
        )
    return members[names.index(wanted)]


def _data_start(member: zipfile.ZipInfo, path: Path) -> int:
    """Where the bytes of a member begin, behind its own header in the file."""
    name = printable(member.filename)
    if member.flag_bits & _ENCRYPTED or member.compress_type not in (
        zipfile.ZIP_STORED,
        zipfile.ZIP_DEFLATED,
    ):
        raise UnsupportedSourceError(
            f"{path}: {name} is encrypted or of compression {member.compress_type}; stored and "
            "deflated arrays are read, as numpy.savez and savez_compressed write them",
            path=str(path),
        )
    with open_file(path) as file:
        file.seek(max(0, member.header_offset))
        header = file.read(_LOCAL_HEADER.size)
    if len(header) < _LOCAL_HEADER.size or not header.startswith(MAGIC):
        raise SourceError(
            f"{path}: {name} does not begin at byte {member.header_offset}, where the archive's "
            "directory has it; copy or save the archive again",
            path=str(path),
            position=member.header_offset,
        )
    _, name_nbytes, extra_nbytes = _LOCAL_HEADER.unpack(header)
    return member.header_offset + _LOCAL_HEADER.size + int(name_nbytes) + int(extra_nbytes)
