"""The application: routes, what every request passes, and what lives as long as the server."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING

from fastapi import FastAPI
from fastapi.middleware.cors import CORSMiddleware

from octobrick.server.brick_lane import BrickLane
from octobrick.server.error_replies import handle_errors
from octobrick.server.front_door import FrontDoor
from octobrick.server.routes import bricks, docs, health, render, volumes
from octobrick.server.services import Services
from octobrick.server.settings import Settings

if TYPE_CHECKING:
    from octobrick.renderer import Renderer

_DESCRIPTION = """\
Volumes too big for memory, as compressed bricks and as pictures.

Every error has one shape, `{"error": {"kind", "message", "facts"}}`; kinds are stable."""

# Headers that a page of another origin may read, where `cors_origins` lets it.
_EXPOSED_HEADERS = [
    "ETag",
    "Retry-After",
    "Server-Timing",
    "X-Octobrick-Codec",
    "X-Octobrick-Dtype",
    "X-Octobrick-Level",
    "X-Octobrick-Converged",
    "X-Octobrick-Max-Error",
    "X-Octobrick-Range",
    "X-Octobrick-Revision",
    "X-Octobrick-Rmse",
    "X-Octobrick-Shape",
]


def create_app(
    settings: Settings, *, make_renderer: Callable[[], Renderer] | None = None
) -> FastAPI:
    """The service as an ASGI application; nothing is opened before its lifespan starts.

    Args:
        settings: checked settings.
        make_renderer: makes a renderer for a thread of this process to use, for tests; by default
            pictures are rendered by processes of their own.
    """
    services = Services(settings, make_renderer)

    @asynccontextmanager
    async def lifespan(_app: FastAPI) -> AsyncIterator[None]:
        services.open()
        try:
            yield
        finally:
            services.close()

    app = FastAPI(
        title="octobrick",
        description=_DESCRIPTION,
        version=_version(),
        lifespan=lifespan,
        docs_url=None,  # FastAPI's page loads scripts from elsewhere; ours works without
        redoc_url=None,
        redirect_slashes=False,  # a redirect would be built from a header that the client sent
    )
    app.state.services = services
    handle_errors(app)
    for routes in (health, volumes, bricks, render, docs):
        app.include_router(routes.router)
    # The last one added is the first one passed.
    app.add_middleware(BrickLane, services=services)
    app.add_middleware(FrontDoor, max_body_nbytes=settings.max_body_nbytes)
    if settings.cors_origins:
        app.add_middleware(
            CORSMiddleware,
            allow_origins=settings.cors_origins,
            allow_methods=["GET", "HEAD", "POST"],
            allow_headers=["Content-Type", "If-None-Match"],
            expose_headers=_EXPOSED_HEADERS,
        )
    return app


def _version() -> str:
    try:
        return version("octobrick")
    except PackageNotFoundError:  # run from a source tree that is not installed
        return "0+unknown"
