"""Tables of what is known per brick, as they go over the network: made once, then kept."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from octobrick.codec.errors import CorruptDataError
from octobrick.server.bricks.places import require_place
from octobrick.server.byte_cache import ByteCache
from octobrick.server.catalog import Catalog, OpenVolume
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


TableCache = ByteCache[TableAddress]
"""Keeps tables as the zstd frames that they travel as."""


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
        dtype = volume.dtype if address.kind == "range" else np.dtype(np.float32)
        shape = (*volume.levels[address.level].grid_zyx, 2)
        frame = tables.get(address, lambda: _frame(lent, address))
        assert frame is not None  # a table may be empty of news, but is there
        body = frame if zstd else decompress(frame, math.prod(shape) * dtype.itemsize)
        headers |= {
            "content-type": "application/octet-stream",
            "content-length": str(len(body)),
            "x-octobrick-dtype": dtype.name,
            "x-octobrick-shape": ",".join(map(str, shape)),
        }
        if zstd:
            headers["content-encoding"] = "zstd"
        return Reply(200, headers, body)

    return catalog.read(address.volume_id, reply)


def _frame(lent: OpenVolume, address: TableAddress) -> bytes:
    """The values of a table, little-endian and in C order, as one zstd frame."""
    table = lent.ranges if address.kind == "range" else lent.fidelity
    values = table(address.level, address.t, address.c)
    little = np.ascontiguousarray(values, values.dtype.newbyteorder("<"))
    frame = compress(little.tobytes(), ZSTD_LEVEL)
    if not lent.is_current():  # it may be of another revision, and must not be kept under this one
        raise CorruptDataError("The volume was replaced while a table of it was read")
    return frame
