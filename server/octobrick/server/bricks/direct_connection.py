"""A client's connection that answers plain requests for bricks as they are parsed, or before."""

from __future__ import annotations

import asyncio
from typing import Any

from uvicorn.config import Config
from uvicorn.server import ServerState

from octobrick.server.bricks.brick_headers import header_lines
from octobrick.server.bricks.direct_lane import DirectAnswer, DirectLane
from octobrick.server.operations.connection import Connection
from octobrick.server.settings import Settings


class DirectConnection(Connection):
    """HTTP/1.1 on one socket, with a direct lane before the application.

    Args:
        lane: asked first.
        settings: the limits. The rest is uvicorn's.
    """

    def __init__(
        self,
        lane: DirectLane,
        settings: Settings,
        config: Config,
        server_state: ServerState,
        app_state: dict[str, Any],
        _loop: asyncio.AbstractEventLoop | None = None,
    ) -> None:
        super().__init__(settings, config, server_state, app_state, _loop)
        self._lane = lane
        self._message = b""  # what came last, if a request began with it
        self._answered_at = 0.0

    def data_received(self, data: bytes) -> None:
        """Answer a request like an earlier one at once; parse all else."""
        if not self.is_between_requests:
            self._message = b""
            super().data_received(data)
            return
        answer = self._lane.answer_again(data) if self._is_plain(self.app) else None
        if answer is None:
            self._message = data
            super().data_received(data)
            return
        self._write(answer, keep_alive=True)
        self.server_state.total_requests += 1
        self._answered_at = self.loop.time()

    def timeout_keep_alive_handler(self) -> None:
        """Close what has been idle; a timer that started before the last answer goes on."""
        left = self._answered_at + self.timeout_keep_alive - self.loop.time()
        if left <= 0:
            super().timeout_keep_alive_handler()
            return
        self.timeout_keep_alive_task = self.loop.call_later(left, self.timeout_keep_alive_handler)

    def _start_asgi_task(self, cycle: Any, app: Any) -> None:
        answer = self._lane.answer(cycle.scope) if self._is_plain(app) else None
        if answer is None:
            super()._start_asgi_task(cycle, app)
            return
        if self._message and cycle.keep_alive:
            self._lane.keep(self._message, cycle.scope)
        self._write(answer, cycle.keep_alive)
        cycle.response_started = cycle.response_complete = True
        if not cycle.keep_alive:
            self.transport.close()
        self.on_response_complete()

    def _is_plain(self, app: Any) -> bool:
        """Not where the client is slow to take what it has, the server is full, or logs."""
        return app is self.config.loaded_app and not (self.flow.write_paused or self.access_log)

    def _write(self, answer: DirectAnswer, keep_alive: bool) -> None:
        last = header_lines(self.server_state.default_headers)
        if not keep_alive:
            last += b"connection: close\r\n"
        self.transport.writelines((answer.head + last + b"\r\n", answer.body))
