"""Many bricks in one stream: the order, the faults, and who stops reading when."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import pytest
from fastapi import FastAPI

from octobrick.codec import S3dc
from octobrick.server.bricks import brick_stream
from octobrick.store import LocalVolume, ingest, open_volume
from octobrick.store.brick_stream import BrickStreamReader, Kind, Record, Status

EVERY = [[0, 0, 0, z, y, x] for z in range(3) for y in range(3) for x in range(4)]


def records(reply: Any, count: int, kind: Kind = Kind.VOXELS) -> list[Record]:
    assert reply.status_code == 200, reply.text
    assert reply.headers["content-type"] == "application/vnd.octobrick.bricks"
    assert reply.headers["cache-control"] == "no-store"
    reader = BrickStreamReader(kind, count, lambda _: 1 << 20)
    found = list(reader.feed(reply.content))
    reader.finish()
    return found


def post(client: Any, revision: str, bricks: Any, **fields: Any) -> Any:
    body = {"revision": revision, "bricks": bricks, **fields}
    return client.post("/v1/volumes/head/bricks", json=body)


def test_bricks_come_as_they_are_stored_in_the_order_asked_for(
    client: Any, revision: str, data_dir: Path
) -> None:
    places = [*EVERY[::-1], [2, 0, 0, 0, 0, 0], EVERY[0], EVERY[0]]
    found = records(post(client, revision, places), len(places))
    volume = open_volume(data_dir / "head.zarr")
    for (level, _, _, z, y, x), record in zip(places, found, strict=True):
        stored = volume.stored_brick(level, (z, y, x))
        assert record.payload == (stored or b"")
        assert record.status is (Status.ABSENT if stored is None else Status.STORED)
    assert Status.ABSENT in {record.status for record in found}
    assert records(post(client, revision, []), 0) == []


def test_directions_of_gradients_come_as_voxels_do(client: Any, data_dir: Path) -> None:
    source = data_dir.parent / "volumes" / "ramp.npy"
    ingest(source, data_dir / "lit.zarr", codec=S3dc(), brick=16, workers=1, gradients=True)
    volume = open_volume(data_dir / "lit.zarr")
    assert volume.gradients is not None
    places = [[1, 0, 0, 0, 0, x] for x in range(2)]
    body = {"revision": volume.revision, "kind": "gradients", "bricks": places}
    reply = client.post("/v1/volumes/lit/bricks", json=body)
    for x, record in enumerate(records(reply, 2, Kind.GRADIENTS)):
        assert record.payload == volume.gradients.stored_brick(1, (0, 0, x))
    body["bricks"] = [[0, 0, 0, 0, 0, 0]]  # level 0 stores none
    assert client.post("/v1/volumes/lit/bricks", json=body).status_code == 404


@pytest.mark.parametrize(
    "place",
    [[0, 0, 0, 3, 0, 0], [0, 1, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0], [9, 0, 0, 0, 0, 0],
     [0, 0, 0, 0, 0, 999_999_999]],
)  # fmt: skip
def test_a_brick_that_there_is_not_is_an_error_before_the_first_byte(
    client: Any, revision: str, error_of: Callable[[Any], dict[str, Any]], place: list[int]
) -> None:
    error = error_of(post(client, revision, [EVERY[0], place]))
    assert error["kind"] == "brick-not-found"
    assert error["facts"] == {"index": 1, "brick": place}


@pytest.mark.parametrize(
    "bricks", [[[0, 0, 0, 0, 0]], [[0, 0, 0, 0, 0, -1]], [[0, 0, 0, 0, 0, 1.5]], "all", None,
               [[0, 0, 0, 0, 0, True]], [[0, 0, 0, 0, 0, 10**30]]],
)  # fmt: skip
def test_malformed_addresses_are_refused(
    client: Any, revision: str, error_of: Callable[[Any], dict[str, Any]], bricks: Any
) -> None:
    reply = post(client, revision, bricks)
    assert (reply.status_code, error_of(reply)["kind"]) == (422, "invalid-input")


def test_more_bricks_than_the_limit_are_refused(
    make_client: Any, data_dir: Path, error_of: Callable[[Any], dict[str, Any]]
) -> None:
    from octobrick.server import Settings, create_app

    with make_client(create_app(Settings(data_dir=data_dir, max_batch_bricks=2))) as client:
        revision = client.get("/v1/volumes/head").json()["revision"]
        assert len(records(post(client, revision, EVERY[:2]), 2)) == 2
        error = error_of(post(client, revision, EVERY[:3]))
    assert (error["kind"], error["facts"]["limit_name"]) == ("too-large", "max_batch_bricks")


def test_another_revision_is_gone(
    client: Any, error_of: Callable[[Any], dict[str, Any]], revision: str
) -> None:
    reply = post(client, "0" * 32, EVERY)
    assert reply.status_code == 410
    assert error_of(reply)["facts"]["current_revision"] == revision


def test_bricks_of_a_damaged_shard_are_records_and_the_others_follow(
    client: Any, revision: str, data_dir: Path
) -> None:
    shard = next(path for path in (data_dir / "head.zarr" / "1").rglob("*") if path.is_file()
                 and path.name != "zarr.json")  # fmt: skip
    shard.write_bytes(shard.read_bytes()[:-9])
    found = records(post(client, revision, [[1, 0, 0, 0, 0, 0], EVERY[0]]), 2)
    assert [record.status for record in found] == [Status.FAILED, Status.STORED]
    error = found[0].error()
    assert error["kind"] == "corrupt-volume"
    assert "/" not in json.dumps(error)


class Stream:
    """A stream of a running app, taken piece by piece, and what it has read."""

    def __init__(self, app: FastAPI, revision: str, places: list[Any]) -> None:
        body = json.dumps({"revision": revision, "bricks": places}).encode()
        self._app, self._body = app, body
        self.left = asyncio.Event()
        self._asked = False
        self._pieces: asyncio.Queue[Any] = asyncio.Queue(maxsize=1)

    async def receive(self) -> Any:
        if not self._asked:
            self._asked = True
            return {"type": "http.request", "body": self._body}
        await self.left.wait()
        return {"type": "http.disconnect"}

    async def send(self, message: Any) -> None:
        await self._pieces.put(message)

    def start(self) -> asyncio.Task[None]:
        path = "/v1/volumes/head/bricks"
        scope = {
            "type": "http", "asgi": {"version": "3.0", "spec_version": "2.3"}, "method": "POST",
            "path": path, "raw_path": path.encode(), "query_string": b"", "http_version": "1.1",
            "scheme": "http", "server": ("test", 80), "client": ("test", 1), "root_path": "",
            "headers": [(b"content-type", b"application/json"),
                        (b"content-length", str(len(self._body)).encode())],
        }  # fmt: skip
        return asyncio.create_task(self._app(scope, self.receive, self.send))  # type: ignore[arg-type]

    async def take(self) -> bytes:
        message = await asyncio.wait_for(self._pieces.get(), 20)
        return bytes(message.get("body", b""))

    async def rest(self) -> AsyncIterator[bytes]:
        more = True
        while more:
            message = await asyncio.wait_for(self._pieces.get(), 20)
            more = message["type"] == "http.response.start" or message.get("more_body", False)
            yield message.get("body", b"")


@pytest.fixture
def one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each brick is a piece of its own."""
    monkeypatch.setattr(brick_stream, "GROUP_BRICKS", 1)


@pytest.fixture
def reads(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int]]:
    """How, and which along x, bricks were read."""
    found: list[tuple[str, int]] = []
    for name in ("stored_brick", "stored_brick_now"):
        read = getattr(LocalVolume, name)

        def counted(
            volume: LocalVolume, level: int, zyx: Any, *at: int, name: str = name, read: Any = read
        ) -> Any:
            stored = read(volume, level, zyx, *at)
            found.append((name, zyx[2]))
            return stored

        monkeypatch.setattr(LocalVolume, name, counted)
    return found


@pytest.fixture(params=["disk", "memory"])
def bricks_in(request: pytest.FixtureRequest, client: Any, revision: str) -> str:
    """Where the system has the bricks."""
    where: str = request.param
    if where == "memory":
        records(post(client, revision, EVERY), len(EVERY))
    return where


def test_bricks_in_memory_are_read_in_the_event_loop_and_others_in_threads(
    client: Any, revision: str, bricks_in: str, reads: list[tuple[str, int]]
) -> None:
    reads.clear()
    records(post(client, revision, EVERY), len(EVERY))
    assert len(reads) == len(EVERY)
    by = "stored_brick" if bricks_in == "disk" else "stored_brick_now"
    assert {name for name, _ in reads} == {by}


@pytest.mark.parametrize("missing", [{0}, {1}, {3}, {0, 2}, set(range(4))])
def test_a_brick_that_left_the_memory_changes_no_byte(
    client: Any, revision: str, monkeypatch: pytest.MonkeyPatch, missing: set[int]
) -> None:
    expected = records(post(client, revision, EVERY), len(EVERY))
    read = LocalVolume.stored_brick_now

    def sometimes(volume: LocalVolume, level: int, zyx: Any, *at: int) -> Any:
        if zyx[2] in missing:
            raise BlockingIOError
        return read(volume, level, zyx, *at)

    monkeypatch.setattr(LocalVolume, "stored_brick_now", sometimes)
    assert records(post(client, revision, EVERY), len(EVERY)) == expected


@pytest.mark.usefixtures("one_by_one")
def test_others_get_the_event_loop_between_the_groups_of_a_batch_in_memory(
    client: Any, app: FastAPI, revision: str
) -> None:
    records(post(client, revision, EVERY), len(EVERY))

    turns, sent_in_turn = 0, []

    class Ready(Stream):
        async def send(self, message: Any) -> None:
            sent_in_turn.append(turns)

    async def run() -> None:
        nonlocal turns
        task = Ready(app, revision, EVERY).start()
        while not task.done():
            await asyncio.sleep(0)
            turns += 1

    client._portal.call(run)
    assert len(set(sent_in_turn)) >= len(EVERY)


@pytest.mark.usefixtures("one_by_one")
def test_a_client_that_takes_nothing_stops_the_reading_and_one_that_leaves_returns_the_volume(
    client: Any, app: FastAPI, revision: str, bricks_in: str, reads: list[tuple[str, int]]
) -> None:
    catalog = app.state.services.catalog
    reads.clear()

    async def run() -> None:
        stream = Stream(app, revision, EVERY)
        task = stream.start()
        await stream.take()  # the status
        header_and_first = await stream.take() + await stream.take()
        reader = BrickStreamReader(Kind.VOXELS, len(EVERY), lambda _: 1 << 20)
        assert [record.index for record in reader.feed(header_and_first)] == [0]
        for _ in range(50):  # enough turns for anything that reads ahead
            await asyncio.sleep(0)
            await asyncio.to_thread(lambda: None)
        assert 1 <= len(reads) <= 4
        assert catalog._entries["head"].open.users == 1
        stream.left.set()
        await asyncio.wait([task], timeout=20)
        assert task.done()

    client._portal.call(run)
    app.state.services.readers.submit(lambda: None).result(20)
    assert len(reads) <= 5
    for _ in range(4):  # threads: the last one to read gives it back
        app.state.services.readers.submit(lambda: None).result(20)
    assert catalog._entries["head"].open.users == 0


@pytest.mark.usefixtures("one_by_one")
def test_a_volume_that_is_replaced_meanwhile_ends_its_stream_with_records_that_say_so(
    client: Any, app: FastAPI, revision: str, data_dir: Path, bricks_in: str,
    replace_volume: Callable[[str], None],
) -> None:  # fmt: skip
    volume = open_volume(data_dir / "head.zarr")
    before = [volume.stored_brick(0, (z, y, x)) or b"" for _, _, _, z, y, x in EVERY]

    async def run() -> bytes:
        stream = Stream(app, revision, EVERY)
        task = stream.start()
        pieces = [await stream.take() for _ in range(4)]
        await asyncio.to_thread(replace_volume, "head")
        pieces += [piece async for piece in stream.rest()]
        await task
        return b"".join(pieces)

    reader = BrickStreamReader(Kind.VOXELS, len(EVERY), lambda _: 1 << 20)
    found = list(reader.feed(client._portal.call(run)))
    reader.finish()
    failed = [record.status is Status.FAILED for record in found]
    assert 3 <= failed.index(True) <= 7
    assert failed == sorted(failed)
    for record, stored in zip(found, before, strict=True):
        if record.status is Status.FAILED:
            assert record.error()["kind"] == "revision-gone"
        else:
            assert record.payload == stored
    assert client.get("/v1/volumes/head").json()["revision"] != revision
