"""The first bytes of a file, read with a limit, and only from regular files."""

from __future__ import annotations

import stat
import warnings
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from io import FileIO
from pathlib import Path

from octobrick.codec.errors import OctobrickError, ResourceError
from octobrick.store.errors import SourceError, SourceNotFoundError, UnsupportedSourceError
from octobrick.store.sources.location import Location

# Headers are a few hundred bytes; one that is larger is an attack or another kind of file.
HEADER_LIMIT_NBYTES = 1 << 20

GZIP_MAGIC = b"\x1f\x8b"
# zlib's 15-bit window, plus 32: gzip or zlib wrapping, whichever the first bytes show.
GZIP_OR_ZLIB_WBITS = 15 + 32

# How much of a file's own text a message quotes.
_QUOTE_LENGTH = 120
# A gzip header can hold a comment; beyond this length it is not looked through.
_PEEK_COMPRESSED_NBYTES = 1 << 17


def require_file(path: Path, named_by: Path | None = None) -> int:
    """The size in bytes of a regular file.

    Args:
        path: the file.
        named_by: the header that names it, for the message.

    Raises:
        SourceNotFoundError: there is no such file.
        UnsupportedSourceError: it is a folder, a device or a pipe.
        ResourceError: it cannot be looked at.
    """
    naming = f" (the data file that {named_by} names)" if named_by else ""
    try:
        status = path.stat()
    except (FileNotFoundError, NotADirectoryError) as error:
        raise SourceNotFoundError(
            f"{path}{naming}: no such file; check the name", path=str(path)
        ) from error
    except OSError as error:
        raise _unreadable(path, error) from error
    except ValueError as error:  # a zero byte in the name
        raise SourceError(f"{path!r}{naming}: not a file name", path=repr(path)) from error
    if not stat.S_ISREG(status.st_mode):
        kind = "a folder" if stat.S_ISDIR(status.st_mode) else "not a regular file"
        raise UnsupportedSourceError(
            f"{path}{naming}: is {kind}; give the path of one file", path=str(path)
        )
    return status.st_size


def open_file(path: Path) -> FileIO:
    """A regular file, open for unbuffered reading; the caller closes it.

    Raises:
        ResourceError: it cannot be opened.
    """
    try:
        return path.open("rb", buffering=0)
    except OSError as error:
        raise _unreadable(path, error) from error


def read_head(path: Path, nbytes: int = HEADER_LIMIT_NBYTES) -> bytes:
    """At most the first ``nbytes`` bytes of a file; raises what `require_file` does."""
    require_file(path)
    with open_file(path) as file:
        try:
            return file.read(nbytes)
        except OSError as error:
            raise _unreadable(path, error) from error


def read_head_inflated(path: Path, nbytes: int) -> bytes:
    """At most the first ``nbytes`` bytes, of what is inside if the file is gzip data.

    Fewer come back from gzip data that end early.

    Raises:
        SourceError: the gzip data are damaged from the start.
    """
    head = read_head(path, max(nbytes, _PEEK_COMPRESSED_NBYTES))
    if not head.startswith(GZIP_MAGIC):
        return head[:nbytes]
    try:
        return zlib.decompressobj(GZIP_OR_ZLIB_WBITS).decompress(head, nbytes)
    except zlib.error as error:
        raise SourceError(
            f"{path}: damaged gzip data in the first {nbytes} bytes ({error}); "
            "copy or export the file again",
            path=str(path),
        ) from error


def locate_data(header: Path, name: str) -> tuple[Path, int]:
    """The data file that a header names, relative to the header, and its size in bytes.

    Raises:
        SourceError: the name is none.
        SourceNotFoundError: there is no such file.
    """
    if not name.strip() or not name.isprintable():
        raise SourceError(
            f"{header}: the header names {printable(name)!r} as its data file; "
            "correct it or export the file again",
            path=str(header),
        )
    path = header.parent / name
    return path, require_file(path, named_by=header)


def printable(text: str) -> str:
    """Text from a file made fit for a message: short, and without control characters."""
    if len(text) > _QUOTE_LENGTH:
        text = text[:_QUOTE_LENGTH] + "..."
    return text if text.isprintable() else text.encode("unicode_escape").decode("ascii")


@contextmanager
def parsing(path: Location, what: str) -> Iterator[None]:
    """Turn whatever a header makes a parser raise, or warn of, into a `SourceError`.

    Parsers of other projects promise nothing about hostile bytes, so every exception of theirs
    means the same to the caller: this header cannot be read.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # deprecations are for developers
        warnings.simplefilter("error", UserWarning)
        warnings.simplefilter("error", RuntimeWarning)
        try:
            yield
        except OctobrickError:
            raise
        except Exception as error:
            reason = printable(str(error) or type(error).__name__)
            raise SourceError(
                f"{path}: the {what} header cannot be read: {reason}; "
                "export the file again or correct its header",
                path=str(path),
                reason=reason,
            ) from error


def missing_package(name: str, path: Location, extra: str = "formats") -> ResourceError:
    """The error for an optional package that reading this file takes."""
    return ResourceError(
        f"{path}: reading this takes the package {name}; "
        f"install it with: pip install 'octobrick[{extra}]'",
        package=name,
        path=str(path),
    )


def _unreadable(path: Path, error: OSError) -> ResourceError:
    reason = error.strerror or str(error)
    return ResourceError(
        f"{path}: cannot be read: {reason}; check its permissions and the disk",
        path=str(path),
        reason=reason,
    )
