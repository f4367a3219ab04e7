"""One brick: the documented routes, behind the fast lane that answers well-formed requests."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

from fastapi import APIRouter, Depends, Header, Path, Response

from octobrick.codec.errors import CorruptBrickError, InvalidInputError
from octobrick.server.bricks.brick_reply import BrickAddress, BrickKind, BrickReply
from octobrick.server.catalog import unknown_volume
from octobrick.server.errors import BrickNotFoundError, RevisionGoneError
from octobrick.server.routes.shared import EXAMPLE_REVISION, Revision, VolumeId, documented
from octobrick.server.services import Services, ServicesDep

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
}
_ERRORS = (
    unknown_volume("tail"),
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
)
_NO_LEVEL = BrickNotFoundError(
    "The volume has no level 9; it has 4, counted from 0", index=9, count=4
)
_NO_GRADIENTS = BrickNotFoundError(
    "Level 0 stores no gradients; levels [1, 2, 3] do", level=0, levels=[1, 2, 3]
)
_BRICK = "/volumes/{volume_id}/{revision}/bricks/{level}/{t}/{c}/{z}/{y}/{x}"
_GRADIENTS = "/volumes/{volume_id}/{revision}/gradients/{level}/{t}/{c}/{z}/{y}/{x}"


def _index(description: str, example: int = 0) -> Any:
    return Path(description=description, ge=0, le=999_999_999, examples=[example])


class _Asked(NamedTuple):
    """All that the two routes have in common."""

    services: Services
    where: tuple[str, str, int, int, int, tuple[int, int, int]]
    accept_encoding: str
    if_none_match: str

    def response(self, kind: BrickKind) -> Response:
        """The answer, as the lane gives it."""
        address = BrickAddress(*self.where, kind)
        reply = self.services.bricks.reply(address, self.accept_encoding, self.if_none_match)
        return _response(reply)


def _asked(
    services: ServicesDep,
    volume_id: VolumeId,
    revision: Revision,
    level: Annotated[int, _index("Level, 0 the finest.", 1)],
    t: Annotated[int, _index("Time step.")],
    c: Annotated[int, _index("Channel.")],
    z: Annotated[int, _index("Brick along z.")],
    y: Annotated[int, _index("Brick along y.")],
    x: Annotated[int, _index("Brick along x.")],
    accept_encoding: Annotated[str, Header(include_in_schema=False)] = "",
    if_none_match: Annotated[str, Header(include_in_schema=False)] = "",
) -> _Asked:
    where = (volume_id, revision, level, t, c, (z, y, x))
    return _Asked(services, where, accept_encoding, if_none_match)


_AskedDep = Annotated[_Asked, Depends(_asked)]


@router.api_route(_BRICK, methods=["HEAD"], include_in_schema=False)
@router.get(
    _BRICK,
    summary="One stored brick",
    response_class=Response,
    responses=_RESPONSES | documented(*_ERRORS, _NO_LEVEL),
)
def get_brick(asked: _AskedDep) -> Response:
    """A brick as it is stored, for ever under the same address.

    A client that accepts the content encoding `zstd` gets the stored frame untouched; any other
    gets the same bytes without it. Also answers HEAD.
    """
    return asked.response("voxels")


@router.api_route(_GRADIENTS, methods=["HEAD"], include_in_schema=False)
@router.get(
    _GRADIENTS,
    summary="One stored brick of gradients' directions",
    response_class=Response,
    responses=_RESPONSES | documented(*_ERRORS, _NO_GRADIENTS),
)
def get_gradients(asked: _AskedDep) -> Response:
    """The directions of the gradients in a brick, three bytes a voxel, as they are stored.

    As bricks of voxels are, but for the levels that store gradients only, and without the headers
    of range and error. 204: no voxel of the brick has a direction.
    """
    return asked.response("gradients")


def _response(reply: BrickReply) -> Response:
    response = Response(bytes(reply.body), reply.status)
    response.raw_headers = reply.headers
    return response
