"""Bytes of volumes on servers, kept on disk: bounded, checked, shared by several processes.

A key holds the revision of a volume, so an entry never grows stale. Each is a file of its own::

    "OBKC" | u8 version 1 | u8: 1 where the brick is absent, else 0 | u16 0 | u32 crc32c
    u64 size of the payload, then the payload

It gets its name when it is whole, so readers see all of it or nothing. The time of a file is that
of its last use, about; the oldest make room. Whatever goes wrong with the disk, the bytes come from
the server instead.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import logging
import os
import struct
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import google_crc32c

from octobrick.codec.errors import InvalidInputError

logger = logging.getLogger(__name__)

DEFAULT_NBYTES: Final = 2 * 2**30
_HEADER = struct.Struct("<4sBBHIQ")
_MAGIC, _VERSION = b"OBKC", 1
_BLOCK_NBYTES = 4096  # what a file takes of a disk at least: bounds how many there are, too
_ENTRY_NBYTES_MAX = 256 * 2**20
_KEPT_SHARE = 0.9  # of the limit, after room was made: else each entry would look for room
_SHARE_UNSEEN = 8  # of the limit written by one process before it looks what others have written
_TOUCH_SECONDS = 60.0  # a use sooner after the last one is not written down
_LEFTOVER_SECONDS = 3600.0  # an unfinished file of this age belongs to nobody


@dataclass(frozen=True, slots=True)
class Kept:
    """What was kept: bytes, or None of an absent brick."""

    payload: bytes | None


class BrickCache:
    """A folder of kept bytes. Safe to use from several threads and processes.

    Args:
        folder: made when something is first kept.
        nbytes_max: of all files together, as the disk counts them; 0 keeps nothing. Several
            processes may pass it, each by an eighth, before they see each other.
    """

    def __init__(self, folder: Path, nbytes_max: int = DEFAULT_NBYTES) -> None:
        self._folder = folder
        self._nbytes_max = nbytes_max
        self._lock = threading.Lock()
        self._nbytes: int | None = None  # None: not counted yet
        self._unseen_nbytes = 0
        self._writes = nbytes_max > 0
        self._hits = self._misses = self._damaged = 0

    @classmethod
    def usual(cls) -> BrickCache:
        """The user's own, as ``OCTOBRICK_CACHE_DIR`` and ``OCTOBRICK_CACHE_NBYTES`` say.

        Raises:
            InvalidInputError: the limit is no number of bytes.
        """
        text = os.environ.get("OCTOBRICK_CACHE_NBYTES", str(DEFAULT_NBYTES))
        if not text.isdecimal() or len(text) > 18:
            raise InvalidInputError(
                f"OCTOBRICK_CACHE_NBYTES {text!r:.40} is no number of bytes; 0 keeps nothing"
            )
        folder = os.environ.get("OCTOBRICK_CACHE_DIR")
        if not folder:
            base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
            folder = str(Path(base) / "octobrick")
        return cls(Path(folder), int(text))

    def get(self, key: str) -> Kept | None:
        """What was kept under a key; None where nothing was, or it is damaged."""
        if self._nbytes_max <= 0:
            return None
        path = self._path(key)
        try:
            with path.open("rb") as file:
                status = os.fstat(file.fileno())
                if status.st_size > _ENTRY_NBYTES_MAX + _HEADER.size:
                    raise ValueError("too large")
                kept = _unpacked(file.read())
            if time.time() - status.st_mtime > _TOUCH_SECONDS:
                with contextlib.suppress(OSError):
                    os.utime(path)
        except OSError:
            self._misses += 1
            return None
        except (ValueError, struct.error):
            self._damaged += 1
            self.drop(key)
            return None
        self._hits += 1
        return kept

    def drop(self, key: str) -> None:
        """Forget what was kept under a key."""
        with contextlib.suppress(OSError):
            self._path(key).unlink()

    def put(self, key: str, payload: bytes | None) -> None:
        """Keep bytes, or that a brick is absent, if there is room; never fails."""
        content = payload or b""
        nbytes = _on_disk(_HEADER.size + len(content))
        if not self._writes or nbytes > self._nbytes_max or len(content) > _ENTRY_NBYTES_MAX:
            return
        try:
            if self._make_room(nbytes):
                self._write(self._path(key), _packed(payload))
        except OSError as error:
            self._stop(error)

    def stats(self) -> dict[str, float]:
        """How often something was found, was not, or was damaged, and the bytes on disk."""
        return {
            "hits": self._hits,
            "misses": self._misses,
            "damaged": self._damaged,
            "nbytes": self._nbytes or 0,
        }

    def _path(self, key: str) -> Path:
        name = hashlib.blake2b(key.encode(), digest_size=20).hexdigest()
        return self._folder / name[:2] / name[2:]

    def _write(self, path: Path, content: bytes) -> None:
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        part = path.with_name(f"{path.name}.{os.getpid()}-{threading.get_ident()}.part")
        try:
            part.write_bytes(content)
            part.replace(path)
        except BaseException:
            with contextlib.suppress(OSError):
                part.unlink()
            raise

    def _make_room(self, nbytes: int) -> bool:
        """Whether so many bytes fit now; while another thread makes room, they do not."""
        if not self._lock.acquire(blocking=False):
            return False
        try:
            unseen = self._unseen_nbytes + nbytes
            if self._nbytes is None or unseen > self._nbytes_max // _SHARE_UNSEEN:
                self._nbytes, unseen = self._counted(), nbytes
            if self._nbytes + nbytes > self._nbytes_max:
                self._nbytes, unseen = self._evicted(nbytes), nbytes
            self._nbytes += nbytes
            self._unseen_nbytes = unseen
            return self._nbytes <= self._nbytes_max
        finally:
            self._lock.release()

    def _counted(self) -> int:
        return sum(nbytes for _, nbytes, _ in self._entries())

    def _evicted(self, nbytes: int) -> int:
        """Remove what was not used for longest; the bytes that are left."""
        self._folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        with (self._folder / "lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)  # one process at a time, or all would remove the same
            entries = sorted(self._entries())
            left = sum(size for _, size, _ in entries)
            goal = int(self._nbytes_max * _KEPT_SHARE) - nbytes
            for _, size, path in entries:
                if left <= max(0, goal):
                    break
                with contextlib.suppress(FileNotFoundError):
                    Path(path).unlink()
                left -= size
        return left

    def _entries(self) -> Iterator[tuple[float, int, str]]:
        """Last use, bytes on disk and path of each file; what was never finished is removed."""
        for number in range(256):
            with contextlib.suppress(FileNotFoundError):
                yield from _files(f"{self._folder}/{number:02x}")

    def _stop(self, error: OSError) -> None:
        with self._lock:
            said, self._writes = not self._writes, False
        if not said:
            logger.warning(
                "%s: bricks are not kept any more (%s); all else goes on",
                self._folder,
                error.strerror or error,
            )


def _files(folder: str) -> Iterator[tuple[float, int, str]]:
    with os.scandir(folder) as items:
        for item in items:
            with contextlib.suppress(FileNotFoundError):
                status = item.stat(follow_symlinks=False)
                if item.name.endswith(".part"):
                    if time.time() - status.st_mtime > _LEFTOVER_SECONDS:
                        Path(item.path).unlink()
                    continue
                yield status.st_mtime, _on_disk(status.st_size), item.path


def _on_disk(nbytes: int) -> int:
    return -(-nbytes // _BLOCK_NBYTES) * _BLOCK_NBYTES


def _packed(payload: bytes | None) -> bytes:
    content = payload or b""
    crc = google_crc32c.value(content)
    head = _HEADER.pack(_MAGIC, _VERSION, payload is None, 0, crc, len(content))
    return head + content


def _unpacked(entry: bytes) -> Kept:
    magic, version, absent, zero, crc, nbytes = _HEADER.unpack_from(entry)
    content = entry[_HEADER.size :]
    sound = (magic, version, zero, nbytes) == (_MAGIC, _VERSION, 0, len(content))
    if not sound or absent > 1 or (absent and content) or google_crc32c.value(content) != crc:
        raise ValueError("damaged")
    return Kept(None if absent else content)
