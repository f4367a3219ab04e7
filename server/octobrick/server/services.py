"""What the routes work with: opened when the server starts, closed when it stops."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Annotated

from fastapi import Depends, Request

from octobrick.server.bricks.brick_reply import BrickReplies
from octobrick.server.bricks.tables import TableCache
from octobrick.server.byte_cache import ByteCache
from octobrick.server.catalog import Catalog
from octobrick.server.interop.interop_reply import ChunkCache
from octobrick.server.operations.metrics import Counts, Metrics
from octobrick.server.operations.metrics_folder import MetricsFolder
from octobrick.server.operations.metrics_text import process_stats
from octobrick.server.operations.warm_start import WarmStart
from octobrick.server.pictures.painter import Painter
from octobrick.server.pictures.render_pool import RenderPool
from octobrick.server.pictures.worker_process import (
    RenderWorker,
    ThreadWorker,
    process_worker_factory,
)
from octobrick.server.security.guard import Access, Guard, guard_of
from octobrick.server.settings import Settings

if TYPE_CHECKING:
    from octobrick.renderer import Renderer

_FILE_NBYTES = 65_536
"""More than what a picture file has besides its pixels."""


class Services:
    """The catalog, the threads that read, what they keep, and the workers that render.

    Args:
        settings: the server's settings.
        make_renderer: makes the renderer of a worker that is a thread; None for processes, which
            make their own.
    """

    catalog: Catalog
    tables: TableCache
    decoded: ByteCache[Hashable]
    bricks: BrickReplies
    chunks: ChunkCache
    readers: ThreadPoolExecutor
    renders: RenderPool
    guard: Guard | None = None
    metrics_folder: MetricsFolder | None = None  # where there are several processes
    draining = False

    def __init__(
        self, settings: Settings, make_renderer: Callable[[], Renderer] | None = None
    ) -> None:
        self.settings = settings
        self.metrics = Metrics()
        self._make_renderer = make_renderer
        self._warm_start: WarmStart | None = None

    def open(self) -> None:
        """Look for volumes and start the threads.

        Raises:
            ResourceError: the folder of volumes, or a file of tokens or keys, cannot be read.
            InvalidInputError: a file of tokens or keys is not sound.
        """
        self.guard = guard_of(self.settings)
        self.catalog = Catalog(self.settings.data_dir, listed=self.settings.volumes)
        self.catalog.scan()
        self.tables = TableCache(self.settings.table_cache_nbytes)
        self.decoded = ByteCache(self.settings.decoded_cache_nbytes)
        self.bricks = BrickReplies(self.catalog, self.decoded)
        self.chunks = ChunkCache(self.settings.chunk_cache_nbytes)
        self.readers = ThreadPoolExecutor(self.settings.read_threads, "octobrick-read")
        self.renders = RenderPool(
            self._worker_factory(),
            nworkers=self.settings.render_workers,
            queue_length=self.settings.render_queue_length,
            queue_per_client=self.settings.render_queue_per_client,
            limit_seconds=self.settings.render_timeout_seconds,
        )
        self.renders.start()
        self._wire_metrics()
        if self.settings.warm_start:
            self._warm_start = WarmStart(self.catalog)
            self._warm_start.start()

    def close(self) -> None:
        """Stop the threads and close the volumes."""
        self.draining = True
        if self._warm_start is not None:
            self._warm_start.stop()
        self.renders.close(self.settings.shutdown_seconds)
        self.readers.shutdown()
        self.catalog.close()

    def all_counts(self) -> Counts:
        """What this process counted and has, and the others of this server, if any."""
        counts = self.metrics.counts()
        return counts if self.metrics_folder is None else self.metrics_folder.with_others(counts)

    def _wire_metrics(self) -> None:
        """Each part tells its own numbers; docs/operations.md lists them."""
        self.metrics.wire("process", process_stats)
        self.metrics.wire("catalog", self.catalog.stats)
        self.metrics.wire("render", self.renders.stats)
        self.metrics.wire("decoded", self.decoded.stats)
        self.metrics.wire("tables", self.tables.stats)
        self.metrics.wire("chunks", self.chunks.stats)

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


def _access_of(request: Request) -> Access | None:
    access: Access | None = getattr(request.state, "access", None)
    return access


# What the caller may see; None on a server where everybody may see everything.
AccessDep = Annotated[Access | None, Depends(_access_of)]
