"""Pictures of a volume, rendered on the server."""

from __future__ import annotations

import asyncio
import hashlib
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

from fastapi import APIRouter, Header, Query, Response

from octobrick.codec.errors import InvalidInputError, ResourceError
from octobrick.server.catalog import OpenVolume, unknown_volume
from octobrick.server.errors import BusyError, LimitError, RenderTimeoutError, RevisionGoneError
from octobrick.server.reply import IMMUTABLE, matches_etag, require_revision
from octobrick.server.routes.shared import EXAMPLE_REVISION, VolumeId, documented
from octobrick.server.services import Services, ServicesDep
from octobrick.server.view_request import ViewBody, ViewQuery

if TYPE_CHECKING:
    from octobrick.renderer import RenderedImage, Renderer

router = APIRouter(prefix="/v1", tags=["render"])

_HEADERS = {
    "ETag": "Weak: another graphics driver may round a pixel differently.",
    "Server-Timing": "Milliseconds that the picture waited, was rendered, and was packed as PNG.",
    "X-Octobrick-Revision": "Revision of the volume that the picture shows.",
    "X-Octobrick-Level": "Level that was rendered.",
    "X-Octobrick-Max-Error": "Largest |decoded - original| in the bricks that were rendered.",
    "X-Octobrick-Converged": "true where more time would not change the picture.",
}
_RESPONSES: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "The picture.",
        "headers": {
            name: {"description": text, "schema": {"type": "string"}}
            for name, text in _HEADERS.items()
        },
        "content": {"image/png": {"schema": {"type": "string", "format": "binary"}}},
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
        ResourceError("No OpenGL context could be made"),
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
    services: ServicesDep,
    volume_id: VolumeId,
    query: Annotated[ViewQuery, Query()],
    if_none_match: Annotated[str, Header(include_in_schema=False)] = "",
) -> Response:
    """A PNG of a view, all of which is in the address, so that caches can keep it."""
    revision = await _revision_of(services, volume_id, query.revision)
    etag = _etag_of(revision, query)
    headers = {"etag": etag, "cache-control": IMMUTABLE if query.revision else "no-cache"}
    if if_none_match and matches_etag(if_none_match, etag):
        return Response(status_code=304, headers=headers)
    picture = await _picture(services, volume_id, query)
    headers["etag"] = _etag_of(picture.revision, query)
    return Response(picture.png, headers=headers | picture.headers, media_type="image/png")


@router.post(
    "/volumes/{volume_id}/render",
    summary="A picture of a volume, with a transfer function of one's own",
    response_class=Response,
    responses=_RESPONSES,
)
async def post_render(services: ServicesDep, volume_id: VolumeId, body: ViewBody) -> Response:
    """A PNG of a view that is described in JSON."""
    await _revision_of(services, volume_id, body.revision)  # nothing unknown waits for its turn
    picture = await _picture(services, volume_id, body)
    headers = {"cache-control": "no-store", **picture.headers}
    return Response(picture.png, headers=headers, media_type="image/png")


@dataclass(frozen=True, slots=True)
class _Picture:
    png: bytes
    revision: str
    headers: dict[str, str]


async def _revision_of(services: Services, volume_id: str, wanted: str | None) -> str:
    def look() -> str:
        with services.catalog.borrow(volume_id) as lent:
            require_revision(lent.volume, volume_id, wanted or lent.volume.revision)
            return lent.volume.revision

    return await asyncio.get_running_loop().run_in_executor(services.readers, look)


def _etag_of(revision: str, query: ViewQuery) -> str:
    question = f"{revision} {query.model_dump_json()}"
    return f'W/"{hashlib.blake2b(question.encode(), digest_size=16).hexdigest()}"'


async def _picture(services: Services, volume_id: str, request: ViewQuery | ViewBody) -> _Picture:
    """Wait for a picture, within the limits of the settings."""
    request.require_within(services.settings)
    view = request.to_view()
    asked = time.monotonic()

    def use(renderer: Renderer, lent: OpenVolume) -> tuple[RenderedImage, str]:
        require_revision(lent.volume, volume_id, request.revision or lent.volume.revision)
        return view.render(renderer, lent.volume), lent.volume.revision

    def job(renderer: Renderer) -> tuple[RenderedImage, str, float]:
        started = time.monotonic()
        return *services.catalog.read(volume_id, lambda lent: use(renderer, lent)), started

    # A picture that nobody waits for any more is cancelled, and not begun if it is not yet.
    waiting = asyncio.wrap_future(services.renders.submit(job))
    limit_seconds = services.settings.render_timeout_seconds
    try:
        image, revision, started = await asyncio.wait_for(waiting, limit_seconds)
    except TimeoutError:
        raise RenderTimeoutError(
            f"The picture was not ready within {limit_seconds:g} seconds; ask for a smaller one, "
            "or try again later",
            limit_name="render_timeout_seconds",
            limit=limit_seconds,
        ) from None
    rendered = time.monotonic()
    png = await asyncio.to_thread(image.png)
    timing = {"queue": started - asked, "render": rendered - started}
    timing["encode"] = time.monotonic() - rendered
    return _Picture(png, revision, _describe(image, revision, timing))


def _describe(image: RenderedImage, revision: str, timing: dict[str, float]) -> dict[str, str]:
    fidelity = image.fidelity
    return {
        "server-timing": ", ".join(f"{name};dur={s * 1e3:.1f}" for name, s in timing.items()),
        "x-octobrick-revision": revision,
        "x-octobrick-level": str(fidelity.level),
        "x-octobrick-max-error": f"{fidelity.max_error:g}",
        "x-octobrick-converged": str(fidelity.converged).lower(),
    }
