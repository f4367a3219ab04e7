"""Liveness, readiness and metrics: what looks after the server asks for these."""

from __future__ import annotations

import hmac
import ipaddress

from fastapi import APIRouter, Request, Response
from pydantic import BaseModel, ConfigDict

from octobrick.codec.errors import OctobrickError
from octobrick.server.errors import (
    ForbiddenError,
    NotReadyError,
    RouteNotFoundError,
    UnauthorizedError,
)
from octobrick.server.operations.metrics_text import metrics_text
from octobrick.server.routes.shared import documented
from octobrick.server.security.guard import bearer_secret
from octobrick.server.services import ServicesDep
from octobrick.server.settings import Settings

router = APIRouter(tags=["operations"])

_STOPPING = NotReadyError("The server is stopping", reasons=["stopping"])


class Health(BaseModel):
    """The server answers."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"status": "ok"}]})

    status: str


class Readiness(BaseModel):
    """The server can serve."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"status": "ready"}]})

    status: str


@router.get("/healthz", summary="Liveness")
async def healthz() -> Health:
    """200 as long as the process answers requests; says nothing of any volume."""
    return Health(status="ok")


@router.get("/readyz", summary="Readiness", responses=documented(_STOPPING))
def readyz(services: ServicesDep, response: Response) -> Readiness:
    """200 where the server can serve; else 503 with the reasons.

    It can serve once it has listed its volumes and while it still can, until it is told to stop.
    Neither a single broken volume nor a missing OpenGL makes it unready: all else is served.
    """
    if services.draining:
        raise _STOPPING
    try:
        services.catalog.scan()
    except OctobrickError as error:
        raise NotReadyError(
            "The volumes cannot be listed; the log says why", reasons=["volumes-not-listed"]
        ) from error
    response.headers["cache-control"] = "no-store"
    return Readiness(status="ready")


@router.get("/metrics", include_in_schema=False)
async def metrics(services: ServicesDep, request: Request) -> Response:
    """Numbers for Prometheus; of all processes, where there are several."""
    _require_reader(services.settings, request)
    body, content_type = metrics_text(services.all_counts(), request.headers.get("accept", ""))
    return Response(body, media_type=content_type, headers={"cache-control": "no-store"})


def _require_reader(settings: Settings, request: Request) -> None:
    token = settings.metrics_token
    sent = bearer_secret(request.scope)
    if token is not None and sent is not None:
        if hmac.compare_digest(sent, token.get_secret_value().encode()):
            return
        raise UnauthorizedError("The token is not the one for metrics")
    if settings.metrics == "all" or (settings.metrics == "loopback" and _is_local(request)):
        return
    if token is not None:
        raise UnauthorizedError("Metrics want their token: 'Authorization: Bearer TOKEN'")
    if settings.metrics == "off":
        raise RouteNotFoundError("No route has this address; see the list of routes at docs")
    raise ForbiddenError(
        "Metrics are for this machine alone; metrics=all or a metrics_token lets others in"
    )


def _is_local(request: Request) -> bool:
    """Whether the request was made on this machine, and not by a proxy for somebody else."""
    if any(name in request.headers for name in ("x-forwarded-for", "forwarded", "via")):
        return False
    try:
        return request.client is not None and ipaddress.ip_address(request.client.host).is_loopback
    except ValueError:
        return False
