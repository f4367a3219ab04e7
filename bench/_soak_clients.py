"""What the clients of a soak ask for, and how each answer is checked."""

from __future__ import annotations

import http.client
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
ORIGIN = "https://viewer.example"
MAGIC = {"png": b"\x89PNG", "webp": b"RIFF", "jpeg": b"\xff\xd8\xff"}


class PageClient(Client):
    """A client as a page of another origin is one, which may read every answer."""

    def open(
        self, method: str, path: str, body: Any = None, **headers: str
    ) -> http.client.HTTPResponse:
        """As `Client.open`; the answer must let the page read it."""
        reply = super().open(method, path, body, origin=ORIGIN, **headers)
        assert reply.getheader("access-control-allow-origin") == ORIGIN, f"{path}: not for pages"
        return reply


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
    expect_kind(soak, name, volume_id, reply.kind(), f"{reply.status} {reply.body[:300]!r}")


def expect_kind(soak: Soak, name: str, volume_id: str, kind: str, told: str) -> None:
    """As `expect_error`, of an error that came by another way."""
    soak.count_error(kind)
    if kind == "revision-gone" and volume_id == "replaced":
        soak.saw("volume replaced", kind)
    elif kind in ("corrupt-brick", "corrupt-volume") and volume_id == "damaged":
        soak.saw("shard cut short", kind)
    elif kind not in EXPECTED or kind in ("revision-gone", "corrupt-brick", "corrupt-volume"):
        soak.is_wrong(f"{name} of {volume_id}: {kind}: {told}")


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


def ask_gradients(soak: Soak, client: Client, _id: str, chance: np.random.Generator) -> None:
    """Directions of the volume that stores some, one by one and in a stream."""
    if (found := detail(soak, client, "steady")) is None:
        return
    revision = found["revision"]
    gradients = soak.truth.volume(revision).gradients
    assert gradients is not None
    places = [p for p in (some_place(soak, revision, chance) for _ in range(24)) if p[0] > 0]
    truths = [gradients.stored_brick(level, (z, y, x), t, c) for level, t, c, z, y, x in places]
    for place, truth in list(zip(places, truths, strict=True))[:4]:
        path = address("steady", revision, place).replace("/bricks/", "/gradients/")
        reply = client.ask("GET", path, accept_encoding="zstd")
        if reply.status not in (200, 204):
            expect_error(soak, "gradients", "steady", reply)
        elif (reply.body if reply.status == 200 else None) != truth:
            soak.is_wrong(f"WRONG BYTES: {path}")
        soak.count("gradients", verified=1)
    if not places:
        return
    body = {"revision": revision, "kind": "gradients", "bricks": places}
    stream = client.open("POST", f"{V1}/steady/bricks", body)
    if stream.status != 200:
        expect_error(soak, "gradients", "steady", Reply(stream.status, {}, stream.read()))
        return
    for index, status, payload in records(stream, len(places)):
        if status == UNREADABLE or (payload if status == STORED else None) != truths[index]:
            soak.is_wrong(f"WRONG BYTES: batch of directions {revision}: {places[index]}")
    soak.count("batch, gradients", verified=len(places))


def ask_render(soak: Soak, client: Client, volume_id: str, chance: np.random.Generator) -> None:
    """A small picture, and its 304."""
    azimuth, name = int(chance.integers(360)), str(chance.choice(list(MAGIC)))
    words = f"azimuth={azimuth}&width=64&height=48&preset=microscopy&format={name}"
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
    assert reply.body.startswith(MAGIC[name]), f"no {name}"
    soak.count(f"render, {name}")
    words += f"&revision={reply.headers['x-octobrick-revision']}"
    once = client.ask("GET", f"{V1}/{volume_id}/render?{words}")
    if once.status != 200:
        if once.status != 503:
            expect_error(soak, "render", volume_id, once)
        return
    etag = once.headers["etag"]
    again = client.ask("GET", f"{V1}/{volume_id}/render?{words}", if_none_match=etag)
    if again.status == 304:
        soak.count("304")
    else:
        expect_error(soak, "304 of a picture", volume_id, again)
