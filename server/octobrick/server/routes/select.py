"""The bricks that a view needs."""

from __future__ import annotations

import asyncio
import hashlib
import time
from typing import Annotated, Any

from fastapi import APIRouter, Header, Query, Response

from octobrick.codec.errors import InvalidInputError
from octobrick.server.bricks.selection import SelectBody, SelectQuery, SelectReply, answer
from octobrick.server.catalog import unknown_volume
from octobrick.server.errors import LimitError, RevisionGoneError
from octobrick.server.reply import IMMUTABLE, matches_etag, require_revision
from octobrick.server.routes.shared import EXAMPLE_REVISION, VolumeId, documented
from octobrick.server.services import Services, ServicesDep
from octobrick.store.errors import VolumeFormatError

router = APIRouter(prefix="/v1", tags=["bricks"])

_HEADERS = {"Server-Timing": "Milliseconds that the selection took."}
_RESPONSES: dict[int | str, dict[str, Any]] = {
    200: {
        "model": SelectReply,
        "description": "The bricks.",
        "headers": {
            name: {"description": text, "schema": {"type": "string"}}
            for name, text in _HEADERS.items()
        },
    },
    **documented(
        unknown_volume("tail"),
        RevisionGoneError(
            f"Volume 'head' has revision {EXAMPLE_REVISION} now; fetch its metadata again",
            id="head",
            current_revision=EXAMPLE_REVISION,
        ),
        InvalidInputError(
            "fov: Input should be less than 180", field="fov", where="query", rule="less_than"
        ),
        VolumeFormatError("head.zarr/range/0: cannot be read; restore the files"),
    ),
}
_GET_RESPONSES: dict[int | str, dict[str, Any]] = {
    304: {"description": "The client's copy is good."}
}
_POST_RESPONSES = documented(
    LimitError(
        "The request body has 300000 bytes or more; this server accepts 262144",
        limit_name="max_body_nbytes",
        limit=262_144,
        value=300_000,
    )
)


@router.get(
    "/volumes/{volume_id}/select",
    summary="The bricks that a view needs",
    response_class=Response,
    responses=_RESPONSES | _GET_RESPONSES,
)
async def get_select(
    services: ServicesDep,
    volume_id: VolumeId,
    query: Annotated[SelectQuery, Query()],
    if_none_match: Annotated[str, Header(include_in_schema=False)] = "",
) -> Response:
    """Bricks of one level in the order of their use; all of the view is in the address.

    With `revision` the answer never changes, and caches can keep it.
    """

    def look() -> str:
        with services.catalog.borrow(volume_id) as lent:
            require_revision(lent.volume, volume_id, query.revision or lent.volume.revision)
            return lent.volume.revision

    headers = {"cache-control": IMMUTABLE if query.revision else "no-cache"}
    if if_none_match:
        revision = await asyncio.get_running_loop().run_in_executor(services.readers, look)
        etag = _etag_of(revision, query)
        if matches_etag(if_none_match, etag):
            return Response(status_code=304, headers=headers | {"etag": etag})
    reply, revision = await _reply(services, volume_id, query)
    reply.headers.update(headers | {"etag": _etag_of(revision, query)})
    return reply


@router.post(
    "/volumes/{volume_id}/select",
    summary="The bricks that a view needs beside those that are there",
    response_class=Response,
    responses=_RESPONSES | _POST_RESPONSES,
)
async def post_select(services: ServicesDep, volume_id: VolumeId, body: SelectBody) -> Response:
    """Bricks of one level in the order of their use, for a camera and function of one's own."""
    reply, _ = await _reply(services, volume_id, body)
    reply.headers["cache-control"] = "no-store"
    return reply


def _etag_of(revision: str, query: SelectQuery) -> str:
    """Weak: another version may write the same answer with other digits."""
    question = f"select {revision} {query.model_dump_json()}"
    return f'W/"{hashlib.blake2b(question.encode(), digest_size=16).hexdigest()}"'


async def _reply(
    services: Services, volume_id: str, question: SelectQuery | SelectBody
) -> tuple[Response, str]:
    """The answer and its revision, made in a thread: other requests go on meanwhile."""
    bricks_max = services.settings.max_selected_bricks

    def select() -> tuple[bytes, str, float]:
        start = time.perf_counter()
        body, revision = services.catalog.read(
            volume_id,
            lambda lent: (answer(lent, volume_id, question, bricks_max), lent.volume.revision),
        )
        return body, revision, time.perf_counter() - start

    loop = asyncio.get_running_loop()
    body, revision, seconds = await loop.run_in_executor(services.readers, select)
    timing = {"server-timing": f"select;dur={seconds * 1e3:.1f}"}
    return Response(body, headers=timing, media_type="application/json"), revision
