"""A real server on a real socket, to be attacked, and a client that sends what it is told."""

from __future__ import annotations

import http.client
import json
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from octobrick.store import ingest, open_volume

WAIT_SECONDS = 30  # only a failing test waits as long
SILENCE_SECONDS = 1.0  # a server that says nothing for so long waits for more


@dataclass(frozen=True)
class Reply:
    status: int
    headers: list[tuple[str, str]]
    body: bytes

    def json(self) -> Any:
        return json.loads(self.body)


@dataclass(frozen=True)
class Target:
    """The server under attack."""

    port: int
    pid: int
    data_dir: Path
    revision: str = ""
    secret_revision: str = ""  # of the volume that must not be seen

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def raw(self, data: bytes) -> bytes:
        """What comes back for bytes as they are, until the server closes or waits for more."""
        with socket.create_connection(("127.0.0.1", self.port), WAIT_SECONDS) as connection:
            answer = b""
            try:
                connection.sendall(data)
                connection.settimeout(SILENCE_SECONDS)
                while part := connection.recv(65_536):
                    answer += part
            except (TimeoutError, BrokenPipeError, ConnectionResetError):
                pass  # waits for more, or refused while we were still sending
            return answer

    def ask(self, method: str, path: str, body: bytes = b"", **headers: str) -> Reply:
        """One request; the path goes out as it is."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=WAIT_SECONDS)
        with closing(connection):
            connection.putrequest(method, path, skip_accept_encoding=True)
            for name, value in headers.items():
                connection.putheader(name.replace("_", "-"), value)
            if body:
                connection.putheader("Content-Length", str(len(body)))
            connection.endheaders(body)
            reply = connection.getresponse()
            return Reply(reply.status, reply.getheaders(), reply.read())

    def assert_unharmed(self) -> None:
        """It still answers, and lists what it listed."""
        assert self.ask("GET", "/healthz").status == 200
        listed = self.ask("GET", "/v1/volumes").json()["volumes"]
        assert [volume["id"] for volume in listed] == ["head"]

    def assert_refused(self, reply: Reply) -> None:
        """A client's error in the one shape, which tells nothing of the server's files."""
        assert 400 <= reply.status < 500, reply
        error = reply.json()["error"]
        assert set(error) == {"kind", "message", "facts"}
        assert error["kind"] != "internal"
        assert str(self.data_dir).encode() not in reply.body


@pytest.fixture(scope="session")
def target(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Target]:
    """One volume served, a second one beside the folder, pictures small so that they are quick."""
    folder = tmp_path_factory.mktemp("attacked")
    z, y, x = np.ogrid[:20, :24, :28]
    np.save(folder / "a.npy", (z * 40 + y * 30 + x * 7).astype(np.uint16))
    ingest(folder / "a.npy", folder / "data" / "head.zarr", brick=16, workers=1)
    np.save(folder / "b.npy", (z * 40 + y * 30 + x * 9).astype(np.uint16))
    ingest(folder / "b.npy", folder / "secret.zarr", brick=16, workers=1)
    with open_volume(folder / "secret.zarr") as volume:
        secret_revision = volume.revision
    environment = os.environ | {
        "OCTOBRICK_MAX_IMAGE_SIDE": "48",
        "OCTOBRICK_MAX_IMAGE_PIXELS": "1024",
        "OCTOBRICK_RENDER_TIMEOUT_SECONDS": "20",
    }
    command = [sys.executable, "-m", "octobrick.server.cli", "serve", str(folder / "data")]
    with (folder / "log").open("w") as log:
        server = subprocess.Popen(
            [*command, "--port", "0"], stdout=subprocess.PIPE, stderr=log, env=environment
        )
        try:
            assert server.stdout
            line = server.stdout.readline().decode()
            assert "http://127.0.0.1:" in line, (folder / "log").read_text()
            port = int(line.rsplit(":", 1)[1])
            target = Target(port, server.pid, folder / "data")
            revision = target.ask("GET", "/v1/volumes/head").json()["revision"]
            yield replace(target, revision=revision, secret_revision=secret_revision)
            server.terminate()
            assert server.wait(WAIT_SECONDS) == 0
        finally:
            server.kill()
            server.communicate()
    assert "Traceback" not in (folder / "log").read_text()  # whatever came, it was foreseen
