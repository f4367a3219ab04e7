"""A running server: how it stops, what its processes share, whom it does not wait for."""

from __future__ import annotations

import http.client
import json
import os
import re
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from octobrick.store import ingest, open_volume

OCTOBRICK = [sys.executable, "-m", "octobrick.server.cli"]
WAIT_SECONDS = 30  # only a failing test waits as long


@dataclass
class Server:
    """A server in a process of its own."""

    process: subprocess.Popen[str]
    port: int

    def connect(self, receive_nbytes: int | None = None) -> socket.socket:
        connection = socket.socket()
        if receive_nbytes:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_nbytes)
        connection.settimeout(WAIT_SECONDS)
        try:
            connection.connect(("127.0.0.1", self.port))
        except OSError:
            connection.close()
            raise
        return connection

    def get(self, target: str) -> tuple[int, bytes]:
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=WAIT_SECONDS)
        try:
            connection.request("GET", target)
            reply = connection.getresponse()
            return reply.status, reply.read()
        finally:
            connection.close()

    def count(self, pattern: str) -> float:
        """The sum of the samples of /metrics whose line begins with the pattern."""
        lines = self.get("/metrics")[1].decode().splitlines()
        return sum(float(line.split()[-1]) for line in lines if re.match(pattern, line))

    def stop(self) -> tuple[int, str]:
        self.process.send_signal(signal.SIGTERM)
        return self.ended()

    def ended(self) -> tuple[int, str]:
        _, log = self.process.communicate(timeout=WAIT_SECONDS)
        return self.process.returncode, log


@contextmanager
def serving(data_dir: Path, *options: str, **environment: str) -> Iterator[Server]:
    settings = {f"OCTOBRICK_{name.upper()}": value for name, value in environment.items()}
    process = subprocess.Popen(
        [*OCTOBRICK, "serve", str(data_dir), "--port", "0", *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"TMPDIR": str(data_dir.parent)} | settings,
        start_new_session=True,
    )
    try:
        assert process.stdout
        line = process.stdout.readline()
        assert " at http://127.0.0.1:" in line, line or process.communicate()[1]
        yield Server(process, int(line.rsplit(":", 1)[1]))
    finally:
        process.kill()
        process.communicate()


def until(condition: Callable[[], bool]) -> None:
    """Wait for something that another process does."""
    for _ in range(WAIT_SECONDS * 20):
        if condition():
            return
        select.select([], [], [], 0.05)
    raise AssertionError("it did not happen")


def children(pid: int) -> set[int]:
    """Worker processes of a supervisor; not the tracker that Python's spawning starts."""
    found = set()
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((entry / "stat").read_text().rsplit(")", 1)[1].split()[1])
            if parent == pid and b"resource_tracker" not in (entry / "cmdline").read_bytes():
                found.add(int(entry.name))
        except OSError:  # it has ended meanwhile
            continue
    return found


@pytest.fixture(scope="module")
def data_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One brick of 8 MB that no codec makes smaller: more than sockets take without a reader."""
    folder = tmp_path_factory.mktemp("served")
    (folder / "data").mkdir()
    noise = np.random.default_rng(0).integers(0, 2**16, (160, 160, 160), np.uint16)
    np.save(folder / "noise.npy", noise)
    ingest(folder / "noise.npy", folder / "data" / "noise.zarr", codec=None, brick=160, workers=1)
    return folder / "data"


@pytest.fixture(scope="module")
def brick(data_dir: Path) -> tuple[str, bytes]:
    """The address of that brick, and its bytes."""
    with open_volume(data_dir / "noise.zarr") as volume:
        code = volume.brick_code(0, (0, 0, 0))
        assert code is not None
        return f"/v1/volumes/noise/{volume.revision}/bricks/0/0/0/0/0/0", code


@contextmanager
def slow_download(server: Server, target: str) -> Iterator[socket.socket]:
    """A connection that has begun to read an answer and leaves most of it for later."""
    with server.connect(receive_nbytes=4096) as connection:
        connection.sendall(f"GET {target} HTTP/1.1\r\nHost: x\r\n\r\n".encode())
        assert connection.recv(16).startswith(b"HTTP/1.1 200")
        yield connection


def refuses(server: Server) -> bool:
    try:
        server.connect().close()
    except ConnectionRefusedError:
        return True
    return False


# Stopping


@pytest.mark.parametrize("options", [(), ("--workers", "2")])
def test_a_stopping_server_refuses_new_clients_and_finishes_a_slow_download(
    data_dir: Path, brick: tuple[str, bytes], options: tuple[str, ...]
) -> None:
    target, code = brick
    with serving(data_dir, *options) as server, slow_download(server, target) as connection:
        os.killpg(server.process.pid, signal.SIGTERM)  # as a service manager does
        until(lambda: refuses(server))
        body = b"".join(iter(lambda: connection.recv(1 << 20), b""))
        assert body.endswith(code)
        status, log = server.ended()
    assert status == 0, log
    assert "Traceback" not in log
    assert not list(data_dir.parent.glob("octobrick-*"))


def test_a_download_without_end_does_not_keep_a_server_from_stopping(
    data_dir: Path, brick: tuple[str, bytes]
) -> None:
    with serving(data_dir, shutdown_seconds="1") as server, slow_download(server, brick[0]):
        status, log = server.stop()
    assert status == 0, log


@pytest.mark.parametrize("options", [(), ("--workers", "2")])
def test_a_second_signal_stops_at_once(
    data_dir: Path, brick: tuple[str, bytes], options: tuple[str, ...]
) -> None:
    with (
        serving(data_dir, *options, shutdown_seconds="600") as server,
        slow_download(server, brick[0]),
    ):
        workers = children(server.process.pid)
        server.process.send_signal(signal.SIGTERM)
        until(lambda: refuses(server))
        server.process.send_signal(signal.SIGTERM)
        assert server.ended()[0] != 0
        until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in workers))


def test_a_draining_server_still_takes_clients_but_is_not_ready(data_dir: Path) -> None:
    with serving(data_dir, drain_seconds="600") as server:
        assert server.get("/readyz")[0] == 200
        server.process.send_signal(signal.SIGTERM)
        until(lambda: server.get("/readyz")[0] == 503)
        assert server.get("/v1/volumes")[0] == 200


# Several processes


def written(folder: Path, route: str) -> float:
    """Requests of a route that the workers of a server have written down for each other."""
    counts = [json.loads(p.read_text()) for p in folder.glob("octobrick-*/*.json")]
    samples = [sample for c in counts for sample in c["octobrick_requests"]]
    return sum(n for labels, (n,) in samples if labels[0] == route)


def test_workers_add_up_their_counts_and_a_dead_one_is_replaced(data_dir: Path) -> None:
    with serving(data_dir, "--workers", "2") as server:
        workers = children(server.process.pid)
        assert len(workers) == 2
        for _ in range(20):
            assert server.get("/v1/volumes")[0] == 200
        volumes = 'octobrick_requests_total{.*route="volumes"'
        until(lambda: server.count(volumes) == 20)
        assert server.count("process_count") == 2
        # What a worker counts in its last second may be lost with it.
        until(lambda: written(data_dir.parent, "volumes") == 20)
        victim = min(workers)
        os.kill(victim, signal.SIGKILL)
        until(lambda: len(children(server.process.pid) - {victim}) == 2)
        until(lambda: server.count("process_count") == 2)
        until(lambda: server.count(volumes) == 20)
        status, log = server.stop()
    assert status == 0, log
    assert f"worker {victim} ended with status -9" in log


def test_workers_do_not_outlive_their_supervisor(data_dir: Path) -> None:
    with serving(data_dir, "--workers", "2") as server:
        workers = children(server.process.pid)
        server.process.kill()
        until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in workers))


def test_workers_that_cannot_start_end_the_server_with_status_1(tmp_path: Path) -> None:
    """A folder that went away after the command line looked at it."""
    program = (
        "import pathlib, socket\n"
        "from octobrick.server.settings import Settings\n"
        "from octobrick.server.operations.supervisor import Supervisor\n"
        f"settings = Settings(data_dir=pathlib.Path({str(tmp_path / 'gone')!r}), workers=2)\n"
        "with socket.create_server(('127.0.0.1', 0)) as listener:\n"
        "    raise SystemExit(Supervisor(settings, listener, lambda: print('ready')).run())\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=WAIT_SECONDS
    )
    assert done.returncode == 1, done.stderr
    assert done.stdout == ""
    assert "cannot list the folder of volumes" in done.stderr


# Clients who take their time, or too much


@pytest.fixture(scope="module")
def small(data_dir: Path) -> Iterator[Server]:
    """A server of little patience and two connections, with its log as JSON."""
    limits = {"max_connections": "2", "receive_seconds": "2", "stall_seconds": "1"}
    with serving(data_dir, log_format="json", access_log="all", **limits) as server:
        yield server
        status, log = server.stop()
        assert status == 0, log
        assert "Traceback" not in log
        lines = [json.loads(line) for line in log.splitlines()]  # uvicorn's too
        assert {line["logger"].split(".")[0] for line in lines} == {"octobrick", "uvicorn"}
        assert all(line["request_id"] for line in lines if line["logger"] == "octobrick.access")


@pytest.mark.parametrize(
    ("sent", "answer"),
    [
        (b"", b""),
        (b"GET /healthz HTTP/1.1\r\nHost: x\r\nX-A: ", b"HTTP/1.1 408 "),
        (b"POST /v1/volumes/noise/render HTTP/1.1\r\nHost: x\r\nContent-Length: 9\r\n\r\n{", b""),
    ],
)
def test_who_does_not_finish_asking_is_cut_off(small: Server, sent: bytes, answer: bytes) -> None:
    with small.connect() as connection:
        connection.sendall(sent)
        try:
            received = connection.makefile("rb").read()
        except ConnectionResetError:
            received = b""
        assert received.startswith(answer)
        assert bool(received) == bool(answer)


def is_open(server_port: str, client_port: str) -> bool:
    """Whether the server's end of a connection is, by the system's table of sockets."""
    rows = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()]
    return any(
        row[1].endswith(server_port) and row[2].endswith(client_port) and row[3] == "01"
        for row in rows
    )


def test_who_stops_reading_is_cut_off(small: Server, brick: tuple[str, bytes]) -> None:
    with slow_download(small, brick[0]) as connection:
        ports = f":{small.port:04X}", f":{connection.getsockname()[1]:04X}"
        assert is_open(*ports)
        until(lambda: not is_open(*ports))


def answer_to(server: Server, sent: bytes) -> tuple[bytes, dict[str, Any]]:
    """The head of the answer to some bytes, and its error."""
    with server.connect() as connection:
        connection.sendall(sent)
        head, _, body = connection.makefile("rb").read().partition(b"\r\n\r\n")
        error: dict[str, Any] = json.loads(body)["error"]
        return head, error


def test_headers_without_end_are_431(small: Server) -> None:
    sent = b"GET /healthz HTTP/1.1\r\nHost: x\r\n" + b"X-A: aaaaaaaaaaaaaaaaaaaaaaaa\r\n" * 2_000
    head, error = answer_to(small, sent)
    assert head.startswith(b"HTTP/1.1 431 ")
    assert error["kind"] == "headers-too-long"


def test_what_is_no_http_is_400_in_the_shape_of_errors(small: Server) -> None:
    head, error = answer_to(small, b"\x16\x03\x01\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 400 ")
    assert b"nosniff" in head
    assert error["kind"] == "invalid-input"


def test_a_connection_too_many_is_503_but_probes_are_answered(small: Server) -> None:
    with small.connect() as first, small.connect() as second:
        for connection in (first, second):  # so that the server has taken both in
            connection.sendall(b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n")
            assert connection.recv(12) == b"HTTP/1.1 200"
        head, error = answer_to(small, b"GET /v1/volumes HTTP/1.1\r\nHost: x\r\n\r\n")
        assert head.startswith(b"HTTP/1.1 503 ")
        assert b"retry-after: " in head
        assert error["kind"] == "busy"
        assert error["facts"]["limit_name"] == "max_connections"
        assert small.get("/healthz")[0] == 200
    until(lambda: small.get("/v1/volumes")[0] == 200)


# Files of secrets


def test_a_broken_tokens_file_stops_the_start_with_one_line(data_dir: Path, tmp_path: Path) -> None:
    (tmp_path / "tokens.json").write_text("[{}]")
    done = subprocess.run(
        [*OCTOBRICK, "serve", str(data_dir), "--port", "0"],
        capture_output=True,
        text=True,
        env=os.environ | {"OCTOBRICK_TOKENS_FILE": str(tmp_path / "tokens.json")},
        timeout=WAIT_SECONDS,
    )
    assert done.returncode == 2
    assert done.stderr.startswith("octobrick: error [invalid-input]: tokens file, entry 0: ")
    assert done.stderr.count("\n") == 1


def test_a_printed_token_and_a_printed_address_let_in(data_dir: Path, tmp_path: Path) -> None:
    def octobrick(*arguments: str) -> list[str]:
        done = subprocess.run([*OCTOBRICK, *arguments], capture_output=True, text=True, check=True)
        return done.stdout.splitlines()

    secret, entry = octobrick("token", "ann", "--volumes", "noise", "--expires", "1h")
    (tmp_path / "tokens.json").write_text(f"[{entry}]")
    key = tmp_path / "key"
    key.write_text("k" * 40)
    key.chmod(0o600)
    files = {"tokens_file": str(tmp_path / "tokens.json"), "signing_key_file": str(key)}
    with serving(data_dir, **files) as server:
        assert server.get("/v1/volumes/noise")[0] == 401
        (address,) = octobrick("sign", "noise", "--key-file", str(key))
        assert server.get(address)[0] == 200
        (address,) = octobrick(
            "sign", f"http://127.0.0.1:{server.port}/v1/volumes/noise", "--key-file", str(key)
        )
        assert server.get(address.removeprefix(f"http://127.0.0.1:{server.port}"))[0] == 200
        connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=WAIT_SECONDS)
        connection.request("GET", "/v1/volumes", headers={"authorization": f"Bearer {secret}"})
        assert connection.getresponse().status == 200
        connection.close()
