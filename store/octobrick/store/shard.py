"""Shard files: many bricks and an index of them, in the layout of Zarr's sharding codec.

::

    brick frames, in the order they were appended, without gaps
    index: per brick slot two little-endian uint64, offset and nbytes; both 2^64 - 1 if absent
    crc32c of the index, little-endian uint32

Slots run z slowest, x fastest. The index stands at the end, so a shard is written front to back
with nothing but the index kept in memory.
"""

from __future__ import annotations

import errno
import os
import threading
from collections import OrderedDict
from collections.abc import Mapping
from pathlib import Path

import google_crc32c
import numpy as np
import xxhash
from numpy.typing import NDArray

from octobrick.codec.errors import CorruptBrickError
from octobrick.store.box import Zyx
from octobrick.store.errors import VolumeFormatError

ABSENT = 2**64 - 1
_CRC_NBYTES = 4
_SLOT_NBYTES = 16
_HASH_NBYTES = 1 << 20
_OPEN_SHARDS_MAX = 128  # file descriptors and indexes a reader keeps; well under ulimit -n of 1024


def new_digest() -> xxhash.xxh3_128:
    """The digest of a shard file: it tells damage, and is no defence against a forger."""
    return xxhash.xxh3_128()


class ShardWriter:
    """Writes one shard under a temporary name and puts it in place when finished.

    Not thread-safe: the bytes depend on the order of the calls, which is the caller's to fix.
    """

    _descriptor = -1

    def __init__(self, path: Path, nslots: int) -> None:
        self.path = path
        self._part = path.with_name(path.name + ".part")
        self._index = np.full((nslots, 2), ABSENT, dtype="<u8")
        self._digest = new_digest()
        self._nbytes = 0
        path.parent.mkdir(parents=True, exist_ok=True)
        self._part.unlink(missing_ok=True)

    @classmethod
    def resume(cls, path: Path, index: NDArray[np.uint64], nbytes: int) -> ShardWriter:
        """Go on from a checkpoint: what was written since is cut off.

        Raises:
            OSError: the file is not there any more.
            ValueError: it is shorter than it was.
        """
        part = path.with_name(path.name + ".part")
        if not part.exists():  # it was finished after the checkpoint
            path.rename(part)
        digest = new_digest()
        with part.open("r+b") as file:
            left = nbytes
            while left:
                piece = file.read(min(left, _HASH_NBYTES))
                if not piece:
                    raise ValueError(f"{part}: {left} of {nbytes} bytes are missing")
                digest.update(piece)
                left -= len(piece)
            file.truncate(nbytes)
        writer = cls.__new__(cls)
        writer.path, writer._part = path, part
        writer._index, writer._nbytes, writer._digest = index.copy(), nbytes, digest
        return writer

    @property
    def index(self) -> NDArray[np.uint64]:
        """Offset and size of each brick so far, as in the file."""
        return self._index

    @property
    def nbytes(self) -> int:
        """Bytes written so far."""
        return self._nbytes

    def sync(self) -> None:
        """Make what was appended durable."""
        was_open = self._descriptor >= 0
        os.fsync(self._opened())
        if not was_open:
            self.release()

    def release(self) -> None:
        """Close the file until something is appended again: any number can be under way."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def __del__(self) -> None:
        self.release()

    def append(self, slot: int, frame: bytes) -> None:
        """Add the frame of the brick in this slot."""
        self._index[slot] = (self._nbytes, len(frame))
        self._write(frame)

    def finish(self) -> tuple[int, str]:
        """Write the index, make the file durable and visible; returns (nbytes, digest)."""
        index = self._index.tobytes()
        crc = google_crc32c.value(index).to_bytes(_CRC_NBYTES, "little")
        self._write(index + crc)
        self.sync()
        self.release()
        self._part.replace(self.path)
        return self._nbytes, self._digest.hexdigest()

    def _write(self, data: bytes) -> None:
        left = memoryview(data)
        while left:
            left = left[os.write(self._opened(), left) :]
        self._digest.update(data)
        self._nbytes += len(data)

    def _opened(self) -> int:
        if self._descriptor < 0:
            flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC
            self._descriptor = os.open(self._part, flags, 0o666)
        return self._descriptor


class ShardReader:
    """Reads stored bricks from one shard file; the index is parsed and checked once.

    Safe to use from several threads. Keeps the file open, so a shard that is replaced on disk
    goes on giving the bytes that it had.

    Raises:
        VolumeFormatError: the index is cut short, damaged, or points outside the file.
    """

    def __init__(self, path: Path, nslots: int) -> None:
        self.path = path
        self._descriptor = -1  # as after `close`, if the file cannot be opened
        self._has_nowait = hasattr(os, "RWF_NOWAIT")  # Linux; not every file system has it
        self._descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        try:
            self._index = self._read_index(nslots)
        except BaseException:
            self.close()
            raise

    def read(self, slot: int) -> bytes | None:
        """The frame in a slot as stored, or None where the brick is absent.

        Raises:
            CorruptBrickError: the file ends inside the brick.
        """
        offset, nbytes = (int(n) for n in self._index[slot])
        if offset == ABSENT:
            return None
        frame = os.pread(self._descriptor, nbytes, offset)
        if len(frame) != nbytes:
            raise CorruptBrickError(
                f"{self.path}: the file ends inside a brick: {len(frame)} of {nbytes} bytes at "
                f"offset {offset}",
                path=str(self.path),
                expected_nbytes=nbytes,
                actual_nbytes=len(frame),
            )
        return frame

    def nbytes_of(self, slots: NDArray[np.intp]) -> NDArray[np.int64]:
        """The sizes of the frames in some slots; 0 where the brick is absent."""
        found = self._index[slots]
        nbytes = np.where(found[:, 0] == ABSENT, np.uint64(0), found[:, 1])
        return nbytes.astype(np.int64)

    def read_now(self, slot: int) -> bytearray | None:
        """The same where the system has the bytes in memory; never waits for the disk.

        Raises:
            BlockingIOError: `read` would have to wait, or has an error to explain, or the system
                cannot tell.
        """
        offset, nbytes = self._index[slot].tolist()
        if offset == ABSENT:
            return None
        if self._has_nowait:
            frame = bytearray(nbytes)
            try:
                # Less than asked for: the rest is not in memory, or not in the file.
                if os.preadv(self._descriptor, [frame], offset, os.RWF_NOWAIT) == nbytes:
                    return frame
            except BlockingIOError:
                raise
            except OSError as error:
                if error.errno not in (errno.EOPNOTSUPP, errno.EINVAL, errno.ENOSYS):
                    raise BlockingIOError(error.errno, "left to a read that may wait") from error
                self._has_nowait = False
        raise BlockingIOError(errno.EAGAIN, "not in memory")

    def close(self) -> None:
        """Release the file; reading afterwards is an error."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def __del__(self) -> None:
        # A reader that another thread dropped from the cache closes when its last user is done.
        self.close()

    def _read_index(self, nslots: int) -> NDArray[np.uint64]:
        tail_nbytes = nslots * _SLOT_NBYTES + _CRC_NBYTES
        file_nbytes = os.fstat(self._descriptor).st_size
        if file_nbytes < tail_nbytes:
            raise self._damaged(
                f"{file_nbytes} bytes are too few for an index of {nslots} bricks "
                f"({tail_nbytes} bytes)"
            )
        tail = os.pread(self._descriptor, tail_nbytes, file_nbytes - tail_nbytes)
        stored = int.from_bytes(tail[-_CRC_NBYTES:], "little")
        computed = google_crc32c.value(tail[:-_CRC_NBYTES])
        if stored != computed:
            raise self._damaged(
                f"checksum mismatch: the index stores {stored:08x}, its bytes give {computed:08x}"
            )
        index = np.frombuffer(tail, dtype="<u8", count=2 * nslots).reshape(nslots, 2)
        offset, nbytes = index[index[:, 0] != ABSENT].T
        data_nbytes = np.uint64(file_nbytes - tail_nbytes)
        if bool(np.any((offset > data_nbytes) | (nbytes > data_nbytes - offset))):
            raise self._damaged(f"a brick lies outside the {data_nbytes} bytes of brick data")
        return index

    def _damaged(self, what: str) -> VolumeFormatError:
        return VolumeFormatError(
            f"{self.path}: damaged shard index: {what}; restore the file or ingest again",
            path=str(self.path),
        )


class ShardCache:
    """The shards of one level, opened on demand, the least recently used closed first.

    Safe to use from several threads.

    Args:
        folder: the level's array.
        shard_bricks_zyx: bricks per shard along each axis.
        shard_nbytes: the size of every shard that was written, by its key. A shard that is not
            listed holds absent bricks only; one that is listed must be there, whole.
        key_suffix: of the keys, where the array has more axes than z, y, x.
    """

    def __init__(
        self,
        folder: Path,
        shard_bricks_zyx: Zyx,
        shard_nbytes: Mapping[str, int],
        key_suffix: str = "",
    ) -> None:
        self._key_suffix = key_suffix
        self._folder = folder
        self._shard_bricks_zyx = shard_bricks_zyx
        self._shard_nbytes = shard_nbytes
        self._lock = threading.Lock()
        self._open: OrderedDict[str, ShardReader | None] = OrderedDict()

    def read(self, brick_zyx: Zyx, t: int, c: int) -> bytes | None:
        """The stored frame of a brick, or None where it is absent."""
        reader = self._reader(self._key(brick_zyx, t, c))
        return None if reader is None else reader.read(slot_of(brick_zyx, self._shard_bricks_zyx))

    def nbytes_of(self, bricks_zyx: NDArray[np.intp], t: int, c: int) -> NDArray[np.int64]:
        """The sizes (n,) of the stored frames of bricks (n, 3); 0 where one is absent."""
        shards, within = np.divmod(bricks_zyx, self._shard_bricks_zyx)
        _, ny, nx = self._shard_bricks_zyx
        slots = (within[:, 0] * ny + within[:, 1]) * nx + within[:, 2]
        nbytes = np.zeros(len(bricks_zyx), np.int64)
        numbers = np.ravel_multi_index(tuple(shards.T), tuple(shards.max(axis=0, initial=0) + 1))
        order = np.argsort(numbers, kind="stable")
        starts = np.flatnonzero(np.diff(numbers[order], prepend=-1))
        for at in np.split(order, starts[1:]) if len(order) else ():
            z, y, x = bricks_zyx[at[0]].tolist()
            reader = self._reader(self._key((z, y, x), t, c))
            if reader is not None:
                nbytes[at] = reader.nbytes_of(slots[at])
        return nbytes

    def read_now(self, brick_zyx: Zyx, t: int, c: int) -> bytearray | None:
        """The same, without waiting for the disk or for another thread.

        Raises:
            BlockingIOError: `read` would have to wait, or has an error to explain.
        """
        key = self._key(brick_zyx, t, c)
        if key not in self._shard_nbytes:
            return None
        if not self._lock.acquire(blocking=False):  # held while a shard is opened
            raise BlockingIOError(errno.EAGAIN, "another thread opens a shard")
        try:
            reader = self._open.get(key)
            if reader is None:
                raise BlockingIOError(errno.EAGAIN, "the shard is not open")
            self._open.move_to_end(key)
        finally:
            self._lock.release()
        return reader.read_now(slot_of(brick_zyx, self._shard_bricks_zyx))

    def path_of(self, brick_zyx: Zyx, t: int, c: int) -> Path:
        """The file that holds, or would hold, a brick."""
        return self._folder / self._key(brick_zyx, t, c)

    def close(self) -> None:
        """Let go of all files."""
        with self._lock:
            self._open.clear()

    def _key(self, brick_zyx: Zyx, t: int, c: int) -> str:
        return shard_key(brick_zyx, self._shard_bricks_zyx, t, c) + self._key_suffix

    def _reader(self, key: str) -> ShardReader | None:
        with self._lock:
            if key in self._open:
                self._open.move_to_end(key)
                return self._open[key]
            reader = self._open_shard(key) if key in self._shard_nbytes else None
            self._open[key] = reader
            if len(self._open) > _OPEN_SHARDS_MAX:
                self._open.popitem(last=False)
            return reader

    def _open_shard(self, key: str) -> ShardReader:
        path, (nz, ny, nx) = self._folder / key, self._shard_bricks_zyx
        try:
            actual_nbytes = path.stat().st_size
            if actual_nbytes == self._shard_nbytes[key]:
                return ShardReader(path, nz * ny * nx)
            state = f"has {actual_nbytes} bytes"
        except FileNotFoundError:
            state = "is missing"
        raise VolumeFormatError(
            f"{path}: the shard {state}, the manifest says {self._shard_nbytes[key]} bytes; "
            "restore the file or ingest again",
            path=str(path),
            expected_nbytes=self._shard_nbytes[key],
        )


def index_nbytes(nslots: int) -> int:
    """Bytes of a shard beside its frames."""
    return nslots * _SLOT_NBYTES + _CRC_NBYTES


def shard_key(brick_zyx: Zyx, shard_bricks_zyx: Zyx, t: int, c: int) -> str:
    """The path of a brick's shard below its level, in Zarr's default chunk key encoding."""
    (z, y, x), (nz, ny, nx) = brick_zyx, shard_bricks_zyx
    return f"c/{t}/{c}/{z // nz}/{y // ny}/{x // nx}"


def slot_of(brick_zyx: Zyx, shard_bricks_zyx: Zyx) -> int:
    """A brick's place in the index of its shard, z slowest, x fastest."""
    (z, y, x), (nz, ny, nx) = brick_zyx, shard_bricks_zyx
    return (z % nz * ny + y % ny) * nx + x % nx
