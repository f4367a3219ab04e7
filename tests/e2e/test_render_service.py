"""Pictures of `octobrick serve` over a real socket, from render processes with a real driver."""

from __future__ import annotations

import http.client
import io
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from urllib.parse import urlencode

import numpy as np
import pytest
from PIL import Image

from octobrick.store import ingest

OCTOBRICK = [sys.executable, "-m", "octobrick.server.cli"]
RENDER = "/v1/volumes/head/render"
WAIT_SECONDS = 60  # only a failing test waits as long

pytestmark = pytest.mark.gl


class Server:
    """A server in a process of its own."""

    def __init__(self, data_dir: Path, **environment: str) -> None:
        self.volume = data_dir / "head.zarr"
        self.process = subprocess.Popen(
            [*OCTOBRICK, "serve", str(data_dir), "--port", "0"],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | environment,
        )
        assert self.process.stdout
        self.port = int(self.process.stdout.readline().rsplit(":", 1)[1])

    def get(self, **words: object) -> tuple[int, dict[str, str], bytes]:
        """Status, headers and body of a picture."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=WAIT_SECONDS)
        try:
            connection.request("GET", f"{RENDER}?{urlencode(words, doseq=True)}")
            reply = connection.getresponse()
            headers = {name.lower(): value for name, value in reply.getheaders()}
            return reply.status, headers, reply.read()
        finally:
            connection.close()

    def leave(self, **words: object) -> None:
        """Ask for a picture and close the connection."""
        with socket.create_connection(("127.0.0.1", self.port), WAIT_SECONDS) as connection:
            target = f"{RENDER}?{urlencode(words)}"
            connection.sendall(f"GET {target} HTTP/1.1\r\nHost: x\r\n\r\n".encode())

    def workers(self) -> list[int]:
        """Its render processes."""
        tasks = Path(f"/proc/{self.process.pid}/task").glob("*/children")
        return [int(pid) for path in tasks for pid in path.read_text().split()]


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder = tmp_path_factory.mktemp("rendered")
    z, y, x = np.ogrid[-35:35, -30:30, -25:25]
    ball = np.clip(4000 - 4 * (z * z + y * y + x * x) + z + y + x, 0, None).astype(np.uint16)
    np.save(folder / "ball.npy", ball)
    ingest(folder / "ball.npy", folder / "data" / "head.zarr", brick=32, workers=1)
    server = Server(folder / "data", OCTOBRICK_RENDER_QUEUE_LENGTH="20")
    yield server
    server.process.send_signal(signal.SIGTERM)
    _, log = server.process.communicate(timeout=WAIT_SECONDS)
    assert server.process.returncode == 0, log
    assert "Traceback" not in log


VIEWS = [
    {"mode": "isosurface", "iso": "1500", "light": "1,-1,2:ffcc88", "clip_box": "0,,,,,50"},
    {"mode": "slice", "slice_normal": "1,1,0", "window": "0,4000", "oriented": "false"},
    {"mode": "mip", "scale_bar": "true", "legend": "true", "background": "204060"},
    {"mode": "dvr", "deblocking": "3", "edges": "0.001,0.1", "background": "transparent"},
]


@pytest.mark.parametrize("words", VIEWS, ids=lambda words: words["mode"])
def test_a_picture_is_that_of_the_command_line_in_every_pixel(
    server: Server, tmp_path: Path, words: dict[str, str]
) -> None:
    status, headers, body = server.get(width=160, height=128, azimuth=40, **words)
    assert status == 200, body
    options = [part for word, value in words.items() for part in option(word, value)]
    subprocess.run(
        [
            *(*OCTOBRICK, "render", str(server.volume), "-o", str(tmp_path / "p.png")),
            *("--size", "160x128", "--azimuth", "40", *options),
        ],
        check=True,
        timeout=WAIT_SECONDS,
    )
    served, written = (
        np.asarray(Image.open(file)) for file in (io.BytesIO(body), tmp_path / "p.png")
    )
    np.testing.assert_array_equal(served, written)
    assert served.std() > 5, "the picture shows nothing"
    assert headers["x-octobrick-converged"] == "true"


def option(word: str, value: str) -> list[str]:
    """The option of the command line that means the same."""
    name = "--" + word.replace("deblocking", "deblock").replace("_", "-")
    return {"true": [name], "false": []}.get(value, [name, value])


def test_progressive_pictures_end_with_the_ordinary_one(server: Server) -> None:
    words = {"width": 200, "height": 120, "preset": "microscopy"}
    _, _, whole = server.get(**words)
    status, headers, body = server.get(**words, progressive="true")
    assert status == 200
    boundary = headers["content-type"].rsplit("boundary=", 1)[1].encode()
    before, coarse, again, final, after = body.split(b"--" + boundary)
    assert (before, after) == (b"", b"--\r\n")
    assert again == coarse
    assert whole in final
    assert whole not in coarse
    picture = Image.open(io.BytesIO(coarse.split(b"\r\n\r\n", 1)[1]))
    assert picture.size == (200, 120)
    assert np.asarray(picture).std() > 5, "the coarse picture shows nothing"


def test_a_killed_worker_costs_at_most_one_picture(server: Server) -> None:
    assert server.get(width=16, height=16)[0] == 200
    (worker,) = server.workers()
    os.kill(worker, signal.SIGKILL)
    statuses = [server.get(width=16, height=16)[0] for _ in range(2)]
    assert statuses in ([200, 200], [503, 200])
    (fresh,) = server.workers()
    assert fresh != worker


def test_of_fifty_pictures_at_once_each_is_answered_or_refused(server: Server) -> None:
    with ThreadPoolExecutor(50) as clients:
        asked = [clients.submit(server.get, width=64, height=48, azimuth=i) for i in range(50)]
        replies = [reply.result(WAIT_SECONDS) for reply in asked]
    statuses = [status for status, _, _ in replies]
    assert 200 in statuses
    assert set(statuses) <= {200, 503}
    for status, headers, body in replies:
        if status == 503:
            assert int(headers["retry-after"]) > 0
            assert b'"busy"' in body
        else:
            assert Image.open(io.BytesIO(body)).size == (64, 48)


def test_clients_who_leave_free_their_places(server: Server) -> None:
    for i in range(40):  # twice as many as can wait
        server.leave(width=700, height=700, azimuth=i)
    deadline = time.monotonic() + WAIT_SECONDS
    while server.get(width=8, height=8)[0] != 200:
        assert time.monotonic() < deadline
    assert len(server.workers()) == 1


def test_workers_end_with_their_server_even_if_it_is_killed(tmp_path: Path, server: Server) -> None:
    other = Server(server.volume.parent)
    try:
        assert other.get(width=8, height=8)[0] == 200
        (worker,) = other.workers()
    finally:
        other.process.kill()
        other.process.communicate()
    deadline = time.monotonic() + WAIT_SECONDS
    while is_alive(worker):
        assert time.monotonic() < deadline
        time.sleep(0.01)


def is_alive(pid: int) -> bool:
    """Whether a process runs; one that ended may wait for long to be noticed by its new parent."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False
