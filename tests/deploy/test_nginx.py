"""deploy/nginx/nginx.conf, run: what the cache keeps, what it must not, what passes at once."""

from __future__ import annotations

import http.client
import json
import os
import re
import shutil
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest

from octobrick.store import ingest

ROOT = Path(__file__).parents[2]
CONFIG = ROOT / "deploy" / "nginx" / "nginx.conf"
NGINX = shutil.which("nginx", path=f"{os.environ['PATH']}:/usr/sbin:/usr/local/sbin")
WAIT_SECONDS = 30

pytestmark = pytest.mark.skipif(NGINX is None, reason="nginx is not installed")


class Reply:
    def __init__(self, reply: http.client.HTTPResponse) -> None:
        self.status = reply.status
        self.headers = {name.lower(): value for name, value in reply.getheaders()}
        self.body = reply.read()


def ask(port: int, target: str, method: str = "GET", **headers: str) -> Reply:
    with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=WAIT_SECONDS)) as connection:
        connection.putrequest(method, target, skip_accept_encoding=True)
        for name, value in headers.items():
            connection.putheader(name.replace("_", "-"), value)
        connection.endheaders()
        return Reply(connection.getresponse())


@contextmanager
def caching(upstream_port: int, folder: Path) -> Iterator[int]:
    """The configuration as it is, but for addresses and folders; gives the port of the cache."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    text = CONFIG.read_text(encoding="utf-8")
    for old, new in (
        ("server octobrick:8000;", f"server 127.0.0.1:{upstream_port};"),
        ("listen 8080;", f"listen 127.0.0.1:{port};"),
        ("/var/cache/nginx", str(folder / "cache")),
        ("/tmp/nginx", str(folder / "nginx")),
    ):
        assert old in text, old
        text = text.replace(old, new)
    (folder / "cache").mkdir()
    config = folder / "nginx.conf"
    config.write_text(text, encoding="utf-8")
    directives = "daemon off; master_process off;"
    command = [str(NGINX), "-e", "stderr", "-c", str(config), "-g", directives]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    try:
        limit = time.monotonic() + WAIT_SECONDS
        while True:
            try:
                socket.create_connection(("127.0.0.1", port)).close()
                break
            except OSError:
                assert process.poll() is None, process.communicate()[1]
                assert time.monotonic() < limit
                time.sleep(0.02)
        yield port
    finally:
        process.terminate()
        process.communicate(timeout=WAIT_SECONDS)


class Stub(ThreadingHTTPServer):
    """An upstream that answers as a test wants, and counts."""

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), StubHandler)
        self.asked: list[str] = []
        self.status = 200
        self.cache_control = "public, max-age=31536000, immutable"
        self.go_on = threading.Event()


class StubHandler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: Stub

    def do_GET(self) -> None:
        self.server.asked.append(self.headers.get("accept-encoding", ""))
        body = f"answer {len(self.server.asked)}".encode()
        self.send_response(self.server.status)
        if self.server.status == 200:
            self.send_header("Cache-Control", self.server.cache_control)
        self.send_header("Vary", "Accept-Encoding")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def do_POST(self) -> None:
        self.send_response(200)
        self.send_header("Content-Length", "12")
        self.end_headers()
        self.wfile.write(b"first ")
        self.wfile.flush()
        self.server.go_on.wait(WAIT_SECONDS)
        self.wfile.write(b"second")

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def stub() -> Iterator[Stub]:
    with Stub() as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.05,))
        thread.start()
        yield server
        server.go_on.set()
        server.shutdown()
        thread.join()


@pytest.fixture
def cache(stub: Stub, tmp_path: Path) -> Iterator[int]:
    with caching(stub.server_address[1], tmp_path) as port:
        yield port


BRICK = "/v1/volumes/head/abc123/bricks/0/0/0/0/0/0"


def test_a_brick_is_fetched_once_for_each_of_two_kinds_of_client(stub: Stub, cache: int) -> None:
    for spelling in (
        "zstd",
        "gzip, zstd",
        "gzip, deflate, br, zstd",
        "zstd;q=0.5",
        "br,zstd;q=1.0",
    ):
        assert ask(cache, BRICK, accept_encoding=spelling).body == b"answer 1", spelling
    for spelling in ("", "gzip", "zstd;q=0", "zstd; q=0.0", "xzstd", "zstdx", "identity"):
        assert ask(cache, BRICK, accept_encoding=spelling).body == b"answer 2", spelling
    assert ask(cache, BRICK).body == b"answer 2"
    assert stub.asked == ["zstd", "identity"]


def test_what_a_token_shows_is_neither_kept_nor_taken_from_the_cache(
    stub: Stub, cache: int
) -> None:
    for _ in range(2):
        ask(cache, BRICK, authorization="Bearer a")
    assert len(stub.asked) == 2
    ask(cache, BRICK)
    assert ask(cache, BRICK, authorization="Bearer a").body == b"answer 4"


def test_private_answers_and_answers_that_must_be_asked_again_are_not_kept(
    stub: Stub, cache: int
) -> None:
    for words in ("private, max-age=31536000", "no-cache", "no-store"):
        stub.cache_control = words
        before = len(stub.asked)
        ask(cache, BRICK)
        ask(cache, BRICK)
        assert len(stub.asked) == before + 2, words


@pytest.mark.parametrize("status", [404, 410, 422, 500, 503])
def test_errors_are_not_kept(stub: Stub, cache: int, status: int) -> None:
    stub.status = status
    assert [ask(cache, BRICK).status for _ in range(2)] == [status, status]
    stub.status = 200
    assert ask(cache, BRICK).body == b"answer 3"


def test_the_first_bytes_of_a_batch_pass_before_the_last_are_made(stub: Stub, cache: int) -> None:
    with closing(http.client.HTTPConnection("127.0.0.1", cache, timeout=WAIT_SECONDS)) as client:
        client.request("POST", "/v1/volumes/head/bricks", b"{}")
        reply = client.getresponse()
        assert reply.read(6) == b"first "  # the rest is not made before this has come
        stub.go_on.set()
        assert reply.read() == b"second"


@pytest.mark.parametrize("path", ["/metrics", "/readyz"])
def test_what_is_for_the_operator_is_hidden(stub: Stub, cache: int, path: str) -> None:
    assert ask(cache, path).status == 404
    assert stub.asked == []


def test_where_nothing_answers_the_error_has_octobricks_shape(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        gone = free.getsockname()[1]
    with caching(gone, tmp_path) as port:
        reply = ask(port, "/v1/volumes")
    assert (reply.status, reply.headers["retry-after"]) == (503, "2")
    assert json.loads(reply.body)["error"]["kind"] == "busy"


def test_the_real_server_behind_it(tmp_path: Path) -> None:
    np.save(tmp_path / "ramp.npy", np.arange(48**3, dtype=np.uint16).reshape(48, 48, 48))
    ingest(tmp_path / "ramp.npy", tmp_path / "data" / "head.zarr", brick=32, workers=1)
    command = [sys.executable, "-m", "octobrick.server.cli", "serve", str(tmp_path / "data")]
    pipe = subprocess.PIPE
    server = subprocess.Popen([*command, "--port", "0"], stdout=pipe, stderr=pipe, text=True)
    try:
        assert server.stdout
        match = re.search(r":([0-9]+)$", server.stdout.readline())
        assert match
        with caching(int(match[1]), tmp_path) as port:
            detail = json.loads(ask(port, "/v1/volumes/head").body)
            brick = detail["bricks"].format(level=0, t=0, c=0, z=0, y=0, x=0)
            first, second = (ask(port, brick, accept_encoding="zstd") for _ in range(2))
            assert [r.headers["x-cache-status"] for r in (first, second)] == ["MISS", "HIT"]
            assert first.body == second.body
            assert second.headers["content-encoding"] == "zstd"
            plain = ask(port, brick)
            assert "content-encoding" not in plain.headers
            assert plain.headers["etag"] != second.headers["etag"]
            for reply in (second, plain):
                again = ask(
                    port,
                    brick,
                    accept_encoding=reply.headers.get("content-encoding", "identity"),
                    if_none_match=reply.headers["etag"],
                )
                assert (again.status, again.body) == (304, b"")
            gone = ask(port, brick.replace(detail["revision"], "abc"))
            assert gone.status == 410
            assert ask(port, brick, method="HEAD").headers["x-cache-status"] == "HIT"
            assert ask(port, "/v1/volumes/head/x%2f..%2fy").status == 422  # passed as it came
    finally:
        server.kill()
        server.communicate()
