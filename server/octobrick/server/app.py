"""The application: routes, what every request passes, and what lives as long as the server."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

from fastapi import FastAPI
from starlette.middleware.cors import CORSMiddleware
from starlette.middleware.errors import ServerErrorMiddleware
from starlette.types import ASGIApp

from octobrick.server.bricks.brick_lane import BrickLane
from octobrick.server.error_replies import handle_errors
from octobrick.server.front_door import FrontDoor
from octobrick.server.operations.access_log import AccessLog
from octobrick.server.routes import (
    batch,
    bricks,
    docs,
    health,
    interop,
    render,
    select,
    tables,
    volumes,
)
from octobrick.server.security.gate import Gate
from octobrick.server.security.security_headers import security_headers
from octobrick.server.services import Services
from octobrick.server.settings import Settings

if TYPE_CHECKING:
    from octobrick.renderer import Renderer

_DESCRIPTION = """\
Volumes too big for memory, as compressed bricks and as pictures.

Every error has one shape, `{"error": {"kind", "message", "facts"}}`; kinds are stable."""

# Headers that a page of another origin may read, where `cors_origins` lets it.
_EXPOSED_HEADERS = [
    "Content-Range",
    "ETag",
    "Retry-After",
    "Server-Timing",
    "X-Request-Id",
    "X-Octobrick-Codec",
    "X-Octobrick-Dtype",
    "X-Octobrick-Level",
    "X-Octobrick-Converged",
    "X-Octobrick-Error",
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

    app = _App(
        services,
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
    for routes in (health, volumes, tables, bricks, batch, select, render, interop, docs):
        app.include_router(routes.router)
    return app


class _App(FastAPI):
    """FastAPI behind what every request passes: its own layers cost as much as a brick does."""

    def __init__(self, services: Services, **options: Any) -> None:
        super().__init__(**options)
        self._services = services

    def build_middleware_stack(self) -> ASGIApp:
        """All layers, made from the inmost to the outmost."""
        services, settings = self._services, self._services.settings
        framework = super().build_middleware_stack()
        # Starlette's own answer to unexpected errors is text; the front door has ours.
        assert isinstance(framework, ServerErrorMiddleware)
        app: ASGIApp = BrickLane(framework.app, services)
        app = Gate(app, settings, lambda: services.guard)
        if settings.cors_origins:
            # Before the gate: a preflight has no token, and pages must be able to read refusals.
            app = CORSMiddleware(
                app,
                allow_origins=settings.cors_origins,
                allow_methods=["GET", "HEAD", "POST"],
                allow_headers=[
                    "Authorization",
                    "Content-Type",
                    "If-None-Match",
                    "Range",
                    "X-Request-Id",
                ],
                expose_headers=_EXPOSED_HEADERS,
            )
        headers = security_headers(other_origins=bool(settings.cors_origins))
        return FrontDoor(app, services.metrics, AccessLog(settings.access_log), headers)


def _version() -> str:
    try:
        return version("octobrick")
    except PackageNotFoundError:  # run from a source tree that is not installed
        return "0+unknown"
