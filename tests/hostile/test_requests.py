"""Requests that layers could read in different ways: lengths, headers, methods, versions."""

from __future__ import annotations

import re
import socket
from contextlib import ExitStack
from typing import Any

import pytest

STATUS = re.compile(rb"^HTTP/1\.[01] (\d{3})", re.MULTILINE)


def statuses(answer: bytes) -> list[int]:
    """Of every answer on a connection, wherever its head begins."""
    return [int(found) for found in STATUS.findall(answer)]


def post(*headers: bytes, body: bytes = b"") -> bytes:
    lines = [b"POST /v1/volumes/head/render HTTP/1.1", b"Host: x", *headers, b"", body]
    return b"\r\n".join(lines)


SMUGGLED = b"GET /v1/volumes HTTP/1.1\r\nHost: x\r\n\r\n"


@pytest.mark.parametrize(
    "headers",
    [
        (b"Content-Length: 5", b"Transfer-Encoding: chunked"),
        (b"Transfer-Encoding: chunked", b"Content-Length: 5"),
        (b"Content-Length: 5", b"Content-Length: 40"),
        (b"Content-Length: 5, 40",),
        (b"Content-Length: +5",),
        (b"Content-Length: 0x5",),
        (b"Content-Length: -1",),
        (b"Content-Length: 99999999999999999999999",),
        (b"Content-Length : 5",),
        (b"Content-Length:\x0b5",),
        (b"Transfer-Encoding: xchunked",),
        (b"Transfer-Encoding : chunked",),
        (b"Transfer-Encoding: chunked, identity",),
        (b"Transfer-Encoding: chunked", b"Transfer-Encoding: cow"),
        (b"Transfer-Encoding: \x00chunked",),
        (b"X: y\rTransfer-Encoding: chunked",),
        (b"X: y\nTransfer-Encoding: chunked",),
        (b"X: y", b" Transfer-Encoding: chunked"),
    ],
)
def test_no_second_request_hides_in_an_ambiguous_body(
    target: Any, headers: tuple[bytes, ...]
) -> None:
    """Refused, or read in one way and the connection closed: never a 200 for what was hidden."""
    body = b"0\r\n\r\n" + SMUGGLED
    answer = target.raw(post(b"Content-Type: application/json", *headers, body=body))
    assert 200 not in statuses(answer), answer
    assert all(400 <= status < 500 for status in statuses(answer)), answer
    target.assert_unharmed()


@pytest.mark.parametrize(
    "chunks",
    [
        b"fffffffffffffffff\r\n",
        b"-1\r\n",
        b"5;" + b"e" * 100_000,
        b"5\r\nabcdefgh",
        b"zz\r\n",
        b"\n",
    ],
)
def test_chunks_that_lie_are_refused(target: Any, chunks: bytes) -> None:
    answer = target.raw(post(b"Transfer-Encoding: chunked", body=chunks))
    assert all(400 <= status < 500 for status in statuses(answer)), answer
    target.assert_unharmed()


@pytest.mark.parametrize(
    "line",
    [
        b"X: " + b"a" * 200_000,
        b"X" * 200_000 + b": a",
        b"\r\n".join(b"X-%d: a" % i for i in range(20_000)),
        b"no colon",
        b": no name",
        b"X: a\0b",
        b"X\0: a",
        b"X y: a",
        "X-ä: ö".encode(),
        b"If-None-Match: " + b'"a", ' * 5_000,
        b"Accept-Encoding: " + b"zstd;q=0.1," * 2_000,
        b"Accept-Encoding: zstd;q=nan, zstd;q=1e999, ;;;=,,,",
        b"Range: bytes=0-,0-,0-,0-,-1,999999999999-",
        b"Cookie: " + b"a=b; " * 5_000,
        b"Expect: 100-continue",
        b"Expect: the unexpected",
        b"Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: a\r\n"
        b"Sec-WebSocket-Version: 13",
        b"Upgrade: h2c\r\nConnection: Upgrade, HTTP2-Settings\r\nHTTP2-Settings: AAMAAABkAAQ",
    ],
)
def test_odd_headers_are_refused_or_passed_over(target: Any, line: bytes) -> None:
    place = f"/v1/volumes/head/{target.revision}/bricks/0/0/0/0/0/0".encode()
    head = b"GET " + place + b" HTTP/1.1\r\nHost: x\r\nConnection: close\r\n" + line + b"\r\n\r\n"
    found = statuses(target.raw(head))
    assert all(status < 500 for status in found), found
    target.assert_unharmed()


def test_a_line_end_in_a_value_makes_no_header(target: Any) -> None:
    for path in (
        "/v1/volumes/head/render?preset=ct%0d%0aX-Evil:%201",
        "/v1/volumes/head%0d%0aX-Evil:%201/render",
        "/v1/volumes/head/render?revision=%0d%0aX-Evil:%201",
        "/v1/volumes?%0d%0aX-Evil:%201",
    ):
        reply = target.ask("GET", path)
        assert "x-evil" not in {name.lower() for name, _ in reply.headers}
        assert reply.status < 500
    answer = target.raw(b"GET /nowhere HTTP/1.1\r\nHost: x\r\nX-Request-Id: a\rX-Evil: 1\r\n\r\n")
    assert b"\nX-Evil" not in answer
    assert b"\rX-Evil" not in answer


@pytest.mark.parametrize("host", ["evil.example", "evil.example:80", "", "a b", "[::1", "x" * 5000])
def test_the_host_header_is_not_believed(target: Any, host: str) -> None:
    for path in ("/v1/volumes/", "/v1/volumes/head", "/docs", "/openapi.json", "/v1/volumes"):
        head = f"GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n"
        answer = target.raw(head.encode())
        assert all(status in (200, 400, 404, 431) for status in statuses(answer)), answer
        assert b"evil.example" not in answer
        assert b"ocation:" not in answer.split(b"\r\n\r\n")[0]


def test_absolute_form_and_other_targets_reach_no_other_host(target: Any) -> None:
    for first in (
        b"GET http://127.0.0.1:1/v1/volumes HTTP/1.1",
        b"GET http://evil.example/v1/volumes HTTP/1.1",
        b"CONNECT evil.example:443 HTTP/1.1",
        b"OPTIONS * HTTP/1.1",
        b"GET  /v1/volumes HTTP/1.1",
        b"GET v1/volumes HTTP/1.1",
        b"GET /v1/volumes HTTP/9.9",
        b"GET /v1/volumes",
        b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
    ):
        answer = target.raw(first + b"\r\nHost: x\r\nConnection: close\r\n\r\n")
        assert all(status < 500 for status in statuses(answer)), (first, answer)
        assert b"evil.example" not in answer
        target.assert_unharmed()


def test_http_1_0_is_answered_and_closed(target: Any) -> None:
    answer = target.raw(b"GET /v1/volumes HTTP/1.0\r\n\r\n")
    assert statuses(answer) == [200]
    assert b"ransfer-encoding: chunked" not in answer.split(b"\r\n\r\n")[0].lower()


@pytest.mark.parametrize(
    "method", ["PUT", "DELETE", "PATCH", "TRACE", "OPTIONS", "PROPFIND", "get", "Post", "X" * 300]
)
def test_other_methods_change_and_echo_nothing(target: Any, method: str) -> None:
    head = f"{method} /v1/volumes/head HTTP/1.1\r\nHost: x\r\nX-Secret: echo\r\n"
    answer = target.raw((head + "Connection: close\r\n\r\n").encode())
    assert all(400 <= status < 500 for status in statuses(answer)), answer
    assert b"echo" not in answer
    for name in ("X-HTTP-Method-Override", "X-HTTP-Method", "X-Method-Override"):
        assert target.ask("GET", "/v1/volumes/head", **{name: method.strip()}).status == 200
    target.assert_unharmed()


def test_many_who_never_finish_their_request_stop_nobody(target: Any) -> None:
    with ExitStack() as held:
        for number in range(200):
            connection = socket.create_connection(("127.0.0.1", target.port), 30)
            held.enter_context(connection)
            head = post(b"Content-Type: application/json", b"Content-Length: 60000")
            connection.sendall(head[: -2 - number % 40] if number % 2 else head + b'{"width"')
        target.assert_unharmed()
    target.assert_unharmed()
