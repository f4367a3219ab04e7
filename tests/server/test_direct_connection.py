"""However requests are cut into packets, each gets its own answer, in order."""

from __future__ import annotations

import itertools
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
from fastapi import FastAPI
from hypothesis import given, settings
from hypothesis import strategies as st

from octobrick.server import Settings, create_app
from octobrick.server.bricks.direct_connection import DirectConnection
from octobrick.server.bricks.direct_lane import DirectLane
from octobrick.server.services import Services
from octobrick.store import LocalVolume, open_volume

from .direct_server import served


class WatchedLane(DirectLane):
    """Counts the answers that were given without parsing."""

    repeated = 0

    def answer_again(self, message: bytes) -> Any:
        """Its answer."""
        answer = super().answer_again(message)
        self.repeated += answer is not None
        return answer

    def forget(self) -> None:
        """Know no headers any more."""
        self._blocks.clear()


def make_lane(services: Services) -> WatchedLane:
    """One that lets everybody pass."""
    return WatchedLane(services, lambda _: b"")


def connect(origin: str) -> socket.socket:
    host, port = origin.removeprefix("http://").split(":")
    return socket.create_connection((host, int(port)), timeout=10)


def request(path: str, *headers: str, method: str = "GET") -> bytes:
    """As it goes over the wire; without headers all of them alike."""
    lines = [f"{method} {path} HTTP/1.1", "Host: x", *headers]
    return "".join(f"{line}\r\n" for line in [*lines, ""]).encode()


def read_answer(
    connection: socket.socket, method: str = "GET"
) -> tuple[int, dict[str, str], bytes]:
    """Status, headers and body of the next answer; it has to be framed by a length."""
    received = bytearray()
    while b"\r\n\r\n" not in received:
        received += connection.recv(1)
    status, *lines = received[:-4].decode("latin-1").split("\r\n")
    headers = dict(line.lower().split(": ", 1) for line in lines)
    body = bytearray()
    length = 0 if method == "HEAD" else int(headers.get("content-length", 0))
    while len(body) < length:
        body += connection.recv(length - len(body))
    return int(status.split()[1]), headers, bytes(body)


def test_requests_in_one_packet_are_answered_in_their_order(
    app: FastAPI, base: str, services: Services, head: LocalVolume
) -> None:
    bricks = [(1, 0, 2), (1, 0, 1), (0, 0, 0), (2, 2, 3)]
    lines = [f"GET {base}/bricks/0/0/0/{z}/{y}/{x} HTTP/1.1\r\nHost: x\r\n" for z, y, x in bricks]
    lines[1] = "GET /healthz HTTP/1.1\r\nHost: x\r\n"
    lines[3] += "Connection: close\r\n"
    with served(app, make_lane(services)) as origin:
        host, port = origin.removeprefix("http://").split(":")
        for _ in range(2):
            with socket.create_connection((host, int(port)), timeout=10) as connection:
                connection.sendall("\r\n".join([*lines, ""]).encode())
                received = b"".join(iter(lambda: connection.recv(1 << 16), b""))
            first, last = (head.brick_code(0, bricks[i]) for i in (0, 2))
            assert first is not None
            assert last is not None
            assert 0 < received.index(first) < received.index(b"ok") < received.index(last)
            assert received.count(b"HTTP/1.1 20") == 4
            assert b"connection: close" in received


def test_headers_that_were_parsed_once_are_not_parsed_again(
    app: FastAPI, base: str, services: Services, head: LocalVolume
) -> None:
    lane = make_lane(services)
    with served(app, lane) as origin, connect(origin) as one, connect(origin) as other:
        for number, x in enumerate([0, 0, 1, 1, 2, 2, 0, 1]):
            for connection, encoding in ((one, "zstd"), (other, "identity")):
                path = f"{base}/bricks/0/0/0/0/0/{x}"
                connection.sendall(request(path, f"Accept-Encoding: {encoding}"))
                status, headers, body = read_answer(connection)
                assert status == 200
                zstd = encoding == "zstd"
                stored = head.stored_brick if zstd else head.brick_code
                assert body == stored(0, (0, 0, x))
                assert headers.get("content-encoding") == ("zstd" if zstd else None)
            if number == 6:  # all bricks were read by a thread or before, and headers known
                assert lane.repeated > 0
    assert lane.repeated >= 4


def test_half_a_request_is_not_taken_for_a_whole_one(
    app: FastAPI, base: str, services: Services, head: LocalVolume
) -> None:
    """A header may hold, at the start of a packet, what elsewhere is a request of its own."""
    first, second = (f"{base}/bricks/0/0/0/0/0/{x}" for x in (0, 1))
    zstd = "Accept-Encoding: zstd"

    def ask(connection: socket.socket, *packets: bytes) -> bytes:
        for packet in packets:
            connection.sendall(packet)
            time.sleep(0.01)
        return read_answer(connection)[2]

    lane = make_lane(services)
    with served(app, lane) as origin, connect(origin) as one, connect(origin) as other:
        for _ in range(3):
            for x, path in enumerate((first, second)):
                assert ask(one, request(path, zstd)) == head.stored_brick(0, (0, 0, x))
                assert ask(one, request(path)) == head.brick_code(0, (0, 0, x))
        before = lane.repeated
        assert before > 0
        lane.forget()
        halves = request(first, zstd)[:-2] + b"X-Note: ", request(second)
        for _ in range(2):
            assert ask(one, *halves) == head.stored_brick(0, (0, 0, 0))
            for connection in (other, one):
                assert ask(connection, request(second)) == head.brick_code(0, (0, 0, 1))
        assert lane.repeated > before


def test_a_connection_is_idle_from_its_last_answer_on() -> None:
    """No timer is set for an answer without parsing: the one before looks when that was."""
    connection = DirectConnection.__new__(DirectConnection)
    connection.loop, connection.transport = Mock(), Mock(is_closing=lambda: False)
    connection.timeout_keep_alive = 5
    connection._answered_at = 7.0
    connection.loop.time.return_value = 10.0
    connection.timeout_keep_alive_handler()
    connection.loop.call_later.assert_called_once_with(2.0, connection.timeout_keep_alive_handler)
    connection.transport.close.assert_not_called()
    connection.loop.time.return_value = 12.0
    connection.timeout_keep_alive_handler()
    connection.transport.close.assert_called_once()


@pytest.fixture(scope="module")
def cut_server(volumes_template: Path) -> Iterator[tuple[str, str, LocalVolume]]:
    """Its origin, what addresses of bricks begin with, and the volume that it serves."""
    app = create_app(Settings(warm_start=False, data_dir=volumes_template))
    head = open_volume(volumes_template / "head.zarr")
    with served(app, make_lane(app.state.services), lifespan="on") as origin:
        yield origin, f"/v1/volumes/head/{head.revision}", head


WHAT = st.sampled_from(
    ["brick", "brick", "brick", "decoded", "head", "again", "absent", "missing", "health", "bad"]
)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(WHAT, st.integers(0, 2)), min_size=2, max_size=8), st.data())
def test_answers_do_not_depend_on_how_requests_are_cut(
    cut_server: tuple[str, str, LocalVolume], asked: list[tuple[str, int]], data: st.DataObject
) -> None:
    origin, base, head = cut_server
    sent: list[bytes] = []
    expected: list[tuple[int, bytes | None, str]] = []
    inside = []
    for what, x in asked:
        path, stored = f"{base}/bricks/0/0/0/0/0/{x}", head.stored_brick(0, (0, 0, x))
        zstd, method = "Accept-Encoding: zstd", "GET"
        etag = f'"{head.revision}-0.0.0.0.0.{x}-zstd"'
        if what == "brick":
            sent.append(request(path, zstd))
            expected.append((200, stored, method))
        elif what == "decoded":
            sent.append(request(path))
            expected.append((200, head.brick_code(0, (0, 0, x)), method))
        elif what == "head":
            sent.append(request(path, zstd, method="HEAD"))
            expected.append((200, b"", "HEAD"))
        elif what == "again":
            sent.append(request(path, zstd, f"If-None-Match: {etag}"))
            expected.append((304, b"", method))
        elif what == "absent":
            sent.append(request(f"{base}/bricks/0/0/0/2/2/3", zstd))
            expected.append((204, b"", method))
        elif what == "missing":
            sent.append(request(f"{base}/bricks/0/0/0/9/9/{x}", zstd))
            expected.append((404, None, method))
        elif what == "bad":  # a header that holds what could be a request of its own
            sent.append(request(path, f"X-Note: {request(path)[:-4].decode()}", zstd))
            inside.append(sum(map(len, sent)) - len(request(path, zstd)))
            expected.append((200, stored, method))
        else:
            sent.append(request("/healthz", zstd))
            expected.append((200, None, method))
    stream = b"".join(sent)
    likely = [*itertools.accumulate(map(len, sent[:-1])), *inside]
    cuts = data.draw(
        st.lists(st.sampled_from(likely) | st.integers(1, len(stream) - 1), max_size=9)
    )
    edges = [0, *sorted(set(cuts)), len(stream)]
    with connect(origin) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for start, stop in itertools.pairwise(edges):
            connection.sendall(stream[start:stop])
            time.sleep(0.002)  # so that the server gets it as a packet of its own
        for status, body, method in expected:
            got = read_answer(connection, method)
            assert got[0] == status
            assert body is None or got[2] == body
