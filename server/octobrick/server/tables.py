"""Tables of what is known per brick, as they go over the network: made once, then kept."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import CorruptDataError
from octobrick.server.catalog import Catalog, OpenVolume
from octobrick.server.places import require_place
from octobrick.server.reply import IMMUTABLE, Reply, accepts_zstd, matches_etag, require_revision
from octobrick.store.frame import compress, decompress

TableKind = Literal["range", "fidelity"]

ZSTD_LEVEL: Final = 3
"""Higher ones win a few percent of what is sent once, and take many times as long."""


@dataclass(frozen=True, slots=True)
class TableAddress:
    """Which table: volume and revision, then kind, level, time step and channel."""

    volume_id: str
    revision: str
    kind: TableKind
    level: int
    t: int
    c: int


@dataclass(frozen=True, slots=True)
class Table:
    """A table as one zstd frame.

    Attributes:
        frame: of little-endian values in C order.
        dtype: of the values, by its NumPy name.
        shape: (nz, ny, nx, 2).
        nbytes: of the values.
    """

    frame: bytes
    dtype: str
    shape: tuple[int, ...]
    nbytes: int

    @classmethod
    def of(cls, values: NDArray[Any]) -> Table:
        """The table of an array."""
        little = np.ascontiguousarray(values, values.dtype.newbyteorder("<"))
        frame = compress(little.reshape(-1).view(np.uint8).data, ZSTD_LEVEL)
        return cls(frame, values.dtype.name, values.shape, little.nbytes)


class TableCache:
    """The tables that were asked for last, compressed, within a number of bytes.

    A table is made by one thread at a time; whoever wants the same waits for it. Safe to use from
    any thread.

    Args:
        nbytes_max: of the frames together; one that is larger is made each time.
    """

    def __init__(self, nbytes_max: int) -> None:
        self._nbytes_max = nbytes_max
        self._nbytes = 0
        self._kept: OrderedDict[TableAddress, Table] = OrderedDict()
        self._lock = threading.Lock()
        self._making = threading.Lock()
        self._hits = self._misses = 0

    def get(self, address: TableAddress, make: Callable[[], Table]) -> Table:
        """The table of an address, which is made where it is not there."""
        table = self._look_up(address)
        if table is not None:
            return table
        with self._making:
            table = self._look_up(address)
            if table is None:
                table = make()
                self._keep(address, table)
        return table

    def stats(self) -> dict[str, float]:
        """Bytes and tables that are kept, and how often one was found or made."""
        with self._lock:
            return {
                "nbytes": self._nbytes,
                "tables": len(self._kept),
                "hits": self._hits,
                "misses": self._misses,
            }

    def _look_up(self, address: TableAddress) -> Table | None:
        with self._lock:
            table = self._kept.get(address)
            if table is not None:
                self._kept.move_to_end(address)
                self._hits += 1
            return table

    def _keep(self, address: TableAddress, table: Table) -> None:
        with self._lock:
            self._misses += 1
            if len(table.frame) > self._nbytes_max:
                return
            self._kept[address] = table
            self._nbytes += len(table.frame)
            while self._nbytes > self._nbytes_max:
                _, oldest = self._kept.popitem(last=False)
                self._nbytes -= len(oldest.frame)


def table_reply(
    catalog: Catalog,
    tables: TableCache,
    address: TableAddress,
    accept_encoding: str,
    if_none_match: str,
) -> Reply:
    """Answer a request for a table: 200, or 304.

    Safe to call from any thread; blocks on the disk.

    Raises:
        VolumeNotFoundError: no volume has this id.
        RevisionGoneError: the volume has another revision now.
        BrickNotFoundError: the volume has no such level, time step or channel.
        CorruptDataError: the table cannot be read.
    """

    def reply(lent: OpenVolume) -> Reply:
        volume = lent.volume
        require_revision(volume, address.volume_id, address.revision)
        require_place(volume, address.level, address.t, address.c)
        zstd = accepts_zstd(accept_encoding)
        etag = (
            f'"{volume.revision}-{address.kind}-{address.level}.{address.t}.{address.c}'
            f'-{"zstd" if zstd else "identity"}"'
        )
        headers = {"cache-control": IMMUTABLE, "etag": etag, "vary": "Accept-Encoding"}
        if if_none_match and matches_etag(if_none_match, etag):
            return Reply(304, headers, b"")
        table = tables.get(address, lambda: _made(lent, address))
        body = table.frame if zstd else decompress(table.frame, table.nbytes)
        headers |= {
            "content-type": "application/octet-stream",
            "content-length": str(len(body)),
            "x-octobrick-dtype": table.dtype,
            "x-octobrick-shape": ",".join(str(n) for n in table.shape),
        }
        if zstd:
            headers["content-encoding"] = "zstd"
        return Reply(200, headers, body)

    return catalog.read(address.volume_id, reply)


def _made(lent: OpenVolume, address: TableAddress) -> Table:
    values = lent.ranges if address.kind == "range" else lent.fidelity
    table = Table.of(values(address.level, address.t, address.c))
    if not lent.is_current():  # it may be of another revision, and must not be kept under this one
        raise CorruptDataError("The volume was replaced while a table of it was read")
    return table
