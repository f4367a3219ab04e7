"""What the routes work with: opened when the server starts, closed when it stops."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Annotated

from fastapi import Depends, Request

from octobrick.server.catalog import Catalog
from octobrick.server.render_thread import RenderThread
from octobrick.server.settings import Settings
from octobrick.server.tables import TableCache

if TYPE_CHECKING:
    from octobrick.renderer import Renderer


class Services:
    """The catalog, the threads that read, and the thread that renders.

    Args:
        settings: the server's settings.
        make_renderer: makes the renderer, in the render thread.
    """

    catalog: Catalog
    tables: TableCache
    readers: ThreadPoolExecutor
    renders: RenderThread[Renderer]

    def __init__(self, settings: Settings, make_renderer: Callable[[], Renderer]) -> None:
        self.settings = settings
        self._make_renderer = make_renderer

    def open(self) -> None:
        """Look for volumes and start the threads.

        Raises:
            ResourceError: the folder of volumes cannot be read.
        """
        self.catalog = Catalog(self.settings.data_dir, listed=self.settings.volumes)
        self.catalog.scan()
        self.tables = TableCache(self.settings.table_cache_nbytes)
        self.readers = ThreadPoolExecutor(self.settings.read_threads, "octobrick-read")
        self.renders = RenderThread(self._make_renderer, self.settings.render_queue_length)
        self.renders.start()

    def close(self) -> None:
        """Stop the threads and close the volumes."""
        self.renders.close(self.settings.shutdown_seconds)
        self.readers.shutdown()
        self.catalog.close()


def _services_of(request: Request) -> Services:
    services: Services = request.app.state.services
    return services


ServicesDep = Annotated[Services, Depends(_services_of)]
