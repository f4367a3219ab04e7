"""The catalog: the volumes of a folder and of a list, by id, as they are on disk now.

An id never becomes part of a path: it is looked up among the names that a scan of the folder
found, or that the settings list. So no id, however it is spelled, reaches the file system.
"""

from __future__ import annotations

import logging
import os
import re
import threading
import time
from collections.abc import Callable, Hashable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import CorruptDataError, NotFoundError, OctobrickError, ResourceError
from octobrick.store import LocalVolume, open_volume
from octobrick.store.errors import VolumeNotFoundError

logger = logging.getLogger(__name__)

T = TypeVar("T")

_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,127}")
_SUFFIX = ".zarr"
_KEPT_SUMMARIES = 64  # (level, t, c) of a volume: all of a pyramid, at some 10 bytes a brick

# Changes whenever a volume is put in another's place: device, inode, time and size of zarr.json.
Stamp = tuple[int, int, int, int]

# A folder that has the time of the last scan is not listed again for so long: network file systems
# keep times for some seconds, and others count them in ticks of a clock.
_RESCAN_SECONDS = 2.0
# A change as soon as this after another may leave the folder's time as it is.
_CLOCK_TICK_NS = 50_000_000


@dataclass(slots=True, eq=False)
class OpenVolume:
    """A volume as it was when it was opened, and who still uses it.

    ``ranges`` and ``fidelity`` are those of the volume, kept once they were read; ``kept`` has a
    place for what else is made once from the files as they were, ``heads`` for the same by brick.
    """

    volume: LocalVolume
    stamp: Stamp | None
    path: Path
    users: int = 0
    retired: bool = False
    ranges: Callable[[int, int, int], NDArray[Any]] = field(init=False)
    fidelity: Callable[[int, int, int], NDArray[np.float32]] = field(init=False)
    kept: dict[Hashable, Any] = field(default_factory=dict)
    heads: dict[Hashable, Any] = field(default_factory=dict)
    serial: object = field(default_factory=object)  # like no other's
    _manifest: str = field(init=False)

    def __post_init__(self) -> None:
        self._manifest = _manifest_of(self.path)
        self.ranges = lru_cache(_KEPT_SUMMARIES)(self.volume.ranges)
        self.fidelity = lru_cache(_KEPT_SUMMARIES)(self.volume.fidelity)

    def is_current(self) -> bool:
        """Whether the files on disk are still those that were opened."""
        return self.stamp is not None and _stamp_of(self._manifest) == self.stamp


@dataclass(slots=True)
class _Entry:
    id: str
    path: Path
    opening: threading.Lock = field(default_factory=threading.Lock)
    open: OpenVolume | None = None


class Catalog:
    """Finds, opens and lends the ``*.zarr`` volumes of a folder. Safe to use from any thread.

    A volume that is put into the folder, or taken away, is seen at the next use or scan. A volume
    that was replaced on disk is opened anew at its next use; the old one is closed when its last
    borrower returns it. A volume that cannot be opened harms no other.

    Args:
        folder: where the volumes lie; links to volumes elsewhere are followed. None for no folder.
        opener: opens one volume.
        listed: volumes that lie elsewhere, by id; they go before those of the folder.
    """

    def __init__(
        self,
        folder: Path | None,
        opener: Callable[[Path], LocalVolume] = open_volume,
        listed: Mapping[str, Path] | None = None,
    ) -> None:
        self._folder = folder
        self._opener = opener
        self._listed = dict(listed or {})
        self._scanned: tuple[int, float] | None = None  # time of the folder; of the scan
        self._lock = threading.Lock()  # guards _entries, users and retired; not held to read
        self._entries = {name: _Entry(name, path) for name, path in self._listed.items()}

    def scan(self) -> list[str]:
        """Look at the folder again; returns the ids found, sorted.

        Raises:
            ResourceError: the folder cannot be read.
        """
        found = self._in_folder() | self._listed
        with self._lock:
            for volume_id in self._entries.keys() - found.keys():
                self._retire(self._entries.pop(volume_id).open)
            for volume_id in found.keys() - self._entries.keys():
                self._entries[volume_id] = _Entry(volume_id, found[volume_id])
        return sorted(found)

    def _in_folder(self) -> dict[str, Path]:
        if self._folder is None:
            return {}
        try:
            modified_ns = self._folder.stat().st_mtime_ns
            with os.scandir(self._folder) as items:
                names = [item.name for item in items if item.is_dir()]
        except OSError as error:
            raise ResourceError(
                f"{self._folder}: cannot list the folder of volumes ({error.strerror}); "
                "name a folder that exists and can be read",
                path=str(self._folder),
            ) from error
        settled = time.time_ns() - modified_ns > _CLOCK_TICK_NS
        self._scanned = (modified_ns, time.monotonic()) if settled else None
        return {
            name.removesuffix(_SUFFIX): self._folder / name
            for name in names
            if name.endswith(_SUFFIX) and _ID.fullmatch(name.removesuffix(_SUFFIX))
        }

    def _may_have_changed(self) -> bool:
        """Whether the folder may hold other volumes than the last scan found."""
        if self._folder is None or self._scanned is None:
            return self._folder is not None
        modified_ns, when = self._scanned
        try:
            if self._folder.stat().st_mtime_ns != modified_ns:
                return True
        except OSError:
            return True
        return time.monotonic() - when >= _RESCAN_SECONDS

    @contextmanager
    def borrow(self, volume_id: str) -> Iterator[OpenVolume]:
        """Lend the volume that is on disk now under an id, open for as long as the block runs.

        Raises:
            VolumeNotFoundError: no volume has this id.
            OctobrickError: the volume cannot be opened.
        """
        lent = self._lend(volume_id)
        try:
            yield lent
        finally:
            self._give_back(lent)

    def read(self, volume_id: str, use: Callable[[OpenVolume], T]) -> T:
        """What ``use`` makes of a volume that was not replaced meanwhile; else it is used again.

        Reading a volume while it is replaced may mix two revisions, or look like damage, and a
        cache would keep either for ever under the address of the old revision.

        Raises:
            VolumeNotFoundError: no volume has this id.
            OctobrickError: the volume cannot be opened, or what ``use`` raises.
        """
        while True:
            with self.borrow(volume_id) as lent:
                try:
                    result = use(lent)
                except CorruptDataError:
                    if lent.is_current():
                        raise
                    continue
                if lent.is_current():
                    return result

    def read_now(self, volume_id: str, use: Callable[[OpenVolume], T]) -> T | None:
        """As `read`, for an event loop: None where the answer takes a wait, or another look.

        The volume is not borrowed: one that is closed under our hands has no open shard any more,
        so ``use`` finds that it would have to wait. One look at the stamp is enough, after the
        reading: whoever opened what was read, and when, that was the volume which is there still.

        Raises:
            OctobrickError: what ``use`` raises of a volume that is still there.
        """
        entry = self._entries.get(volume_id)
        lent = None if entry is None else entry.open
        if lent is None:
            return None
        try:
            result = use(lent)
        except (BlockingIOError, CorruptDataError):
            return None
        except OctobrickError:
            if lent.is_current():
                raise
            return None
        return result if lent.is_current() else None

    def stats(self) -> dict[str, float]:
        """Numbers for metrics: volumes that the last scan found, and those that are open."""
        with self._lock:
            entries = list(self._entries.values())
        return {"volumes": len(entries), "open_volumes": sum(e.open is not None for e in entries)}

    def close(self) -> None:
        """Close all volumes, those in use when their borrowers return them."""
        with self._lock:
            for entry in self._entries.values():
                self._retire(entry.open)
            self._entries.clear()

    def _lend(self, volume_id: str) -> OpenVolume:
        entry = self._entry(volume_id)
        with self._lock:
            lent = entry.open
            if lent is not None:
                lent.users += 1
        if lent is not None:
            if lent.is_current():
                return lent
            self._give_back(lent)
        with entry.opening:
            return self._open_and_lend(entry)

    def _entry(self, volume_id: str) -> _Entry:
        with self._lock:
            entry = self._entries.get(volume_id)
        if entry is None and _ID.fullmatch(volume_id) and self._may_have_changed():
            self.scan()
            with self._lock:
                entry = self._entries.get(volume_id)
        if entry is None:
            raise unknown_volume(volume_id)
        return entry

    def _open_and_lend(self, entry: _Entry) -> OpenVolume:
        stamp = _stamp_of(_manifest_of(entry.path))
        with self._lock:
            lent = entry.open
            if lent is not None and lent.stamp == stamp:  # another thread was here first
                lent.users += 1
                return lent
            self._retire(entry.open)
            entry.open = None
        try:
            volume = self._opener(entry.path)
        except OctobrickError as error:
            logger.warning("volume %s cannot be opened: %s", entry.id, error.message)
            if isinstance(error, NotFoundError):
                raise unknown_volume(entry.id) from error
            raise
        except OSError as error:
            raise ResourceError(
                f"{entry.path}: cannot be read ({error.strerror}); check its permissions",
                path=str(entry.path),
            ) from error
        # The stamp is older than what was opened: a replacement in between is seen at the next use.
        fresh = OpenVolume(volume, stamp, entry.path, users=1)
        with self._lock:
            # Not kept where a scan dropped the entry meanwhile: nothing would ever close it.
            if self._entries.get(entry.id) is entry:
                entry.open = fresh
            else:
                fresh.retired = True
        return fresh

    def _give_back(self, lent: OpenVolume) -> None:
        with self._lock:
            lent.users -= 1
            last = lent.retired and lent.users == 0
        if last:
            lent.volume.close()

    def _retire(self, lent: OpenVolume | None) -> None:
        if lent is None:
            return
        lent.retired = True
        if lent.users == 0:
            lent.volume.close()


def unknown_volume(volume_id: str) -> VolumeNotFoundError:
    """The error for an id that names nothing; long or odd ids are not repeated."""
    if not _ID.fullmatch(volume_id):
        return VolumeNotFoundError(
            "The volume id is malformed: 1 to 128 letters, digits, dots, dashes and underscores, "
            "the first one a letter or digit",
            id_length=len(volume_id),
        )
    return VolumeNotFoundError(
        f"No volume is called {volume_id!r}; the list of volumes names those that there are",
        id=volume_id,
    )


def _manifest_of(path: Path) -> str:
    return str(path / "zarr.json")


def _stamp_of(manifest: str) -> Stamp | None:
    try:
        status = os.stat(manifest)  # noqa: PTH116  (a third of Path.stat's time)
    except OSError:
        return None
    return (status.st_dev, status.st_ino, status.st_mtime_ns, status.st_size)
