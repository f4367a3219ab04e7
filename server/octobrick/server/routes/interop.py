"""Volumes in the words of others: OME-Zarr, and Neuroglancer's precomputed format.

Keys have slashes, which no path of OpenAPI can have, and the formats have specifications of their
own, so these routes are described in docs/interop.md. Routes of Starlette, of which FastAPI's are
made, take a fraction of the time.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from fastapi import APIRouter, Request, Response

from octobrick.server.interop import ome_zarr, precomputed
from octobrick.server.interop.interop_reply import Question, interop_reply, parse_name
from octobrick.server.interop.resources import Resource
from octobrick.server.services import Services
from octobrick.store import LocalVolume

router = APIRouter()


async def get_zarr(request: Request) -> Response:
    """A key of the Zarr v3 hierarchy of a volume, OME-Zarr 0.5. Also answers HEAD."""
    return await _answer(request, ome_zarr.find_v3)


async def get_zarr2(request: Request) -> Response:
    """A key of the Zarr v2 hierarchy of a volume, OME-Zarr 0.4. Also answers HEAD."""
    return await _answer(request, ome_zarr.find_v2)


async def get_precomputed(request: Request) -> Response:
    """A key of the precomputed volume of a time step. Also answers HEAD."""
    return await _answer(request, precomputed.find)


for path, endpoint in (
    ("/zarr/{volume_id}/{key:path}", get_zarr),
    ("/zarr2/{volume_id}/{key:path}", get_zarr2),
    ("/precomputed/{volume_id}/{key:path}", get_precomputed),
):
    router.add_route(path, endpoint, ["GET"], include_in_schema=False)


async def _answer(request: Request, find: Callable[[LocalVolume, str], Resource]) -> Response:
    services: Services = request.app.state.services
    volume_id, revision = parse_name(request.path_params["volume_id"])
    question = Question(volume_id, revision, request.path_params["key"], dict(request.headers))
    reply = await asyncio.get_running_loop().run_in_executor(
        services.readers, interop_reply, services.catalog, services.chunks, find, question
    )
    body = b"" if request.method == "HEAD" else reply.body
    return Response(body, reply.status, reply.headers)
