"""What the routes work with: opened when the server starts, closed when it stops."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Annotated

from fastapi import Depends, Request

from octobrick.server.catalog import Catalog
from octobrick.server.painter import Painter
from octobrick.server.render_pool import RenderPool
from octobrick.server.settings import Settings
from octobrick.server.worker_process import RenderWorker, ThreadWorker, process_worker_factory

if TYPE_CHECKING:
    from octobrick.renderer import Renderer

_FILE_NBYTES = 65_536
"""More than what a picture file has besides its pixels."""


class Services:
    """The catalog, the threads that read, and the workers that render.

    Args:
        settings: the server's settings.
        make_renderer: makes the renderer of a worker that is a thread; None for processes, which
            make their own.
    """

    catalog: Catalog
    readers: ThreadPoolExecutor
    renders: RenderPool

    def __init__(
        self, settings: Settings, make_renderer: Callable[[], Renderer] | None = None
    ) -> None:
        self.settings = settings
        self._make_renderer = make_renderer

    def open(self) -> None:
        """Look for volumes and start the threads.

        Raises:
            ResourceError: the folder of volumes cannot be read.
        """
        self.catalog = Catalog(self.settings.data_dir)
        self.catalog.scan()
        self.readers = ThreadPoolExecutor(self.settings.read_threads, "octobrick-read")
        self.renders = RenderPool(
            self._worker_factory(),
            nworkers=self.settings.render_workers,
            queue_length=self.settings.render_queue_length,
            queue_per_client=self.settings.render_queue_per_client,
            limit_seconds=self.settings.render_timeout_seconds,
        )
        self.renders.start()

    def close(self) -> None:
        """Stop the threads and close the volumes."""
        self.renders.close(self.settings.shutdown_seconds)
        self.readers.shutdown()
        self.catalog.close()

    def _worker_factory(self) -> Callable[[], RenderWorker]:
        make_renderer = self._make_renderer
        if make_renderer is not None:
            return lambda: ThreadWorker(Painter(make_renderer))
        return process_worker_factory(
            self.settings.render_memory_budget_nbytes,
            # A picture file that compresses nothing, with its headers.
            _FILE_NBYTES + 5 * self.settings.max_image_pixels,
            self.settings.render_memory_limit_nbytes or None,
        )


def _services_of(request: Request) -> Services:
    services: Services = request.app.state.services
    return services


ServicesDep = Annotated[Services, Depends(_services_of)]
