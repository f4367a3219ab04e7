"""Many bricks in one streamed body."""

from __future__ import annotations

import asyncio
from concurrent.futures import Future
from contextlib import ExitStack
from typing import Annotated, Any, Literal

import numpy as np
from fastapi import APIRouter, Response
from pydantic import BaseModel, ConfigDict, Field

from octobrick.codec.errors import InvalidInputError
from octobrick.server.bricks.brick_stream import BrickStream, BrickStreamResponse
from octobrick.server.bricks.places import require_bricks
from octobrick.server.catalog import unknown_volume
from octobrick.server.errors import BrickNotFoundError, LimitError, RevisionGoneError
from octobrick.server.reply import require_revision
from octobrick.server.routes.shared import EXAMPLE_REVISION, VolumeId, documented
from octobrick.server.services import Services, ServicesDep
from octobrick.store.brick_stream import MEDIA_TYPE, Kind
from octobrick.store.errors import VolumeFormatError

router = APIRouter(prefix="/v1", tags=["bricks"])

Index = Annotated[int, Field(strict=True, ge=0, le=999_999_999)]


class BatchBody(BaseModel):
    """Which bricks, in which order."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [
                {
                    "revision": EXAMPLE_REVISION,
                    "kind": "voxels",
                    "bricks": [[1, 0, 0, 0, 0, 0], [0, 0, 0, 1, 1, 1]],
                }
            ]
        },
    )

    revision: str = Field(max_length=128, description="Revision of the volume.")
    kind: Literal["voxels", "gradients"] = Field(
        "voxels", description="Bricks of voxels, or of directions of gradients."
    )
    bricks: list[tuple[Index, Index, Index, Index, Index, Index]] = Field(
        description="Level, t, c, z, y, x of each, at most `max_batch_bricks`; may repeat."
    )


_RESPONSES: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "A brick stream: a record for each brick, in the order asked for, and an "
        "end record. A brick that cannot be read is a record with an error.",
        "headers": {
            "X-Octobrick-Revision": {
                "description": "Revision that the bricks are of.",
                "schema": {"type": "string"},
            }
        },
        "content": {MEDIA_TYPE: {"schema": {"type": "string", "format": "binary"}}},
    },
    **documented(
        unknown_volume("tail"),
        BrickNotFoundError(
            "The volume has no voxels of brick [9, 0, 0, 0, 0, 0] (level, t, c, z, y, x), which is "
            "number 3 of the list, counted from 0; its metadata says what it has",
            index=3,
            brick=[9, 0, 0, 0, 0, 0],
        ),
        RevisionGoneError(
            f"Volume 'head' has revision {EXAMPLE_REVISION} now; fetch its metadata again",
            id="head",
            current_revision=EXAMPLE_REVISION,
        ),
        LimitError(
            "5000 bricks are asked for; this server sends at most 4096 in one answer",
            limit_name="max_batch_bricks",
            limit=4096,
            value=5000,
        ),
        InvalidInputError(
            "bricks.0.5: Field required", field="bricks.0.5", where="body", rule="missing"
        ),
        VolumeFormatError("head.zarr/zarr.json: not JSON; restore the file or ingest again"),
    ),
}


@router.post(
    "/volumes/{volume_id}/bricks",
    summary="Many stored bricks",
    response_class=Response,
    responses=_RESPONSES,
)
async def post_bricks(services: ServicesDep, volume_id: VolumeId, body: BatchBody) -> Response:
    """Bricks in the order asked for, streamed: the first is sent before the last is read.

    The format is that of brick streams, version 1. When the volume is replaced meanwhile, the
    bricks that are left are records with the error `revision-gone`.
    """
    limit = services.settings.max_batch_bricks
    if len(body.bricks) > limit:
        raise LimitError(
            f"{len(body.bricks)} bricks are asked for; this server sends at most {limit} in one "
            "answer",
            limit_name="max_batch_bricks",
            limit=limit,
            value=len(body.bricks),
        )
    loop = asyncio.get_running_loop()
    opening = services.readers.submit(_opened, services, volume_id, body)
    try:
        stream = await asyncio.wrap_future(opening, loop=loop)
    except asyncio.CancelledError:
        # The client left while the volume was opened: it must be given back all the same.
        opening.add_done_callback(_close)
        raise
    return BrickStreamResponse(stream)


def _close(opening: Future[BrickStream]) -> None:
    if not opening.cancelled() and opening.exception() is None:
        opening.result().close()


def _opened(services: Services, volume_id: str, body: BatchBody) -> BrickStream:
    """The stream, whose volume is borrowed until it is closed."""
    kind = Kind[body.kind.upper()]
    with ExitStack() as stack:
        lent = stack.enter_context(services.catalog.borrow(volume_id))
        require_revision(lent.volume, volume_id, body.revision)
        require_bricks(lent.volume, kind, np.array(body.bricks, np.int64).reshape(-1, 6))
        return BrickStream(lent, stack.pop_all().close, kind, list(body.bricks), services.readers)
    raise AssertionError("unreachable")
