"""The answer to a request for one brick: a function of the volume, the address and two headers.

A brick's address holds the revision of its volume, so its bytes never change: the answer can be
kept for ever, and whether a client's copy is good is known without reading anything.

The answer has one meaning and is found in two ways: from what is in memory, without waiting, or
with all the time that the disk takes. Where to look is a :class:`_Source`; the rest is the same.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, Protocol

from octobrick.server.bricks.brick_headers import BrickHead, BrickHeaders, RawHeaders, header_lines
from octobrick.server.bricks.places import require_place
from octobrick.server.byte_cache import ByteCache
from octobrick.server.catalog import Catalog, OpenVolume
from octobrick.server.errors import BrickNotFoundError
from octobrick.server.reply import IMMUTABLE, accepts_zstd, matches_etag, require_revision
from octobrick.store import LocalVolume
from octobrick.store.box import Zyx
from octobrick.store.stored_gradients import LocalGradients

BrickKind = Literal["voxels", "gradients"]
Content = bytes | bytearray

_CACHE_CONTROL = (b"cache-control", IMMUTABLE.encode())
_KEPT_HEADERS = 64  # Accept-Encoding as clients write it: each kind of client always alike
_KEPT_HEADER_NBYTES = 128
_CONTENT_TYPE = (b"content-type", b"application/octet-stream")
_VARY = (b"vary", b"Accept-Encoding")


@dataclass(slots=True)
class BrickAddress:
    """Where a brick is: volume and revision, then level, time step, channel and grid position."""

    volume_id: str
    revision: str
    level: int
    t: int
    c: int
    brick_zyx: Zyx
    kind: BrickKind = "voxels"


@dataclass(slots=True)
class BrickReply:
    """The answer as a value.

    Attributes:
        status: 200, 204 or 304.
        known: headers, but for the length of a body.
        known_lines: the same as lines of text.
        body: empty where there is none.
    """

    status: int
    known: RawHeaders
    known_lines: bytes
    body: Content = b""

    @property
    def headers(self) -> RawHeaders:
        """All headers as ASGI has them."""
        if self.status != 200:
            return self.known
        return [*self.known, (b"content-length", b"%d" % len(self.body))]

    @property
    def lines(self) -> bytes:
        """The same as lines of text."""
        if self.status != 200:
            return self.known_lines
        return b"%bcontent-length: %d\r\n" % (self.known_lines, len(self.body))


class BrickReplies:
    """Answers requests for bricks. Safe to use from several threads.

    Args:
        catalog: the volumes.
        decoded: keeps bricks without zstd, for the clients that do not take it.
    """

    def __init__(self, catalog: Catalog, decoded: ByteCache[Hashable]) -> None:
        self._catalog = catalog
        self._decoded = decoded
        self._accepts_zstd = lru_cache(_KEPT_HEADERS)(accepts_zstd)

    def reply(self, address: BrickAddress, accept_encoding: str, if_none_match: str) -> BrickReply:
        """Answer a request for a brick: 200, 204 where it is absent, or 304; blocks on the disk.

        Raises:
            VolumeNotFoundError: no volume has this id.
            RevisionGoneError: the volume has another revision now.
            BrickNotFoundError: the volume has no such level, time step, channel or brick.
            CorruptDataError: the brick cannot be read as it was written.
        """

        def use(lent: OpenVolume) -> BrickReply:
            source = _Disk(lent, address, self._decoded)
            return _reply(lent, address, self._zstd(accept_encoding), if_none_match, source)

        return self._catalog.read(address.volume_id, use)

    def reply_now(
        self, address: BrickAddress, accept_encoding: str, if_none_match: str
    ) -> BrickReply | None:
        """The same from what is in memory; None where `reply` would have to wait, or to explain.

        Raises:
            RevisionGoneError, BrickNotFoundError: as `reply`.
        """

        def use(lent: OpenVolume) -> BrickReply:
            source = _Memory(lent, address, self._decoded)
            return _reply(lent, address, self._zstd(accept_encoding), if_none_match, source)

        return self._catalog.read_now(address.volume_id, use)

    def _zstd(self, accept_encoding: str) -> bool:
        if len(accept_encoding) > _KEPT_HEADER_NBYTES:
            return accepts_zstd(accept_encoding)
        return self._accepts_zstd(accept_encoding)


class _Source(Protocol):
    """Where a brick and what is known of it come from."""

    def headers(self) -> BrickHeaders:
        """What is known of the bricks of this level, time step and channel."""

    def stored(self) -> Content | None:
        """The frame as on disk."""

    def decoded(self) -> Content | None:
        """The same without zstd."""


@dataclass(slots=True)
class _Disk:
    """Takes the time that it takes."""

    lent: OpenVolume
    address: BrickAddress
    cache: ByteCache[Hashable]

    def headers(self) -> BrickHeaders:
        at = self.address
        return BrickHeaders.of(self.lent, at.kind, at.level, at.t, at.c)

    def stored(self) -> Content | None:
        at = self.address
        return _bricks(self.lent.volume, at.kind).stored_brick(at.level, at.brick_zyx, at.t, at.c)

    def decoded(self) -> Content | None:
        volume, at = self.lent.volume, self.address

        def make() -> bytes | None:
            if at.kind == "voxels":
                return volume.brick_code(at.level, at.brick_zyx, at.t, at.c)
            return _gradients(volume).code(at.level, at.brick_zyx, at.t, at.c)

        return self.cache.get(_key(self.lent, at), make)


@dataclass(slots=True)
class _Memory:
    """Raises BlockingIOError instead of waiting."""

    lent: OpenVolume
    address: BrickAddress
    cache: ByteCache[Hashable]

    def headers(self) -> BrickHeaders:
        at = self.address
        return BrickHeaders.now(self.lent, at.kind, at.level, at.t, at.c)

    def stored(self) -> Content | None:
        at = self.address
        bricks = _bricks(self.lent.volume, at.kind)
        return bricks.stored_brick_now(at.level, at.brick_zyx, at.t, at.c)

    def decoded(self) -> Content | None:
        content = self.cache.peek(_key(self.lent, self.address))
        if content is None:
            raise BlockingIOError
        return content


def _reply(
    lent: OpenVolume,
    address: BrickAddress,
    zstd: bool,
    if_none_match: str,
    source: _Source,
) -> BrickReply:
    require_revision(lent.volume, address.volume_id, address.revision)
    key = (address.kind, address.level, address.t, address.c, address.brick_zyx, zstd)
    head: BrickHead | None = lent.heads.get(key)
    if head is None:
        _require_brick(lent.volume, address)
        etag = _etag(address, zstd)
        if if_none_match and matches_etag(if_none_match, etag):
            headers = _cache_headers(etag)
            return BrickReply(304, headers, header_lines(headers))
        head = _head(etag, zstd, source.headers().of_brick(address.brick_zyx))
        head.keep(lent, key)
    elif if_none_match and matches_etag(if_none_match, head.etag):
        return BrickReply(304, head.cached, head.cached_lines)
    body = source.stored() if zstd else source.decoded()
    if body is None:
        return BrickReply(204, head.absent, head.absent_lines)
    return BrickReply(200, head.present, head.present_lines, body)


def _etag(address: BrickAddress, zstd: bool) -> str:
    z, y, x = address.brick_zyx
    return (
        f'"{address.revision}-{address.level}.{address.t}.{address.c}.{z}.{y}.{x}'
        f'-{"zstd" if zstd else "identity"}"'
    )


def _head(etag: str, zstd: bool, known: RawHeaders) -> BrickHead:
    cached = _cache_headers(etag)
    absent = [*cached, *known]
    encoding = [(b"content-encoding", b"zstd")] if zstd else []
    return BrickHead(etag, cached, absent, [*absent, _CONTENT_TYPE, *encoding])


def _cache_headers(etag: str) -> RawHeaders:
    return [_CACHE_CONTROL, (b"etag", etag.encode()), _VARY]


def _bricks(volume: LocalVolume, kind: BrickKind) -> LocalVolume | LocalGradients:
    return volume if kind == "voxels" else _gradients(volume)


def _gradients(volume: LocalVolume) -> LocalGradients:
    assert volume.gradients is not None  # _require_brick saw to it
    return volume.gradients


def _key(lent: OpenVolume, at: BrickAddress) -> Hashable:
    # Not the revision: what was read while a volume was replaced may be the other one's, and is
    # thrown away with the one that is lent.
    return (lent.serial, at.kind, at.level, at.t, at.c, at.brick_zyx)


def _require_brick(volume: LocalVolume, address: BrickAddress) -> None:
    level, (z, y, x) = address.level, address.brick_zyx
    require_place(volume, level, address.t, address.c)
    nz, ny, nx = grid_zyx = volume.levels[level].grid_zyx
    if not (0 <= z < nz and 0 <= y < ny and 0 <= x < nx):
        raise BrickNotFoundError(
            f"Brick {address.brick_zyx} (z, y, x) is outside level {level}, which has "
            f"{grid_zyx} bricks",
            brick_zyx=list(address.brick_zyx),
            grid_zyx=list(grid_zyx),
        )
    if address.kind == "gradients":
        stored = () if volume.gradients is None else volume.gradients.levels
        if level not in stored:
            raise BrickNotFoundError(
                f"Level {level} stores no gradients; levels {list(stored)} do",
                level=level,
                levels=list(stored),
            )
