"""A small file of settings that is read again when it changes, while the server runs."""

from __future__ import annotations

import logging
import os
import stat
import time
from collections.abc import Callable
from pathlib import Path
from typing import Generic, TypeVar

from octobrick.codec.errors import InvalidInputError, OctobrickError, ResourceError

logger = logging.getLogger(__name__)

T = TypeVar("T")

_CHECK_SECONDS = 1.0  # a change counts this late; a look at each request would cost more
_NBYTES_MAX = 1 << 20  # beyond any sensible file of tokens or keys


class WatchedFile(Generic[T]):
    """What a file says, as of its last sound version. For the event loop's thread alone.

    A file that cannot be used when it is first read is an error. Later, the last sound version
    stays, and the log says why.

    Args:
        path: the file; a link, as Kubernetes makes for secrets, is followed at each look.
        parse: makes the value of the text and raises `OctobrickError` where it is not sound.
        forbidden_mode: permission bits that the file must not have, such as ``stat.S_IWOTH``.
        clock: seconds that only go forward.
    """

    def __init__(
        self,
        path: Path,
        parse: Callable[[str], T],
        forbidden_mode: int,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._path = path
        self._parse = parse
        self._forbidden_mode = forbidden_mode
        self._clock = clock
        self._looked = clock()
        self._stamp = self._stamp_now()
        self._value = self._read()

    def value(self) -> T:
        """What the file says; looks at it again at most once a second.

        Never raises: what is wrong with a later version is logged.
        """
        now = self._clock()
        if now - self._looked >= _CHECK_SECONDS:
            self._looked = now
            stamp = self._stamp_now()
            if stamp != self._stamp:
                self._stamp = stamp
                self._take()
        return self._value

    def _take(self) -> None:
        try:
            self._value = self._read()
        except OctobrickError as error:
            logger.error("the version before stays in use: %s", error.message)
        else:
            logger.info("%s was read again", self._path)

    def _stamp_now(self) -> tuple[int, ...] | None:
        try:
            status = self._path.stat()
        except OSError:
            return None
        return (status.st_dev, status.st_ino, status.st_mtime_ns, status.st_size, status.st_mode)

    def _read(self) -> T:
        try:
            with self._path.open("rb") as file:
                mode = os.fstat(file.fileno()).st_mode
                self._require_mode(mode)
                content = file.read(_NBYTES_MAX + 1)
            text = content.decode("utf-8")
        except OSError as error:
            raise ResourceError(
                f"{self._path}: cannot be read ({error.strerror}); name a file that can",
                path=str(self._path),
            ) from error
        except UnicodeDecodeError as error:
            raise InvalidInputError(
                f"{self._path}: not UTF-8 text", path=str(self._path)
            ) from error
        if len(content) > _NBYTES_MAX:
            raise InvalidInputError(
                f"{self._path}: longer than {_NBYTES_MAX} bytes", path=str(self._path)
            )
        return self._parse(text)

    def _require_mode(self, mode: int) -> None:
        if mode & self._forbidden_mode:
            allowed = stat.S_IMODE(mode) & ~self._forbidden_mode
            raise InvalidInputError(
                f"{self._path}: permissions {stat.S_IMODE(mode):04o} let others at it; "
                f"chmod {allowed:04o} {self._path}",
                path=str(self._path),
            )
