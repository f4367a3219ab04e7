"""One request's picture, seen from the event loop: parts, a deadline, a client who left."""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress
from types import TracebackType
from typing import Self

from starlette.types import Receive

from octobrick.server.errors import ClientGoneError, RenderTimeoutError
from octobrick.server.pictures.render_job import Event
from octobrick.server.pictures.render_pool import RenderPool
from octobrick.server.pictures.render_task import PicturePart, RenderTask


class RenderCall:
    """Asks a pool for a picture. An asynchronous context, at whose end nothing is left behind.

    Args:
        pool: that renders.
        task: what.
        client: who asks.
        receive: of the request; its body must have been read.
        limit_seconds: to wait for all parts together.

    Raises:
        BusyError: the queue is full.
        RenderingOffError: there are no workers.
    """

    def __init__(
        self,
        pool: RenderPool,
        task: RenderTask,
        client: str,
        receive: Receive,
        limit_seconds: float,
    ) -> None:
        loop = asyncio.get_running_loop()
        self._events: asyncio.Queue[Event] = asyncio.Queue()

        def deliver(event: Event) -> None:
            with suppress(RuntimeError):  # the loop has ended meanwhile
                loop.call_soon_threadsafe(self._events.put_nowait, event)

        self._pool = pool
        self._limit_seconds = limit_seconds
        self._job = pool.submit(task, client, deliver)
        self._gone = loop.create_task(_until_gone(receive))

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self,
        _type: type[BaseException] | None,
        _error: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:
        self._pool.stop(self._job)
        self._gone.cancel()

    @property
    def queue_seconds(self) -> float:
        """How long the picture waited for a worker."""
        return (self._job.started or time.monotonic()) - self._job.asked

    async def next_part(self) -> PicturePart | None:
        """The next part; None where there is none.

        Raises:
            RenderTimeoutError: it was not there in time.
            ClientGoneError: the client left.
            Exception: what went wrong with the picture.
        """
        left = self._limit_seconds - (time.monotonic() - self._job.asked)
        getting = asyncio.ensure_future(self._events.get())
        try:
            await asyncio.wait(
                {getting, self._gone}, timeout=max(left, 0), return_when=asyncio.FIRST_COMPLETED
            )
            if getting.done():
                event = getting.result()
                if isinstance(event, Exception):
                    raise event
                return event
        finally:
            getting.cancel()
        if self._gone.done():
            raise ClientGoneError
        raise RenderTimeoutError(
            f"The picture was not ready within {self._limit_seconds:g} seconds; ask for a smaller "
            "one, or try again later",
            limit_name="render_timeout_seconds",
            limit=self._limit_seconds,
        )


async def _until_gone(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
