"""Bytes that stay: synced to the disk, and the system's refusals explained."""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Callable, Iterator
from pathlib import Path

from octobrick.store.errors import DestinationError

_ADVICE = {
    errno.ENOSPC: "free some space",
    errno.EDQUOT: "free some of your quota",
    errno.EACCES: "choose a folder that you may write to",
    errno.EPERM: "choose a folder that you may write to",
    errno.EROFS: "choose a file system that is not read-only",
    errno.EFBIG: "raise the limit on file size, or write less to a file",
    errno.ENOENT: "choose a name in a folder that exists or can be made",
    errno.ENOTDIR: "choose a name whose parents are folders",
    errno.ENAMETOOLONG: "choose a shorter name",
}


def sync(path: Path) -> None:
    """Make a file's content, or a folder's list of names, durable.

    Raises:
        OSError: the system cannot.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _nothing_remains() -> str:
    return "Nothing was left behind"


@contextlib.contextmanager
def explained(out: Path, what_remains: Callable[[], str] = _nothing_remains) -> Iterator[None]:
    """Turn the system's refusal to write into an error that says what to do.

    Args:
        out: what is written.
        what_remains: asked when it has failed, for the end of the message.

    Raises:
        DestinationError: for a refusal that the user can do something about.
        OSError: any other.
    """
    try:
        yield
    except OSError as error:
        advice = _ADVICE.get(error.errno or 0)
        if advice is None:
            raise
        at = f" ({error.filename})" if error.filename else ""
        raise DestinationError(
            f"{out}: cannot be written: {error.strerror or error}{at}; {advice} and try again. "
            f"{what_remains()}",
            path=str(out),
            errno=error.errno,
        ) from error
