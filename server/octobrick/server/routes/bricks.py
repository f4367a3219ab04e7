"""One brick: the documented route, behind the fast lane that answers well-formed requests."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Header, Path, Response

from octobrick.codec.errors import CorruptBrickError, InvalidInputError
from octobrick.server.brick_reply import BrickAddress, brick_reply
from octobrick.server.catalog import unknown_volume
from octobrick.server.errors import BrickNotFoundError, RevisionGoneError
from octobrick.server.routes.shared import EXAMPLE_REVISION, Revision, VolumeId, documented
from octobrick.server.services import ServicesDep

router = APIRouter(prefix="/v1", tags=["bricks"])

_HEADERS = {
    "ETag": "Strong; another one for each content encoding.",
    "X-Octobrick-Codec": "What the bytes are once the zstd layer is off.",
    "X-Octobrick-Dtype": "Type of a voxel; little-endian.",
    "X-Octobrick-Shape": "Voxels of the brick along z, y, x; bricks at the border are padded.",
    "X-Octobrick-Range": "Minimum and maximum of the brick's voxels and their neighbours.",
    "X-Octobrick-Max-Error": "Largest |decoded - original| in the brick.",
    "X-Octobrick-Rmse": "Root mean square of decoded - original in the brick.",
}
_DOCUMENTED_HEADERS = {
    name: {"description": text, "schema": {"type": "string"}} for name, text in _HEADERS.items()
}
_RESPONSES: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "The brick's bytes.",
        "headers": _DOCUMENTED_HEADERS,
        "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
    },
    204: {
        "description": "An absent brick: every voxel has the volume's fill value.",
        "headers": _DOCUMENTED_HEADERS,
    },
    304: {"description": "The client's copy is good."},
    **documented(
        unknown_volume("tail"),
        BrickNotFoundError("The volume has no level 9; it has 4, counted from 0", index=9, count=4),
        RevisionGoneError(
            f"Volume 'head' has revision {EXAMPLE_REVISION} now; fetch its metadata again",
            id="head",
            current_revision=EXAMPLE_REVISION,
        ),
        InvalidInputError(
            "level: Input should be a valid integer, unable to parse string as an integer",
            field="level",
            where="path",
            rule="int_parsing",
        ),
        CorruptBrickError("head.zarr/0/c/0/0/0/0/0: brick (0, 0, 0): checksum mismatch"),
    ),
}


def _index(description: str, example: int = 0) -> Any:
    return Path(description=description, ge=0, le=999_999_999, examples=[example])


@router.api_route(
    "/volumes/{volume_id}/{revision}/bricks/{level}/{t}/{c}/{z}/{y}/{x}",
    methods=["HEAD"],
    include_in_schema=False,
)
@router.get(
    "/volumes/{volume_id}/{revision}/bricks/{level}/{t}/{c}/{z}/{y}/{x}",
    summary="One stored brick",
    response_class=Response,
    responses=_RESPONSES,
)
def get_brick(
    services: ServicesDep,
    volume_id: VolumeId,
    revision: Revision,
    level: Annotated[int, _index("Level, 0 the finest.")],
    t: Annotated[int, _index("Time step.")],
    c: Annotated[int, _index("Channel.")],
    z: Annotated[int, _index("Brick along z.")],
    y: Annotated[int, _index("Brick along y.")],
    x: Annotated[int, _index("Brick along x.")],
    accept_encoding: Annotated[str, Header(include_in_schema=False)] = "",
    if_none_match: Annotated[str, Header(include_in_schema=False)] = "",
) -> Response:
    """A brick as it is stored, for ever under the same address.

    A client that accepts the content encoding `zstd` gets the stored frame untouched; any other
    gets the same bytes without it. Also answers HEAD.
    """
    address = BrickAddress(volume_id, revision, level, t, c, (z, y, x))
    reply = brick_reply(services.catalog, address, accept_encoding, if_none_match)
    return Response(reply.body, reply.status, reply.headers)
