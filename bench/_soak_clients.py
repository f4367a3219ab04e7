"""What the clients of a soak ask for, and how each answer is checked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from _clients import ABSENT, STORED, UNREADABLE, Client, Place, Reply, records, zstd_checked

if TYPE_CHECKING:
    from _soak_run import Soak

V1 = "/v1/volumes"
BRICK_ROUTE = V1 + "/{volume_id}/{revision}/bricks/{level}/{t}/{c}/{z}/{y}/{x}"
# What a client may be told while volumes are replaced and damaged and workers die: all else is
EXPECTED = {"corrupt-brick", "corrupt-volume", "revision-gone", "busy", "render-timeout"}
EXPECTED |= {"volume-not-found", "volume-replaced", "render-crashed", "incomplete-volume"}
BATCH_BRICKS = 24


@dataclass(frozen=True)
class Job:
    """One kind of request."""

    name: str
    route: str  # as the description of the server has it
    weight: float
    do: Callable[[Soak, Client, str, np.random.Generator], None]


def detail(soak: Soak, client: Client, volume_id: str) -> dict[str, Any] | None:
    """Metadata of a volume; None where it cannot be had just now."""
    reply = client.ask("GET", f"{V1}/{volume_id}")
    if reply.status != 200:
        expect_error(soak, "metadata", volume_id, reply)
        return None
    found: dict[str, Any] = reply.json()
    return found


def expect_error(soak: Soak, name: str, volume_id: str, reply: Reply) -> None:
    """An error must be of a kind that a fault explains."""
    kind = reply.kind()
    soak.count_error(kind)
    if kind == "revision-gone" and volume_id == "replaced":
        soak.saw("volume replaced", kind)
    elif kind in ("corrupt-brick", "corrupt-volume") and volume_id == "damaged":
        soak.saw("shard cut short", kind)
    elif kind not in EXPECTED or kind in ("revision-gone", "corrupt-brick", "corrupt-volume"):
        soak.is_wrong(f"{name} of {volume_id}: {reply.status} {kind}: {reply.body[:300]!r}")


def some_place(soak: Soak, revision: str, chance: np.random.Generator) -> Place:
    """Any brick of any level."""
    volume = soak.truth.volume(revision)
    level = int(chance.integers(len(volume.levels)))
    z, y, x = (int(chance.integers(n)) for n in volume.levels[level].grid_zyx)
    return level, 0, 0, z, y, x


def address(volume_id: str, revision: str, place: Place) -> str:
    """Of one brick."""
    return f"{V1}/{volume_id}/{revision}/bricks/" + "/".join(map(str, place))


def ask_metadata(soak: Soak, client: Client, volume_id: str, _chance: np.random.Generator) -> None:
    """The list, and one volume of it."""
    assert client.ask("GET", V1).status == 200
    if (found := detail(soak, client, volume_id)) is not None:
        soak.truth.volume(found["revision"])  # a revision that never was would be a KeyError
    soak.count("metadata")


def ask_brick(soak: Soak, client: Client, volume_id: str, chance: np.random.Generator) -> None:
    """Some bricks one by one, as stored or plain; and each once more, for its 304."""
    if (found := detail(soak, client, volume_id)) is None:
        return
    for _ in range(8):
        place = some_place(soak, found["revision"], chance)
        path = address(volume_id, found["revision"], place)
        coding = "zstd" if chance.random() < 0.7 else "identity"
        reply = client.ask("GET", path, accept_encoding=coding)
        if reply.status not in (200, 204):
            expect_error(soak, "brick", volume_id, reply)
            continue
        truth = soak.truth.stored(found["revision"], place)
        body: bytes | None = reply.body if reply.status == 200 else None
        if truth is not None and coding == "identity":
            truth = zstd_checked(truth)
        elif body is not None:
            zstd_checked(body)
        if body != truth:
            soak.is_wrong(f"WRONG BYTES: {path} as {coding}")
        soak.count(f"brick, {coding}", verified=1)
        again = client.ask("GET", path, accept_encoding=coding, if_none_match=reply.headers["etag"])
        if again.status == 304:
            soak.count("304")
        else:
            expect_error(soak, "304", volume_id, again)


def ask_batch(soak: Soak, client: Client, volume_id: str, chance: np.random.Generator) -> None:
    """Many bricks in one stream; each record is compared."""
    if (found := detail(soak, client, volume_id)) is None:
        return
    revision = found["revision"]
    places = [some_place(soak, revision, chance) for _ in range(BATCH_BRICKS)]
    body = {"revision": revision, "bricks": places}
    reply = client.open("POST", f"{V1}/{volume_id}/bricks", body)
    if reply.status != 200:
        expect_error(soak, "batch", volume_id, Reply(reply.status, {}, reply.read()))
        return
    seen = 0
    try:
        for index, status, payload in records(reply, len(places)):
            if status == UNREADABLE:
                expect_error(soak, "batch record", volume_id, Reply(0, {}, payload))
                continue
            assert status in (STORED, ABSENT), status
            truth = soak.truth.stored(revision, places[index])
            if (payload if status == STORED else None) != truth:
                soak.is_wrong(f"WRONG BYTES: batch of {volume_id} {revision}: {places[index]}")
            if status == STORED:
                zstd_checked(payload)
            seen += 1
    except EOFError:
        if volume_id != "replaced":  # only a volume that goes away may cut a stream off
            raise
        soak.saw("volume replaced", "stream cut off")
        client.close()
    soak.count("batch", verified=seen)


def ask_select(soak: Soak, client: Client, volume_id: str, chance: np.random.Generator) -> None:
    """What a view needs; every brick of it must be one of the volume."""
    azimuth = int(chance.integers(360))
    query = f"azimuth={azimuth}&width=128&height=96&preset=microscopy&budget_nbytes=2000000"
    reply = client.ask("GET", f"{V1}/{volume_id}/select?{query}")
    if reply.status != 200:
        expect_error(soak, "select", volume_id, reply)
        return
    found = reply.json()
    for place, nbytes in zip(found["bricks"], found["nbytes"], strict=True):
        stored = soak.truth.stored(found["revision"], tuple(place))
        if nbytes != len(stored or b""):
            soak.is_wrong(f"select of {volume_id}: {place} is said to have {nbytes} bytes")
    soak.count("select")


def ask_render(soak: Soak, client: Client, volume_id: str, chance: np.random.Generator) -> None:
    """A small picture."""
    azimuth = int(chance.integers(0, 360, 1)[0])
    words = f"azimuth={azimuth}&width=64&height=48&preset=microscopy"
    reply = client.ask("GET", f"{V1}/{volume_id}/render?{words}")
    if reply.status != 200:
        kind = reply.kind()
        if reply.status == 503 and kind not in ("no-graphics",):
            assert "retry-after" in reply.headers, "a 503 without Retry-After"
            soak.saw("worker killed", kind)
            soak.count_error(kind)
        else:
            expect_error(soak, "render", volume_id, reply)
        return
    assert reply.body.startswith(b"\x89PNG"), "no PNG"
    soak.count("render")


def ask_zarr(soak: Soak, client: Client, volume_id: str, _chance: np.random.Generator) -> None:
    """The metadata that a Zarr reader begins with."""
    reply = client.ask("GET", f"/zarr/{volume_id}/zarr.json")
    if reply.status != 200:
        expect_error(soak, "zarr", volume_id, reply)
        return
    assert reply.json()["zarr_format"] == 3
    soak.count("zarr")


def ask_precomputed(
    soak: Soak, client: Client, volume_id: str, _chance: np.random.Generator
) -> None:
    """The metadata that Neuroglancer begins with."""
    reply = client.ask("GET", f"/precomputed/{volume_id}/info")
    if reply.status != 200:
        expect_error(soak, "precomputed", volume_id, reply)
        return
    assert reply.json()["type"] == "image"
    soak.count("precomputed")


ALL_JOBS = (
    Job("metadata", V1 + "/{volume_id}", 1, ask_metadata),
    Job("brick", BRICK_ROUTE, 4, ask_brick),
    Job("batch", V1 + "/{volume_id}/bricks", 4, ask_batch),
    Job("select", V1 + "/{volume_id}/select", 2, ask_select),
    Job("render", V1 + "/{volume_id}/render", 1, ask_render),
    Job("zarr", "/zarr/{volume_id}/zarr.json", 0.5, ask_zarr),
    Job("precomputed", "/precomputed/{volume_id}/info", 0.5, ask_precomputed),
)
