"""One process that serves: uvicorn with our limits, an orderly stop, and counts left for others."""

from __future__ import annotations

import functools
import logging
import os
import signal
import socket
import time
from collections.abc import Callable
from pathlib import Path
from types import FrameType

import uvicorn

from octobrick.server.app import create_app
from octobrick.server.bricks.direct_admission import DirectAdmission
from octobrick.server.bricks.direct_connection import DirectConnection
from octobrick.server.bricks.direct_lane import DirectLane
from octobrick.server.operations.connection import Connection
from octobrick.server.operations.log_format import log_config
from octobrick.server.operations.metrics_folder import WRITE_SECONDS, MetricsFolder
from octobrick.server.services import Services
from octobrick.server.settings import Settings

_SWEEP_SECONDS = 1.0


class ServerProcess(uvicorn.Server):
    """Serves on a socket until it is told to stop; then finishes what is under way.

    Args:
        settings: the server's settings.
        on_ready: called once requests are answered.
        metrics_folder: where several processes add up their counts.
    """

    def __init__(
        self,
        settings: Settings,
        on_ready: Callable[[], None],
        metrics_folder: Path | None = None,
    ) -> None:
        app = create_app(settings)
        self._services: Services = app.state.services
        super().__init__(_config(app, self._services))
        if metrics_folder is not None:
            self._services.metrics_folder = MetricsFolder(metrics_folder)
        self._settings = settings
        self._on_ready = on_ready
        self._swept = self._written = 0.0
        self._stop_asked: float | None = None

    def stop(self) -> None:
        """Be no longer ready, then take no new connections, finish, and end. For any thread."""
        if self._stop_asked is None:
            self._stop_asked = time.monotonic()
            self._services.draining = True

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Open everything, then say so."""
        await super().startup(sockets)
        self._leave_counts(time.monotonic())
        self._on_ready()

    async def on_tick(self, counter: int) -> bool:
        """Ten times a second: look after connections and counts; True ends serving."""
        now = time.monotonic()
        if now - self._swept >= _SWEEP_SECONDS:
            self._swept = now
            for connection in list(self.server_state.connections):
                if isinstance(connection, Connection):
                    connection.cut_off_if_late(self._settings.receive_seconds)
        if now - self._written >= WRITE_SECONDS:
            self._leave_counts(now)
        drained = (
            self._stop_asked is not None and now - self._stop_asked >= self._settings.drain_seconds
        )
        return await super().on_tick(counter) or drained

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Finish what is under way, within the time of the settings."""
        await super().shutdown(sockets)
        self._leave_counts(time.monotonic())

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """The first signal stops in order, the second one at once."""
        del frame
        if self._stop_asked is not None:
            signal.signal(sig, signal.SIG_DFL)
            os.kill(os.getpid(), sig)
        self.stop()

    def _leave_counts(self, now: float) -> None:
        self._written = now
        folder = self._services.metrics_folder
        if folder is not None:
            folder.write(self._services.metrics.counts())


def listen(settings: Settings) -> socket.socket:
    """A listening socket, made before anything else, so that its port is known and is ours.

    Raises:
        OSError: the address is taken, or not this machine's.
    """
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    address = (settings.host, settings.port)
    listener = socket.create_server(address, family=family, backlog=2048)
    # Connections inherit it: who takes nothing of an answer for so long is cut off by the system.
    if hasattr(socket, "TCP_USER_TIMEOUT"):
        timeout_ms = settings.stall_seconds * 1000
        listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, timeout_ms)
    return listener


def _config(app: object, services: Services) -> uvicorn.Config:
    logging.captureWarnings(True)
    settings = services.settings
    admission = DirectAdmission(services)
    lane = DirectLane(services, admission.admit, admission.note)
    proxies = list(settings.trusted_proxies)
    return uvicorn.Config(
        app,  # type: ignore[arg-type]  # an ASGI application
        access_log=False,  # ours has more to say, and a say in what it leaves out
        backlog=2048,
        forwarded_allow_ips=proxies,
        http=functools.partial(DirectConnection, lane, settings),  # type: ignore[arg-type]
        lifespan="on",
        log_config=log_config(settings.log_level, settings.log_format),
        loop="uvloop",
        proxy_headers=bool(proxies),
        server_header=False,
        timeout_graceful_shutdown=settings.shutdown_seconds,
        timeout_keep_alive=settings.keep_alive_seconds,
        ws="none",
    )
