"""The answer to a request for one brick: a function of the volume, the address and two headers.

A brick's address holds the revision of its volume, so its bytes never change: the answer can be
kept for ever, and whether a client's copy is good is known without reading anything.
"""

from __future__ import annotations

from dataclasses import dataclass

from octobrick.server.catalog import Catalog, OpenVolume
from octobrick.server.errors import BrickNotFoundError, RevisionGoneError
from octobrick.store import Volume
from octobrick.store.box import Zyx
from octobrick.store.brick_codec import codec_text

Headers = dict[str, str]

IMMUTABLE = "public, max-age=31536000, immutable"  # a year: the longest that HTTP caches honour


@dataclass(frozen=True, slots=True)
class BrickAddress:
    """Where a brick is: volume and revision, then level, time step, channel and grid position."""

    volume_id: str
    revision: str
    level: int
    t: int
    c: int
    brick_zyx: Zyx


@dataclass(frozen=True, slots=True)
class Reply:
    """An HTTP answer as a value."""

    status: int
    headers: Headers
    body: bytes


def brick_reply(
    catalog: Catalog, address: BrickAddress, accept_encoding: str, if_none_match: str
) -> Reply:
    """Answer a request for a brick: 200, 204 where every voxel is the fill value, or 304.

    Safe to call from any thread; blocks on the disk.

    Raises:
        VolumeNotFoundError: no volume has this id.
        RevisionGoneError: the volume has another revision now.
        BrickNotFoundError: the volume has no such level, time step, channel or brick.
        CorruptDataError: the brick cannot be read as it was written.
    """
    return catalog.read(
        address.volume_id, lambda lent: _reply(lent, address, accept_encoding, if_none_match)
    )


def require_revision(volume: Volume, volume_id: str, revision: str) -> None:
    """Refuse a revision that is not the volume's own.

    Raises:
        RevisionGoneError: with the revision that the volume has.
    """
    if revision != volume.revision:
        raise RevisionGoneError(
            f"Volume {volume_id!r} has revision {volume.revision} now; fetch its metadata again",
            id=volume_id,
            current_revision=volume.revision,
        )


def accepts_zstd(accept_encoding: str) -> bool:
    """Whether an Accept-Encoding header (RFC 9110, 12.5.3) names zstd, or everything, with q > 0.

    An absent header accepts anything by the letter; it gets plain bytes, because the programs
    that send none do not decode.
    """
    weights: dict[str, bool] = {}
    for item in accept_encoding.lower().split(","):
        coding, _, parameters = item.partition(";")
        weights[coding.strip()] = _weight(parameters) > 0
    return weights.get("zstd", weights.get("*", False))


def matches_etag(if_none_match: str, etag: str) -> bool:
    """Whether an If-None-Match header (RFC 9110, 13.1.2) names this entity tag."""
    names = (name.strip().removeprefix("W/") for name in if_none_match.split(","))
    return any(name in ("*", etag.removeprefix("W/")) for name in names)


def _reply(
    lent: OpenVolume, address: BrickAddress, accept_encoding: str, if_none_match: str
) -> Reply:
    volume = lent.volume
    _require_brick(volume, address)
    zstd = accepts_zstd(accept_encoding)
    z, y, x = address.brick_zyx
    etag = (
        f'"{volume.revision}-{address.level}.{address.t}.{address.c}.{z}.{y}.{x}'
        f'-{"zstd" if zstd else "identity"}"'
    )
    headers = {"cache-control": IMMUTABLE, "etag": etag, "vary": "Accept-Encoding"}
    if if_none_match and matches_etag(if_none_match, etag):
        return Reply(304, headers, b"")
    read = volume.stored_brick if zstd else volume.brick_code
    body = read(address.level, address.brick_zyx, address.t, address.c)
    headers |= _description(lent, address)
    if body is None:
        return Reply(204, headers, b"")
    headers["content-type"] = "application/octet-stream"
    headers["content-length"] = str(len(body))
    if zstd:
        headers["content-encoding"] = "zstd"
    return Reply(200, headers, body)


def _require_brick(volume: Volume, address: BrickAddress) -> None:
    require_revision(volume, address.volume_id, address.revision)
    if not 0 <= address.level < len(volume.levels):
        raise _no_such("level", address.level, len(volume.levels))
    if not 0 <= address.t < volume.nt:
        raise _no_such("time step", address.t, volume.nt)
    if not 0 <= address.c < volume.nc:
        raise _no_such("channel", address.c, volume.nc)
    grid_zyx = volume.levels[address.level].grid_zyx
    if not all(0 <= i < n for i, n in zip(address.brick_zyx, grid_zyx, strict=True)):
        raise BrickNotFoundError(
            f"Brick {address.brick_zyx} (z, y, x) is outside level {address.level}, which has "
            f"{grid_zyx} bricks",
            brick_zyx=list(address.brick_zyx),
            grid_zyx=list(grid_zyx),
        )


def _no_such(what: str, index: int, count: int) -> BrickNotFoundError:
    return BrickNotFoundError(
        f"The volume has no {what} {index}; it has {count}, counted from 0",
        index=index,
        count=count,
    )


def _description(lent: OpenVolume, address: BrickAddress) -> Headers:
    """What the bytes are, and what is known of them, without decoding them."""
    low, high = lent.ranges(address.level, address.t, address.c)[address.brick_zyx]
    max_error, rmse = lent.fidelity(address.level, address.t, address.c)[address.brick_zyx]
    return {
        "x-octobrick-codec": codec_text(lent.volume.level_codec(address.level)),
        "x-octobrick-dtype": str(lent.volume.dtype),
        "x-octobrick-shape": ",".join(str(n) for n in lent.volume.brick_shape_zyx),
        "x-octobrick-range": f"{low},{high}",
        "x-octobrick-max-error": f"{max_error:.6g}",
        "x-octobrick-rmse": f"{rmse:.6g}",
    }


def _weight(parameters: str) -> float:
    for parameter in parameters.split(";"):
        name, _, value = parameter.partition("=")
        if name.strip() == "q":
            try:
                return float(value)
            except ValueError:
                return 0.0  # not a weight: the client gets what everyone understands
    return 1.0
