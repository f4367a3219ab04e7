"""What readers of other formats ask for in a soak: chunks, compared with the decoded volume."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from _clients import Client, Place, zstd_checked
from _soak_clients import detail, expect_error, some_place

if TYPE_CHECKING:
    from _soak_run import Soak

    from octobrick.store import Volume

CHUNKS = 6
DOCUMENTS = {"zarr": "zarr.json", "zarr2": ".zattrs", "precomputed": "info"}


def ask_zarr(soak: Soak, client: Client, volume_id: str, chance: np.random.Generator) -> None:
    """Chunks of Zarr v3."""
    _ask_chunks(soak, client, "zarr", volume_id, chance)


def ask_zarr2(soak: Soak, client: Client, volume_id: str, chance: np.random.Generator) -> None:
    """Chunks of Zarr v2."""
    _ask_chunks(soak, client, "zarr2", volume_id, chance)


def ask_precomputed(
    soak: Soak, client: Client, volume_id: str, chance: np.random.Generator
) -> None:
    """Chunks of Neuroglancer's format."""
    _ask_chunks(soak, client, "precomputed", volume_id, chance)


def _ask_chunks(
    soak: Soak, client: Client, route: str, volume_id: str, chance: np.random.Generator
) -> None:
    """The metadata and some chunks of a pinned revision; each chunk once more, for its 304."""
    if (found := detail(soak, client, volume_id)) is None:
        return
    revision = found["revision"]
    base = f"/{route}/{volume_id}@{revision}"
    reply = client.ask("GET", f"{base}/{DOCUMENTS[route]}")
    if reply.status != 200:
        expect_error(soak, route, volume_id, reply)
        return
    reply.json()
    volume = soak.truth.volume(revision)
    for _ in range(CHUNKS):
        place = some_place(soak, revision, chance)
        path = f"{base}/{_key(route, volume, place)}"
        coding = "zstd" if chance.random() < 0.5 else "identity"
        reply = client.ask("GET", path, accept_encoding=coding)
        truth = _truth(soak, route, revision, place)
        if reply.status == 200:
            is_zstd = route != "precomputed" or reply.headers.get("content-encoding") == "zstd"
            if (zstd_checked(reply.body) if is_zstd else reply.body) != truth:
                soak.is_wrong(f"WRONG BYTES: {path} as {coding}")
        elif reply.status != 404 or reply.kind() == "volume-not-found":
            expect_error(soak, route, volume_id, reply)
            continue
        elif truth is not None:
            soak.is_wrong(f"WRONG BYTES: {path} is said to be absent")
        soak.count(f"{route}, chunk", verified=1)
        if reply.status == 200:
            etag = reply.headers["etag"]
            again = client.ask("GET", path, accept_encoding=coding, if_none_match=etag)
            if again.status == 304:
                soak.count("304")
            else:
                expect_error(soak, "304", volume_id, again)


def _key(route: str, volume: Volume, place: Place) -> str:
    level, t, c, z, y, x = place
    if route != "precomputed":
        return "/".join(map(str, (level, *(("c",) if route == "zarr" else ()), t, c, z, y, x)))
    starts = [i * n for i, n in zip((z, y, x), volume.brick_shape_zyx, strict=True)]
    lengths = _cut(volume, place)
    boxes = [f"{start}-{start + n}" for start, n in zip(starts, lengths, strict=True)]
    return f"{level}/" + "_".join(reversed(boxes))


def _truth(soak: Soak, route: str, revision: str, place: Place) -> bytes | None:
    """Little-endian voxels of a chunk; None where it is absent."""
    if soak.truth.stored(revision, place) is None:
        return None
    volume = soak.truth.volume(revision)
    level, t, c, z, y, x = place
    voxels = volume.brick(level, (z, y, x), t, c)
    if route == "precomputed":
        nz, ny, nx = _cut(volume, place)
        voxels = voxels[:nz, :ny, :nx]
    return voxels.astype(voxels.dtype.newbyteorder("<")).tobytes()


def _cut(volume: Volume, place: Place) -> list[int]:
    shape_zyx = volume.levels[place[0]].shape_zyx
    bricks = zip(place[3:], volume.brick_shape_zyx, shape_zyx, strict=True)
    return [min(brick, size - i * brick) for i, brick, size in bricks]
