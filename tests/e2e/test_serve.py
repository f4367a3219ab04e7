"""`octobrick serve` over a real socket: from a file to bricks and pictures, and what it refuses."""

from __future__ import annotations

import http.client
import io
import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from PIL import Image

from octobrick.codec import S3dc
from octobrick.store import ingest, open_volume

OCTOBRICK = [sys.executable, "-m", "octobrick.server.cli"]
WAIT_SECONDS = 30  # only a failing test waits as long


@dataclass(frozen=True)
class Reply:
    status: int
    headers: dict[str, str]
    body: bytes

    def json(self) -> Any:
        return json.loads(self.body)


@dataclass
class Server:
    """A server in a process of its own."""

    process: subprocess.Popen[str]
    port: int
    data_dir: Path
    revisions: dict[str, str] = field(default_factory=dict)

    def request(self, method: str, target: str, body: bytes = b"", **headers: str) -> Reply:
        """One request with its target as it is: nothing is normalised, nothing decoded."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=WAIT_SECONDS)
        try:
            connection.putrequest(method, target, skip_accept_encoding=True)
            for name, value in headers.items():
                connection.putheader(name.replace("_", "-"), value)
            if body:
                connection.putheader("content-length", str(len(body)))
            connection.endheaders(body)
            reply = connection.getresponse()
            names = {name.lower(): value for name, value in reply.getheaders()}
            return Reply(reply.status, names, reply.read())
        finally:
            connection.close()

    def get(self, target: str, **headers: str) -> Reply:
        return self.request("GET", target, b"", **headers)


@contextmanager
def serving(data_dir: Path, **environment: str) -> Iterator[Server]:
    """A server on a free port, which is killed if a test did not stop it."""
    process = subprocess.Popen(
        [*OCTOBRICK, "serve", str(data_dir), "--port", "0"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | environment,
    )
    try:
        assert process.stdout
        line = process.stdout.readline()
        assert " at http://127.0.0.1:" in line, line or process.communicate()[1]
        yield Server(process, int(line.rsplit(":", 1)[1]), data_dir)
    finally:
        process.kill()
        process.communicate()


def stop(server: Server, number: int) -> tuple[int, str]:
    """Send a signal; returns exit code and the log."""
    server.process.send_signal(number)
    _, log = server.process.communicate(timeout=WAIT_SECONDS)
    return server.process.returncode, log


def blob(seed: int = 0) -> np.ndarray[Any, np.dtype[np.uint16]]:
    """70 x 60 x 50 voxels: a soft ball, every brick of 32 with something in it but one."""
    z, y, x = np.ogrid[-35:35, -30:30, -25:25]
    voxels = np.clip(4000 - 4 * (z * z + y * y + x * x) + seed + z + y + x, 0, None)
    voxels[64:, 32:, 32:] = 0
    return np.asarray(voxels, np.uint16)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder = tmp_path_factory.mktemp("served")
    data_dir = folder / "data"
    data_dir.mkdir()
    np.save(folder / "blob.npy", blob())
    ingest(folder / "blob.npy", data_dir / "head.zarr", brick=32, workers=1)
    ingest(folder / "blob.npy", folder / "secret.zarr", brick=32, workers=1)
    with serving(data_dir) as server:
        yield server
        code, log = stop(server, signal.SIGTERM)
        assert code == 0, log
        assert "Traceback" not in log


@pytest.fixture
def bricks(server: Server) -> str:
    """The address of bricks of `head`, to which level, t, c, z, y, x are appended."""
    address: str = server.get("/v1/volumes/head").json()["bricks"]
    return address.removesuffix("/{level}/{t}/{c}/{z}/{y}/{x}")


def test_list_and_metadata(server: Server) -> None:
    assert server.get("/healthz").json() == {"status": "ok"}
    (head,) = server.get("/v1/volumes").json()["volumes"]
    detail = server.get("/v1/volumes/head").json()
    assert head["id"] == "head"
    assert head["shape_zyx"] == detail["levels"][0]["shape_zyx"] == [70, 60, 50]
    assert head["revision"] == detail["revision"]


def test_every_brick_of_every_level_arrives_as_it_is_stored(server: Server, bricks: str) -> None:
    with open_volume(server.data_dir / "head.zarr") as volume:
        codec = volume.codec
        assert isinstance(codec, S3dc)
        absent = 0
        for level in volume.levels:
            for zyx in np.ndindex(level.grid_zyx):
                z, y, x = zyx
                target = f"{bricks}/{level.index}/0/0/{z}/{y}/{x}"
                packed = server.get(target, accept_encoding="zstd")
                plain = server.get(target)
                if packed.status == 204:
                    absent += 1
                    assert plain.status == 204
                    assert not volume.brick(level.index, (z, y, x)).any()
                    continue
                assert packed.headers["content-encoding"] == "zstd"
                assert packed.body == volume.stored_brick(level.index, (z, y, x))
                assert zstandard.decompress(packed.body) == plain.body
                decoded = codec.decode(plain.body, volume.brick_shape_zyx, volume.dtype)
                np.testing.assert_array_equal(decoded, volume.brick(level.index, (z, y, x)))
        assert absent == 1


def test_a_known_brick_is_304_and_head_has_no_body(server: Server, bricks: str) -> None:
    first = server.get(f"{bricks}/0/0/0/0/0/0")
    again = server.get(f"{bricks}/0/0/0/0/0/0", if_none_match=first.headers["etag"])
    assert (again.status, again.body) == (304, b"")
    head = server.request("HEAD", f"{bricks}/0/0/0/0/0/0")
    assert (head.status, head.body) == (200, b"")
    assert head.headers["content-length"] == str(len(first.body))


def test_many_clients_at_once_get_the_right_bytes(server: Server, bricks: str) -> None:
    with open_volume(server.data_dir / "head.zarr") as volume:
        places = [(z, y, x) for z in range(3) for y in range(2) for x in range(2)] * 8
        expected = {zyx: volume.stored_brick(0, zyx) or b"" for zyx in set(places)}

    def fetch(zyx: tuple[int, int, int]) -> bytes:
        z, y, x = zyx
        return server.get(f"{bricks}/0/0/0/{z}/{y}/{x}", accept_encoding="zstd").body

    with ThreadPoolExecutor(8) as clients:
        for zyx, body in zip(places, clients.map(fetch, places), strict=True):
            assert body == expected[zyx]


LONG = "a" * 3000
BAD_TARGETS = [
    # target, status, kind
    ("/v1/volumes/tail", 404, "volume-not-found"),
    ("/v1/volumes/secret", 404, "volume-not-found"),
    ("/v1/volumes/..", 404, "volume-not-found"),
    ("/v1/volumes/../secret", 404, "route-not-found"),
    ("/v1/volumes/../../../../etc/passwd", 404, "route-not-found"),
    ("/v1/volumes/..%2Fsecret", 422, "invalid-input"),
    ("/v1/volumes/..%2fsecret.zarr", 422, "invalid-input"),
    ("/v1/volumes/%2e%2e%2fsecret", 422, "invalid-input"),
    ("/v1/volumes/%2e%2e", 404, "volume-not-found"),
    ("/v1/volumes/%252e%252e%252fsecret", 422, "invalid-input"),
    ("/v1/volumes/..\\secret", 422, "invalid-input"),
    ("/v1/volumes/..%5csecret", 422, "invalid-input"),
    ("/v1/volumes/head%00", 422, "invalid-input"),
    ("/v1/volumes/head%0d%0aX:1", 404, "volume-not-found"),
    (f"/v1/volumes/{LONG}", 404, "volume-not-found"),
    ("/v1/volumes//render", 404, "route-not-found"),
    ("/v1/volumes/head.zarr", 404, "volume-not-found"),
    ("/v1/volumes/HEAD", 404, "volume-not-found"),
    ("/v1/volumes/head/zarr.json", 404, "route-not-found"),
    ("{bricks}/0/0/0/9/0/0", 404, "brick-not-found"),
    ("{bricks}/9/0/0/0/0/0", 404, "brick-not-found"),
    ("{bricks}/0/5/0/0/0/0", 404, "brick-not-found"),
    ("{bricks}/0/0/0/0/0/-1", 422, "invalid-input"),
    ("{bricks}/0/0/0/0/0/x", 422, "invalid-input"),
    ("{bricks}/0/0/0/0/0", 404, "route-not-found"),
    ("{bricks}/0/0/0/0/..%2f0/0", 422, "invalid-input"),
    ("/v1/volumes/head/abc/bricks/0/0/0/0/0/0", 410, "revision-gone"),
    ("/v1/volumes/head/..%2f/bricks/0/0/0/0/0/0", 422, "invalid-input"),
    ("/v1/volumes/head/render?width=1000000000", 413, "too-large"),
    ("/v1/volumes/head/render?width=4096&height=4096", 413, "too-large"),
    ("/v1/volumes/head/render?width=0", 422, "invalid-input"),
    ("/v1/volumes/head/render?level=99&width=8&height=8", 422, "invalid-input"),
    ("/v1/volumes/head/render?preset=..%2f..%2fetc", 422, "invalid-input"),
    ("/v1/volumes/tail/render", 404, "volume-not-found"),
]


@pytest.mark.parametrize(("target", "status", "kind"), BAD_TARGETS)
def test_bad_request_has_its_kind_and_the_server_goes_on(
    server: Server, bricks: str, target: str, status: int, kind: str
) -> None:
    reply = server.get(target.replace("{bricks}", bricks))
    assert reply.status == status, reply.body
    assert reply.json()["error"]["kind"] == kind
    assert reply.headers["content-type"] == "application/json"
    assert str(server.data_dir) not in reply.body.decode()
    assert server.get("/healthz").status == 200


def test_long_body_is_refused(server: Server) -> None:
    reply = server.request("POST", "/v1/volumes/head/render", b"x" * 300_000)
    assert reply.status == 413
    assert reply.json()["error"]["facts"]["limit"] == 262_144


@pytest.mark.parametrize(
    "garbage",
    [
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n\r\n",  # TLS where there is none
        b"GET / HTTP/1.1\r\nHost: x\r\nContent-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n",
        b"POST /healthz HTTP/1.1\r\nHost: x\r\nContent-Length: -1\r\n\r\n",
        b"GET /" + b"\0" * 64 + b" HTTP/1.1\r\n\r\n",
        b"GET /v1/volumes/\xff\xfe HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n",
    ],
)
def test_garbage_on_the_socket_harms_nobody(server: Server, garbage: bytes) -> None:
    with socket.create_connection(("127.0.0.1", server.port), timeout=WAIT_SECONDS) as connection:
        connection.sendall(garbage)
        connection.shutdown(socket.SHUT_WR)
        answer = connection.makefile("rb").read()
    assert answer == b"" or b" 40" in answer.split(b"\r\n")[0]
    assert server.get("/healthz").status == 200


def test_a_replaced_volume_is_gone_and_the_new_one_is_served(tmp_path: Path) -> None:
    np.save(tmp_path / "blob.npy", blob())
    ingest(tmp_path / "blob.npy", tmp_path / "head.zarr", brick=32, workers=1)
    with serving(tmp_path) as server:
        old = server.get("/v1/volumes/head").json()
        place = {"level": 0, "t": 0, "c": 0, "z": 1, "y": 0, "x": 0}
        assert server.get(old["bricks"].format(**place)).status == 200
        np.save(tmp_path / "blob.npy", blob(seed=100))
        ingest(tmp_path / "blob.npy", tmp_path / "head.zarr", brick=32, workers=1, overwrite=True)
        gone = server.get(old["bricks"].format(**place))
        assert gone.status == 410
        new = server.get("/v1/volumes/head").json()
        assert gone.json()["error"]["facts"]["current_revision"] == new["revision"]
        with open_volume(tmp_path / "head.zarr") as volume:
            fresh = server.get(new["bricks"].format(**place))
            assert fresh.body == volume.brick_code(0, (1, 0, 0))


def test_without_opengl_pictures_are_503_and_all_else_is_served(server: Server) -> None:
    with serving(server.data_dir, __EGL_VENDOR_LIBRARY_FILENAMES="/nowhere") as blind:
        refused = blind.get("/v1/volumes/head/render?width=8&height=8")
        assert refused.status == 503
        assert refused.json()["error"]["kind"] == "no-graphics"
        assert int(refused.headers["retry-after"]) > 0
        bricks = blind.get("/v1/volumes/head").json()["bricks"]
        assert blind.get(bricks.format(level=0, t=0, c=0, z=0, y=0, x=0)).status == 200


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_stops_the_server_cleanly(tmp_path: Path, number: int) -> None:
    with serving(tmp_path) as server:
        assert server.get("/v1/volumes").json() == {"volumes": []}
        code, log = stop(server, number)
    assert code == 0, log
    assert "Traceback" not in log


def test_a_taken_port_is_one_line_and_exit_code_1(server: Server) -> None:
    done = subprocess.run(
        [*OCTOBRICK, "serve", str(server.data_dir), "--port", str(server.port)],
        capture_output=True,
        text=True,
        timeout=WAIT_SECONDS,
    )
    assert done.returncode == 1
    assert done.stderr.startswith("octobrick: error [resource]: cannot listen on 127.0.0.1 port")
    assert done.stderr.count("\n") == 1


@pytest.mark.gl
@pytest.mark.parametrize("method", ["GET", "POST"])
def test_a_picture_is_the_one_of_the_command_line(
    server: Server, tmp_path: Path, method: str
) -> None:
    target = "/v1/volumes/head/render"
    if method == "GET":
        reply = server.get(f"{target}?azimuth=40&preset=microscopy&width=96&height=64")
    else:
        words = {"azimuth": 40, "preset": "microscopy", "width": 96, "height": 64}
        body = json.dumps(words).encode()
        reply = server.request(method, target, body, content_type="application/json")
    assert reply.status == 200, reply.body
    subprocess.run(
        [
            *(*OCTOBRICK, "render", str(server.data_dir / "head.zarr")),
            *("-o", str(tmp_path / "p.png"), "--azimuth", "40"),
            *("--preset", "microscopy", "--size", "96x64"),
        ],
        check=True,
        timeout=WAIT_SECONDS,
    )
    served, written = (
        np.asarray(Image.open(file)) for file in (io.BytesIO(reply.body), tmp_path / "p.png")
    )
    np.testing.assert_array_equal(served, written)
    assert served.std() > 5, "the picture shows nothing"
    assert reply.headers["x-octobrick-converged"] == "true"


@pytest.fixture
def huge_source(tmp_path: Path) -> Iterator[Path]:
    """2 GiB of zeros that take no room: long enough to interrupt."""
    path = tmp_path / "huge.raw"
    with path.open("wb") as file:
        file.truncate(2 * 1024**3)
    yield path
    path.unlink()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_ingest_leaves_a_checkpoint_and_says_so(
    huge_source: Path, number: int, tmp_path: Path, start: Callable[..., subprocess.Popen[str]]
) -> None:
    shape = ("--shape", "1024,1024,1024", "--dtype", "uint16", "--workers", "1")
    process = start("ingest", huge_source, tmp_path / "huge.zarr", *shape)
    assert process.stdout
    assert "huge.raw: raw" in process.stdout.readline()
    process.send_signal(number)
    _, errors = process.communicate(timeout=WAIT_SECONDS)
    assert process.returncode == 130
    assert "interrupted; run the same command again to go on" in errors
    assert sorted(path.name for path in tmp_path.iterdir()) == ["huge.raw", "huge.zarr.partial"]


def _hear_interrupts() -> None:
    """A test run in a shell's background ignores SIGINT, and so would all that it starts."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.fixture
def start() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Start the command line in processes that do not outlive the test."""
    processes = []

    def begin(*arguments: object) -> subprocess.Popen[str]:
        command = [*OCTOBRICK, *map(str, arguments)]
        process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            preexec_fn=_hear_interrupts,
        )
        processes.append(process)
        return process

    yield begin
    for process in processes:
        process.kill()
        process.communicate()
