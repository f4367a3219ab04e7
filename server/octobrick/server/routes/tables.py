"""What a client needs to choose bricks by itself: all attributes, and tables per brick."""

from __future__ import annotations

import json
from typing import Annotated, Any

from fastapi import APIRouter, Header, Path, Response

from octobrick.codec.errors import InvalidInputError
from octobrick.server.bricks.tables import TableAddress, TableKind, table_reply
from octobrick.server.catalog import OpenVolume, unknown_volume
from octobrick.server.errors import BrickNotFoundError, RevisionGoneError
from octobrick.server.reply import IMMUTABLE, matches_etag, require_revision
from octobrick.server.routes.shared import EXAMPLE_REVISION, Revision, VolumeId, documented
from octobrick.server.services import ServicesDep
from octobrick.store.errors import VolumeFormatError

router = APIRouter(prefix="/v1", tags=["volumes"])

_GONE = RevisionGoneError(
    f"Volume 'head' has revision {EXAMPLE_REVISION} now; fetch its metadata again",
    id="head",
    current_revision=EXAMPLE_REVISION,
)
_BAD_INDEX = InvalidInputError(
    "level: Input should be a valid integer, unable to parse string as an integer",
    field="level",
    where="path",
    rule="int_parsing",
)
_EXAMPLE_LEVEL = {
    "shape": [108, 256, 256],
    "stored_nbytes": 3018402,
    "max_error": 117,
    "rmse": 4.1,
    "psnr_db": 47.2,
    "gradient_nbytes": 411204,
}
_EXAMPLE_ATTRIBUTES = {
    "version": 1,
    "revision": EXAMPLE_REVISION,
    "dtype": "int16",
    "brick": [64, 64, 64],
    "shard": [8, 8, 8],
    "codec": {
        "name": "octobrick.s3dc",
        "configuration": {"version": 1, "block": [8, 8, 8], "bits": 4},
    },
    "timepoints": 1,
    "channels": 1,
    "spacing": [1.5, 0.957, 0.957],
    "unit": "millimeter",
    "reducer": "mean",
    "levels": [_EXAMPLE_LEVEL],
    "value_range": [-1024, 3071],
    "window": [-1020, 1480],
    "histograms": [{"exponent": 0, "first": -1024, "counts": [812, 3, 5]}],
    "source": {
        "format": "metaimage",
        "file": "head.mhd",
        "shape_zyx": [108, 256, 256],
        "dtype": "int16",
        "timepoints": 1,
        "channels": 1,
        "channel_names": [],
        "channel_colors": [],
        "labels": False,
        "spacing_zyx": [1.5, 0.957, 0.957],
        "unit": "millimeter",
        "rescale": {"slope": 1.0, "intercept": -1024.0},
        "direction": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        "origin_xyz": [0.0, 0.0, 0.0],
    },
}
_NOT_MODIFIED = {"description": "The client's copy is good."}
_TABLE_HEADERS = {
    "ETag": "Strong; another one for each content encoding.",
    "X-Octobrick-Dtype": "Type of a value; little-endian.",
    "X-Octobrick-Shape": "nz,ny,nx,2: two values for each brick of the level.",
}


@router.get(
    "/volumes/{volume_id}/{revision}/attributes",
    summary="All attributes of a volume",
    response_class=Response,
    responses={
        200: {
            "description": "The attributes.",
            "content": {
                "application/json": {
                    "schema": {"type": "object", "examples": [_EXAMPLE_ATTRIBUTES]}
                }
            },
        },
        304: _NOT_MODIFIED,
        **documented(
            unknown_volume("tail"),
            _GONE,
            InvalidInputError("revision: String should have at most 128 characters"),
            VolumeFormatError("head.zarr/zarr.json: not JSON; restore the file or ingest again"),
        ),
    },
)
def get_attributes(
    services: ServicesDep,
    volume_id: VolumeId,
    revision: Revision,
    if_none_match: Annotated[str, Header(include_in_schema=False)] = "",
) -> Response:
    """What the volume's own metadata file says, word by word: codecs, levels, histograms, source.

    The format of volumes has the meaning of each field.
    """

    def text(lent: OpenVolume) -> str:
        require_revision(lent.volume, volume_id, revision)
        return json.dumps(lent.volume.attributes(), allow_nan=False)

    body = services.catalog.read(volume_id, text)
    headers = {"cache-control": IMMUTABLE, "etag": f'"{revision}-attributes"'}
    if if_none_match and matches_etag(if_none_match, headers["etag"]):
        return Response(status_code=304, headers=headers)
    return Response(body, headers=headers, media_type="application/json")


def _index(description: str) -> Any:
    return Path(description=description, ge=0, le=999_999_999, examples=[0])


@router.get(
    "/volumes/{volume_id}/{revision}/tables/{kind}/{level}/{t}/{c}",
    summary="A table of what is known per brick",
    response_class=Response,
    responses={
        200: {
            "description": "The table's values.",
            "headers": {
                name: {"description": text, "schema": {"type": "string"}}
                for name, text in _TABLE_HEADERS.items()
            },
            "content": {
                "application/octet-stream": {"schema": {"type": "string", "format": "binary"}}
            },
        },
        304: _NOT_MODIFIED,
        **documented(
            unknown_volume("tail"),
            BrickNotFoundError(
                "The volume has no level 9; it has 4, counted from 0", index=9, count=4
            ),
            _GONE,
            _BAD_INDEX,
            VolumeFormatError("head.zarr/range/0: cannot be read; restore the files"),
        ),
    },
)
def get_table(
    services: ServicesDep,
    volume_id: VolumeId,
    revision: Revision,
    kind: Annotated[
        TableKind,
        Path(
            description="`range`: minimum and maximum, in the volume's type. `fidelity`: largest "
            "error and root mean square, float32.",
            examples=["range"],
        ),
    ],
    level: Annotated[int, _index("Level, 0 the finest.")],
    t: Annotated[int, _index("Time step.")],
    c: Annotated[int, _index("Channel.")],
    accept_encoding: Annotated[str, Header(include_in_schema=False)] = "",
    if_none_match: Annotated[str, Header(include_in_schema=False)] = "",
) -> Response:
    """Two values for each brick of a level, in the order z, y, x, for ever under one address.

    A client that accepts the content encoding `zstd` gets one zstd frame with a checksum.
    """
    address = TableAddress(volume_id, revision, kind, level, t, c)
    reply = table_reply(services.catalog, services.tables, address, accept_encoding, if_none_match)
    return Response(reply.body, reply.status, reply.headers)
