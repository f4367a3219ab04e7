"""Servers that benchmarks of the service start: octobrick under several servers, and nginx."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve()
SERVERS = ("serve", "uvicorn", "granian")
_START_SECONDS = 20
_NGINX = """
worker_processes {workers}; daemon off; pid {folder}/nginx.pid; error_log stderr;
events {{ worker_connections 4096; }}
http {{
  access_log off; sendfile on; tcp_nopush on; keepalive_requests 1000000000;
  default_type application/octet-stream;
  client_body_temp_path {folder}/a; proxy_temp_path {folder}/b; fastcgi_temp_path {folder}/c;
  uwsgi_temp_path {folder}/d; scgi_temp_path {folder}/e;
  server {{ listen 127.0.0.1:{port} reuseport; root {root}; location = / {{ return 204; }} }}
}}
"""


def require(program: str, package: str) -> str:
    """The path of a program, or an end that names the package to install."""
    found = shutil.which(program) or shutil.which(program, path="/usr/sbin:/sbin")
    if found is None:
        sys.exit(f"this benchmark needs {program}: apt-get install {package}")
    return found


def free_port() -> int:
    """A port that nobody listens on now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def nginx(root: Path, workers: int, folder: Path) -> Iterator[tuple[int, int]]:
    """An nginx of our own that serves files; its port and process."""
    port = free_port()
    folder.mkdir(parents=True, exist_ok=True)
    config = folder / "nginx.conf"
    config.write_text(_NGINX.format(workers=workers, folder=folder, port=port, root=root))
    command = [require("nginx", "nginx-light"), "-c", str(config), "-e", "stderr"]
    with _running(command, dict(os.environ), port, "/") as process:
        yield port, process.pid


@contextmanager
def octobrick(data_dir: Path, workers: int, server: str) -> Iterator[tuple[int, int]]:
    """Octobrick with so many workers; its port and process.

    `serve` is `octobrick serve`; the others have the application alone under a server.
    """
    port = free_port()
    environment = {
        **os.environ,
        "OCTOBRICK_DATA_DIR": str(data_dir),
        "PYTHONPATH": str(HERE.parent),
    }
    address = ["--workers", str(workers), "--host", "127.0.0.1", "--port", str(port)]
    # fmt: off
    options = {
        "serve": ["octobrick.server.cli", "serve", str(data_dir), "--log-level", "error"],
        "uvicorn": [
            "uvicorn", "--http", "httptools", "--loop", "uvloop", "--no-access-log",
            "--log-level", "error", "--factory", "_service:application",
        ],
        "granian": [
            "granian", "--interface", "asgi", "--loop", "uvloop", "--no-log", "--factory",
            "_service:application",
        ],
    }[server]
    # fmt: on
    command = [sys.executable, "-m", *options, *address]
    with _running(command, environment, port, "/healthz") as process:
        yield port, process.pid


def application() -> Any:
    """The application, with settings from the environment."""
    from octobrick.server import Settings, create_app

    return create_app(Settings())


@contextmanager
def _running(
    command: list[str], environment: dict[str, str], port: int, path: str
) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen(command, env=environment, start_new_session=True)
    try:
        _wait(process, f"http://127.0.0.1:{port}{path}")
        yield process
    finally:
        os.killpg(process.pid, signal.SIGTERM)  # a group of its own: its workers too
        try:
            process.wait(15)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def _wait(process: subprocess.Popen[bytes], url: str) -> None:
    end = time.monotonic() + _START_SECONDS
    while time.monotonic() < end and process.poll() is None:
        try:
            with urllib.request.urlopen(url, timeout=2):
                return
        except urllib.error.HTTPError:
            return  # it answers
        except OSError:
            time.sleep(0.1)
    sys.exit(f"no answer from {url}; the server said why above")
