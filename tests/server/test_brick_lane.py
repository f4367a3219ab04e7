"""The three ways to a brick answer alike; what is not in memory is left to a thread."""

from __future__ import annotations

import errno
import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest
from fastapi import FastAPI

from octobrick.server import Settings, create_app
from octobrick.server.bricks.brick_headers import header_lines
from octobrick.server.bricks.brick_reply import BrickAddress, BrickReply
from octobrick.server.bricks.direct_admission import DirectAdmission
from octobrick.server.bricks.direct_lane import DirectLane
from octobrick.server.services import Services
from octobrick.store import LocalVolume, open_volume

from .direct_server import served

ErrorOf = Callable[[Any], dict[str, Any]]

PATHS = [
    "bricks/0/0/0/1/0/2",
    "bricks/0/0/0/2/2/3",  # absent
    "bricks/1/0/0/0/1/1",
    "gradients/1/0/0/0/1/1",
    "bricks/0/0/0/9/9/9",
    "gradients/0/0/0/0/0/0",
]


@pytest.fixture
def address(head: LocalVolume) -> BrickAddress:
    return BrickAddress("head", head.revision, 0, 0, 0, (1, 0, 2))


@pytest.mark.parametrize("encoding", ["zstd", "gzip"])
def test_the_direct_lane_the_event_loop_and_a_thread_answer_alike(
    app: FastAPI, client: Any, base: str, services: Services, encoding: str
) -> None:
    answers: list[Any] = []
    repeated: list[Any] = []

    class Counting(DirectLane):
        def answer(self, scope: Any) -> Any:
            answers.append(super().answer(scope))
            return answers[-1]

        def answer_again(self, message: bytes) -> Any:
            repeated.append(super().answer_again(message))
            return repeated[-1]

    admission = DirectAdmission(services)
    lane = Counting(services, admission.admit, admission.note)
    with served(app, lane) as origin, httpx.Client(base_url=origin) as http:
        for path in PATHS:
            headers = {"accept-encoding": encoding}
            for _ in range(3):  # read by a thread; from memory; headers like those before
                for conditions in ({}, {"if-none-match": "*"}):
                    for method in ("GET", "HEAD"):
                        asked = headers | conditions
                        ours = http.request(method, f"{base}/{path}", headers=asked)
                        theirs = client.request(method, f"{base}/{path}", headers=asked)
                        assert (ours.status_code, ours.content) == (
                            theirs.status_code,
                            theirs.content,
                        )
                        for name in ("date", "server", "x-request-id"):
                            ours.headers.pop(name, None)
                            theirs.headers.pop(name, None)
                        assert ours.headers == theirs.headers
    direct = {answer.head.split()[1] for answer in answers if answer is not None}
    assert {b"200", b"304"} <= direct
    assert None in answers
    assert {b"200"} <= {answer.head.split()[1] for answer in repeated if answer is not None}
    assert None in repeated


def test_requests_that_the_application_has_to_see_are_left_to_it(
    services: Services, address: BrickAddress, head: LocalVolume
) -> None:
    services.bricks.reply(address, "zstd", "")
    path = f"/v1/volumes/head/{head.revision}/bricks/0/0/0/1/0/2"

    def ask(lane: DirectLane, method: str = "GET", *headers: tuple[bytes, bytes]) -> Any:
        zstd = (b"accept-encoding", b"zstd")
        scope = {"method": method, "path": path, "raw_path": path.encode()}
        return lane.answer(scope | {"headers": [zstd, *headers]})

    lane = DirectLane(services, lambda _: b"")
    assert ask(lane) is not None
    assert ask(lane, "POST") is None
    for name in (b"content-length", b"transfer-encoding", b"origin", b"upgrade"):
        assert ask(lane, "GET", (name, b"0")) is None
    assert ask(DirectLane(services, lambda _: None)) is None


def reply_now(services: Services, address: BrickAddress) -> BrickReply | None:
    return services.bricks.reply_now(address, "zstd", "")


def test_a_brick_in_memory_is_answered_without_waiting(
    services: Services, address: BrickAddress, head: LocalVolume
) -> None:
    assert reply_now(services, address) is None  # nothing is open yet
    slow = services.bricks.reply(address, "zstd", "")
    fast = reply_now(services, address)
    assert fast is not None
    assert (fast.status, fast.headers, bytes(fast.body)) == (200, slow.headers, slow.body)
    assert fast.body == head.stored_brick(0, (1, 0, 2))
    assert header_lines(fast.headers) == fast.lines


@pytest.mark.parametrize("number", [errno.EAGAIN, errno.EOPNOTSUPP, errno.EIO])
def test_a_read_that_would_wait_or_fail_is_left_to_a_thread(
    services: Services, address: BrickAddress, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    slow = services.bricks.reply(address, "zstd", "")
    calls = []

    def refuse(*_: Any) -> int:
        calls.append(number)
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "preadv", refuse)
    assert reply_now(services, address) is None
    assert reply_now(services, address) is None
    assert len(calls) == (1 if number == errno.EOPNOTSUPP else 2)  # what is missing is remembered
    assert services.bricks.reply(address, "zstd", "").body == slow.body


def test_a_system_without_nowait_reads_in_threads(
    client: Any, base: str, head: LocalVolume, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(os, "RWF_NOWAIT", raising=False)
    for _ in range(2):
        reply = client.get(f"{base}/bricks/0/0/0/1/0/2", headers={"accept-encoding": "zstd"})
        assert reply.content == head.brick_code(0, (1, 0, 2))


def test_a_shard_cut_short_under_an_open_server_is_500(
    client: Any, base: str, data_dir: Path, error_of: ErrorOf
) -> None:
    zstd = {"accept-encoding": "zstd"}
    assert client.get(f"{base}/bricks/0/0/0/1/0/2", headers=zstd).status_code == 200
    shard = data_dir / "head.zarr/0/c/0/0/0/0/0"
    os.truncate(shard, 100)
    for method in ("GET", "HEAD"):
        reply = client.request(method, f"{base}/bricks/0/0/0/1/0/2", headers=zstd)
        assert reply.status_code == 500
    reply = client.get(f"{base}/bricks/0/0/0/1/0/2", headers=zstd)
    assert error_of(reply)["kind"] == "corrupt-brick"


def test_a_volume_replaced_while_it_is_read_from_memory_is_not_answered(
    services: Services,
    address: BrickAddress,
    replace_volume: Callable[[str], None],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Neither from the open shard nor from one that belongs to the new volume already."""
    services.bricks.reply(address, "zstd", "")
    read = LocalVolume.stored_brick_now

    def replace_and_read(volume: LocalVolume, *at: Any) -> bytearray | None:
        content = read(volume, *at)
        replace_volume("head")
        return content

    monkeypatch.setattr(LocalVolume, "stored_brick_now", replace_and_read)
    assert reply_now(services, address) is None


def test_every_brick_read_while_volumes_are_swapped_is_of_its_revision(
    client: Any, data_dir: Path, replace_volume: Callable[[str], None]
) -> None:
    """What a directory swap can do at any moment: an address gives its own bytes, or 410."""
    ours, other = data_dir / "head.zarr", data_dir / "aside"
    bytes_of = {}
    for path in (ours, data_dir / "exact.zarr"):
        with open_volume(path) as volume:
            bytes_of[volume.revision] = volume.brick_code(0, (1, 0, 2))
    stop = threading.Event()

    def swap() -> None:
        while not stop.is_set():
            ours.rename(other)
            (data_dir / "exact.zarr").rename(ours)
            other.rename(data_dir / "exact.zarr")
            stop.wait(0.002)

    thread = threading.Thread(target=swap)
    thread.start()
    try:
        statuses = set()
        for i in range(300):
            revision = list(bytes_of)[i % 2]
            headers = {"accept-encoding": "zstd" if i % 3 else "gzip"}
            reply = client.get(f"/v1/volumes/head/{revision}/bricks/0/0/0/1/0/2", headers=headers)
            statuses.add(reply.status_code)
            if reply.status_code == 200:
                assert reply.content == bytes_of[revision]
    finally:
        stop.set()
        thread.join()
    assert statuses & {200}
    assert statuses <= {200, 404, 410, 500, 503}


def test_gradients_are_served_as_they_are_stored(client: Any, base: str, head: LocalVolume) -> None:
    assert head.gradients is not None
    reply = client.get(f"{base}/gradients/1/0/0/0/1/1", headers={"accept-encoding": "zstd"})
    assert reply.headers["content-encoding"] == "zstd"
    assert reply.content == head.gradients.code(1, (0, 1, 1))
    assert reply.headers["x-octobrick-shape"] == "16,16,16,3"
    assert reply.headers["x-octobrick-dtype"] == "uint8"
    assert reply.headers["x-octobrick-codec"] == "directions"
    assert "x-octobrick-range" not in reply.headers
    assert client.get(f"{base}/gradients/1/0/0/0/1/1").content == reply.content


def test_a_level_without_gradients_is_404(client: Any, base: str, error_of: ErrorOf) -> None:
    error = error_of(client.get(f"{base}/gradients/0/0/0/0/0/0"))
    assert error["kind"] == "brick-not-found"
    assert error["facts"] == {"level": 0, "levels": [1, 2]}
    exact = f"/v1/volumes/exact/{client.get('/v1/volumes/exact').json()['revision']}"
    error = error_of(client.get(f"{exact}/gradients/1/0/0/0/0/0"))
    assert error["facts"] == {"level": 1, "levels": []}


def test_many_at_once_decode_a_brick_once(
    client: Any, base: str, services: Services, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []
    code = LocalVolume.brick_code

    def counted(volume: LocalVolume, *at: Any) -> bytes | None:
        calls.append(at)
        return code(volume, *at)

    monkeypatch.setattr(LocalVolume, "brick_code", counted)
    asked = [
        threading.Thread(target=client.get, args=(f"{base}/bricks/0/0/0/1/0/2",)) for _ in range(8)
    ]
    for thread in asked:
        thread.start()
    for thread in asked:
        thread.join()
    assert len(calls) == 1
    stats = services.decoded.stats()
    assert stats["hits_total"] + stats["joined_total"] == 7
    assert (stats["misses_total"], stats["entries"]) == (1, 1)


@pytest.mark.parametrize(
    ("settings", "path", "admitted"),
    [
        ({}, "/v1/volumes/head", True),
        ({"access_log": "all"}, "/v1/volumes/head", False),
        ({"max_target_nbytes": 256}, "/" + "a" * 300, False),
        ({"signing_key": "k" * 32}, "/v1/volumes/head", False),
    ],
)
def test_the_direct_lane_admits_nobody_whom_the_layers_before_the_application_must_see(
    data_dir: Path, make_client: Any, settings: dict[str, Any], path: str, admitted: bool
) -> None:
    app = create_app(Settings(data_dir=data_dir, **settings))
    scope = {"path": path, "raw_path": path.encode(), "query_string": b"", "headers": []}
    with make_client(app):
        lines = DirectAdmission(app.state.services).admit(scope)
    assert (lines is not None) == admitted
    assert lines is None or (b"nosniff" in lines and b"x-request-id: " in lines)
