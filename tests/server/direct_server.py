"""An app under uvicorn with a direct lane, on a real socket."""

from __future__ import annotations

import functools
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import uvicorn
from fastapi import FastAPI

from octobrick.server.bricks.direct_connection import DirectConnection
from octobrick.server.bricks.direct_lane import DirectLane


@contextmanager
def served(app: FastAPI, lane: DirectLane, lifespan: str = "off") -> Iterator[str]:
    """The address of the app; "on" where nothing else has opened it."""
    settings = app.state.services.settings
    with socket.create_server(("127.0.0.1", 0)) as listener:
        config = uvicorn.Config(
            app,
            http=functools.partial(DirectConnection, lane, settings),  # type: ignore[arg-type]
            lifespan=lifespan,  # type: ignore[arg-type]
            log_level="error",
            access_log=False,
        )
        server = uvicorn.Server(config)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
        thread.start()
        try:
            yield f"http://127.0.0.1:{listener.getsockname()[1]}"
        finally:
            server.should_exit = True
            thread.join()
