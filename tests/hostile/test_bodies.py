"""Bodies that are bombs, or JSON that parsers disagree about, to every route that takes one."""

from __future__ import annotations

import gzip
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zstandard

BOMB_NBYTES = 400_000_000  # what a good citizen of 400 KB would take up here, if it were unpacked


@pytest.fixture
def posts(target: Any) -> list[str]:
    """Every address that takes a body, of the real volume."""
    paths = target.ask("GET", "/openapi.json").json()["paths"]
    found = [path for path, methods in paths.items() if "post" in methods]
    assert found
    return [path.replace("{volume_id}", "head") for path in found]


def resident_nbytes(pid: int) -> int:
    """Of the server's own process."""
    for line in Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) * 1024
    raise AssertionError(pid)


def bombs() -> Iterator[tuple[str, bytes]]:
    packer = zstandard.ZstdCompressor(19).compressobj()
    parts = [packer.compress(bytes(10_000_000)) for _ in range(BOMB_NBYTES // 10_000_000)]
    yield "zstd", b"".join((*parts, packer.flush()))
    yield "gzip", gzip.compress(bytes(40_000_000), 9)
    yield "deflate", gzip.compress(bytes(40_000_000), 9)[10:-8]


def test_packed_bodies_are_not_unpacked(target: Any, posts: list[str]) -> None:
    for coding, bomb in bombs():
        before = resident_nbytes(target.pid)
        for path in posts:
            reply = target.ask(
                "POST", path, bomb, content_encoding=coding, content_type="application/json"
            )
            target.assert_refused(reply)
        assert resident_nbytes(target.pid) - before < 100_000_000, coding
    target.assert_unharmed()


JSON = {
    "empty": b"",
    "null": b"null",
    "cut short": b'{"width": ',
    "two values": b"{} {}",
    "comment": b'{"width": 8 /* */}',
    "trailing comma": b'{"width": 8,}',
    "byte order mark": b'\xef\xbb\xbf{"width": 8}x',
    "utf-16": '{"width": -8}'.encode("utf-16"),
    "broken utf-8": b'{"preset": "\xff\xfe\xc0\xaf"}',
    "lone surrogate": b'{"preset": "\\ud800"}',
    "lone surrogate as a key": b'{"\\udc00": 1}',
    "NUL": b'{"preset": "ct\\u0000bone"}',
    "deep lists": b"[" * 30_000,
    "deep lists, closed": b'{"window": ' + b"[" * 20_000 + b"]" * 20_000 + b"}",
    "deep objects": b'{"camera": ' * 5_000 + b"1" + b"}" * 5_000,
    "long integer": b'{"width": ' + b"9" * 20_000 + b"}",
    "huge float": b'{"azimuth": 1e999999}',
    "infinity": b'{"azimuth": Infinity}',
    "minus infinity": b'{"distance": -Infinity}',
    "not a number": b'{"fov": NaN}',
    "float for an integer": b'{"width": 8.5}',
    "boolean for a number": b'{"step_voxels": "true"}',
    "many keys": b"{" + b",".join(b'"%d":1' % i for i in range(6_000)) + b"}",
    "colliding names": b'{"__class__": 1, "__proto__": {"a": 1}, "constructor": 1}',
    "million elements": b"[" + b"0," * 999_999 + b"0]",
    "wide window": b'{"window": [' + b"0," * 30_000 + b"0]}",
    "wrong kinds": b'{"revision": [], "bricks": {"0": 0}, "budget_nbytes": {}, "kind": 7}',
    "bricks that are none": b'{"revision": "a", "bricks": [[0], [], null, [1e300, 0, 0, 0, 0, 0]]}',
    "transfer function": b'{"transfer_function": {"points": [[NaN, 1e999, -1]], "a": "\\ud800"}}',
}


@pytest.mark.parametrize("what", JSON)
def test_json_that_is_none_or_means_nothing_is_refused(
    target: Any, posts: list[str], what: str
) -> None:
    for path in posts:
        reply = target.ask("POST", path, JSON[what], content_type="application/json")
        target.assert_refused(reply)
    target.assert_unharmed()


def test_of_a_key_that_comes_twice_one_counts_and_no_limit_is_passed(target: Any) -> None:
    for body in (
        b'{"width": 8, "width": 100000}',
        b'{"height": 8, "width": 100000, "width": 90000}',
    ):
        path = "/v1/volumes/head/render"
        target.assert_refused(target.ask("POST", path, body, content_type="application/json"))
    target.assert_unharmed()


@pytest.mark.parametrize(
    "content_type",
    [
        *("", "text/plain", "application/xml", "application/json; q" * 50, "*/*"),
        *("multipart/form-data; boundary=x", "application/x-www-form-urlencoded"),
        "application/json;charset=utf-7",
    ],
)
def test_other_kinds_of_body_are_refused(target: Any, posts: list[str], content_type: str) -> None:
    body = b'--x\r\nContent-Disposition: form-data; name="width"\r\n\r\n8\r\n--x--\r\n'
    for path in posts:
        target.assert_refused(target.ask("POST", path, body, content_type=content_type))
    target.assert_unharmed()


def test_a_body_without_a_length_is_cut_at_the_limit(target: Any) -> None:
    chunk = b"4000\r\n" + b" " * 0x4000 + b"\r\n"
    head = b"POST /v1/volumes/head/render HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\n"
    before = resident_nbytes(target.pid)
    answer = target.raw(head + b"Transfer-Encoding: chunked\r\n\r\n" + chunk * 4_000)
    assert not answer or answer.split()[1] == b"413"
    assert resident_nbytes(target.pid) - before < 50_000_000
    target.assert_unharmed()
