"""What several routes declare alike: path parameters and documented errors."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import Path
from pydantic import BaseModel

from octobrick.codec.errors import InvalidInputError, OctobrickError
from octobrick.server.errors import (
    AddressTooLongError,
    ForbiddenError,
    HeadersTooLongError,
    UnauthorizedError,
    answer_to,
    public_view,
)

EXAMPLE_ID = "head"
EXAMPLE_REVISION = "0f3c1a9be2d84f6c9f27a1b0c5d6e7f8"

VolumeId = Annotated[
    str, Path(description="Name of the volume in the list of volumes.", examples=[EXAMPLE_ID])
]
Revision = Annotated[
    str,
    Path(
        description="Revision of the volume, from its metadata.",
        max_length=128,
        examples=[EXAMPLE_REVISION],
    ),
]

# What the layers before every route may answer.
_EVERYWHERE = (
    InvalidInputError(
        "The path holds an encoded slash, backslash, percent sign or NUL; no address here does"
    ),
    UnauthorizedError(
        "This server wants a token: send it as 'Authorization: Bearer TOKEN'",
    ),
    ForbiddenError("The token does not give this volume", id=EXAMPLE_ID),
    AddressTooLongError(
        "The address has 9000 bytes; this server accepts 8192",
        limit_name="max_target_nbytes",
        limit=8192,
        value=9000,
    ),
    HeadersTooLongError(
        "The request has 120 headers; this server accepts 100",
        limit_name="max_header_count",
        limit=100,
        value=120,
    ),
)


class ErrorBody(BaseModel):
    """What went wrong, for programs (`kind`, `facts`) and for people (`message`)."""

    kind: str
    message: str
    facts: dict[str, Any]


class ErrorReply(BaseModel):
    """The one shape of every error."""

    error: ErrorBody


def documented(*errors: OctobrickError) -> dict[int | str, dict[str, Any]]:
    """OpenAPI responses for errors, each with the answer that it would give as its example."""
    responses: dict[int | str, dict[str, Any]] = {}
    for error in (*_EVERYWHERE, *errors):
        response = responses.setdefault(
            answer_to(type(error)).status,
            {"model": ErrorReply, "content": {"application/json": {"examples": {}}}},
        )
        response["content"]["application/json"]["examples"][error.kind] = {
            "value": public_view(error)
        }
        response["description"] = ", ".join(response["content"]["application/json"]["examples"])
    return responses
