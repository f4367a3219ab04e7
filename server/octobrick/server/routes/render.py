"""Pictures of a volume, rendered on the server."""

from __future__ import annotations

import asyncio
import hashlib
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack
from typing import Annotated, Any, Final

from fastapi import APIRouter, Header, Query, Request, Response

from octobrick.codec.errors import InvalidInputError, ResourceError
from octobrick.server.catalog import unknown_volume
from octobrick.server.errors import (
    BusyError,
    ClientGoneError,
    LimitError,
    RenderCrashedError,
    RenderingOffError,
    RenderTimeoutError,
    RevisionGoneError,
    VolumeReplacedError,
)
from octobrick.server.pictures.parts_reply import Part, PartsReply
from octobrick.server.pictures.picture_request import PictureBody, PictureQuery
from octobrick.server.pictures.render_call import RenderCall
from octobrick.server.pictures.render_task import CONTENT_TYPES, PicturePart, RenderTask
from octobrick.server.reply import IMMUTABLE, matches_etag, require_revision
from octobrick.server.routes.shared import EXAMPLE_REVISION, VolumeId, documented
from octobrick.server.services import Services, ServicesDep

router = APIRouter(prefix="/v1", tags=["render"])

TRIES: Final = 3
"""A volume that is replaced during a picture is rendered anew; more often is no accident."""
CLIENT_GONE: Final = 499
"""For logs and counts alone: nobody is there to read it."""

_HEADERS = {
    "ETag": "Weak: another graphics driver may round a pixel differently.",
    "Server-Timing": "Milliseconds that the picture waited, was rendered (also by pass), and was "
    "packed.",
    "X-Octobrick-Revision": "Revision of the volume that the picture shows.",
    "X-Octobrick-Level": "Level that was rendered.",
    "X-Octobrick-Max-Error": "Largest |decoded - original| in the bricks that were rendered.",
    "X-Octobrick-Converged": "true where more time would not change the picture.",
}
_BINARY = {"schema": {"type": "string", "format": "binary"}}
_RESPONSES: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "The picture; a coarse and the final one where progressive was asked for.",
        "headers": {
            name: {"description": text, "schema": {"type": "string"}}
            for name, text in _HEADERS.items()
        },
        "content": dict.fromkeys([*CONTENT_TYPES.values(), "multipart/x-mixed-replace"], _BINARY),
    },
    **documented(
        unknown_volume("tail"),
        RevisionGoneError(
            f"Volume 'head' has revision {EXAMPLE_REVISION} now; fetch its metadata again",
            id="head",
            current_revision=EXAMPLE_REVISION,
        ),
        LimitError(
            "The picture's longer side is 100000; this server renders at most 4096",
            limit_name="max_image_side",
            limit=4096,
            value=100_000,
        ),
        InvalidInputError(
            "fov: Input should be less than 180", field="fov", where="query", rule="less_than"
        ),
        BusyError("8 pictures wait for the renderer already; try again later"),
        RenderTimeoutError("The picture was not ready within 60 seconds", limit=60.0),
        RenderCrashedError("The process that rendered the picture ended (SIGSEGV)", how="SIGSEGV"),
        VolumeReplacedError("The volume was replaced while it was rendered; ask again"),
        ResourceError("No OpenGL context could be made"),
        RenderingOffError("This server renders no pictures", setting="render_workers"),
    ),
}
_NOT_MODIFIED: dict[int | str, dict[str, Any]] = {
    304: {"description": "The client's copy is good."}
}


@router.get(
    "/volumes/{volume_id}/render",
    summary="A picture of a volume",
    response_class=Response,
    responses=_RESPONSES | _NOT_MODIFIED,
)
async def get_render(
    request: Request,
    services: ServicesDep,
    volume_id: VolumeId,
    query: Annotated[PictureQuery, Query()],
    accept: Annotated[str, Header(include_in_schema=False)] = "",
    if_none_match: Annotated[str, Header(include_in_schema=False)] = "",
) -> Response:
    """A view as a picture, all of it in the address, so that caches can keep it."""
    picture = query.picture(accept)
    task = await _task(services, volume_id, picture)
    headers = {"cache-control": IMMUTABLE if query.revision else "no-cache"}
    if query.format is None:
        headers["vary"] = "Accept"
    if picture.progressive:
        return await _progressive(services, request, task, headers)
    headers["etag"] = _etag_of(task)
    if if_none_match and matches_etag(if_none_match, headers["etag"]):
        return Response(status_code=304, headers=headers)
    return await _whole(services, request, volume_id, task, headers)


@router.post(
    "/volumes/{volume_id}/render",
    summary="A picture of a volume, with a transfer function of one's own",
    response_class=Response,
    responses=_RESPONSES,
)
async def post_render(
    request: Request, services: ServicesDep, volume_id: VolumeId, body: PictureBody
) -> Response:
    """A view that is described in JSON, as a picture."""
    task = await _task(services, volume_id, body)
    headers = {"cache-control": "no-store"}
    if body.progressive:
        return await _progressive(services, request, task, headers)
    return await _whole(services, request, volume_id, task, headers)


async def _task(services: Services, volume_id: str, picture: PictureBody) -> RenderTask:
    """What to render, of the volume that is there now; what makes no sense is refused here."""

    def look() -> RenderTask:
        with services.catalog.borrow(volume_id) as lent:
            revision = lent.volume.revision
            require_revision(lent.volume, volume_id, picture.revision or revision)
            path, stamp = str(lent.path.absolute()), lent.stamp
        return RenderTask(path, stamp, revision, picture.model_dump(mode="json"))

    task = await asyncio.get_running_loop().run_in_executor(services.readers, look)
    picture.require_within(services.settings)
    picture.require_limits(services.settings)
    picture.to_view()
    return task


def _etag_of(task: RenderTask) -> str:
    # How long one would have waited does not change what one got.
    words = {name: task.picture[name] for name in task.picture if name != "timeout_seconds"}
    question = f"{task.revision} {sorted(words.items())}"
    return f'W/"{hashlib.blake2b(question.encode(), digest_size=16).hexdigest()}"'


def _call(services: Services, request: Request, task: RenderTask) -> RenderCall:
    named = (request.scope.get("state") or {}).get("client")
    client = str(named) if named else f"address {request.client.host if request.client else ''}"
    limit_seconds = task.picture["timeout_seconds"] or services.settings.render_timeout_seconds
    return RenderCall(services.renders, task, client, request.receive, limit_seconds)


async def _whole(
    services: Services,
    request: Request,
    volume_id: str,
    task: RenderTask,
    headers: dict[str, str],
) -> Response:
    """The answer with one picture."""
    tries_left = TRIES
    while True:
        tries_left -= 1
        try:
            async with _call(services, request, task) as call:
                part = await call.next_part()
        except VolumeReplacedError:
            if not tries_left:
                raise
            task = await _task(services, volume_id, PictureBody.model_validate(task.picture))
        except ClientGoneError:
            return Response(status_code=CLIENT_GONE)
        else:
            break
    assert part is not None  # only what was stopped ends without one
    if "etag" in headers:
        headers["etag"] = _etag_of(task)
    return Response(part.body, headers=headers | _headers_of(part, task, call.queue_seconds))


async def _progressive(
    services: Services, request: Request, task: RenderTask, headers: dict[str, str]
) -> Response:
    """The answer with a coarse picture and the final one; errors before the first are ordinary."""
    async with AsyncExitStack() as stack:
        call = await stack.enter_async_context(_call(services, request, task))
        try:
            first = await call.next_part()
        except ClientGoneError:
            return Response(status_code=CLIENT_GONE)
        kept = stack.pop_all()

    async def parts() -> AsyncIterator[Part]:
        part: PicturePart | None = first
        while part is not None:
            yield _headers_of(part, task, call.queue_seconds), part.body, part.final
            part = None if part.final else await call.next_part()

    headers |= {"cache-control": "no-store", "x-octobrick-revision": task.revision}
    return PartsReply(parts(), headers, kept.aclose)


def _headers_of(part: PicturePart, task: RenderTask, queue_seconds: float) -> dict[str, str]:
    seconds = {"queue": queue_seconds} | part.seconds
    return {
        "content-type": part.content_type,
        "server-timing": ", ".join(f"{name};dur={s * 1e3:.1f}" for name, s in seconds.items()),
        "x-octobrick-revision": task.revision,
        "x-octobrick-level": str(part.level),
        "x-octobrick-max-error": f"{part.max_error:g}",
        "x-octobrick-converged": str(part.converged).lower(),
    }
