"""Errors of the service, and the one table that maps error classes to HTTP answers.

Nothing below the server knows of HTTP; nothing above this table decides on a status. What leaves
the server as text is decided here too, by :func:`public_view`: an error's message is written for
the person at the machine and often names a file, which is nobody's business on the network.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from octobrick.codec.errors import (
    ConflictError,
    CorruptDataError,
    Fact,
    InvalidInputError,
    NotFoundError,
    OctobrickError,
    ResourceError,
    UnsupportedError,
)
from octobrick.renderer.errors import PictureTooLargeError
from octobrick.store.errors import RevisionGoneError as RevisionGoneError


class RouteNotFoundError(NotFoundError):
    """No route has this address: see the list of routes at /docs."""

    kind = "route-not-found"


class BrickNotFoundError(NotFoundError):
    """The volume has no such level, time step, channel or brick: its metadata says what it has."""

    kind = "brick-not-found"


class MethodNotAllowedError(InvalidInputError):
    """The route exists, but not for this HTTP method."""

    kind = "method-not-allowed"


class LimitError(InvalidInputError):
    """The request is over a limit of this server: ask for less, or raise the setting."""

    kind = "too-large"


class AddressTooLongError(LimitError):
    """The path and query of the request are longer than this server accepts."""

    kind = "address-too-long"


class HeadersTooLongError(LimitError):
    """The headers of the request are more, or longer, than this server accepts."""

    kind = "headers-too-long"


class UnauthorizedError(InvalidInputError):
    """The request has no token, or one that is not known or has expired."""

    kind = "unauthorized"


class ForbiddenError(InvalidInputError):
    """The caller is known, but this is not for them; or a signed address is not good (any more)."""

    kind = "forbidden"


class NotReadyError(ResourceError):
    """The server cannot serve now: it is starting, stopping, or its volumes cannot be listed."""

    kind = "not-ready"


class BusyError(ResourceError):
    """All places in the queue are taken: try again later."""

    kind = "busy"


class RenderTimeoutError(ResourceError):
    """The picture was not ready in time: ask for less, or try again later."""

    kind = "render-timeout"


class RenderCrashedError(ResourceError):
    """The process that rendered the picture ended: ask for less, or try again later."""

    kind = "render-crashed"


class RenderingOffError(UnsupportedError):
    """This server renders nothing, as it is set up: ask another one."""

    kind = "rendering-off"


class VolumeReplacedError(ResourceError):
    """The volume was replaced while it was used: ask again for the new one."""

    kind = "volume-replaced"


class ClientGoneError(Exception):
    """The client left before it was answered: there is nobody to tell, so it has no kind."""


class InternalError(OctobrickError):
    """A fault in octobrick itself: the server's log holds the details."""

    kind = "internal"


@dataclass(frozen=True, slots=True)
class HttpAnswer:
    """What one class of errors becomes on the network.

    Args:
        status: HTTP status code.
        sentence: stands in for a message that must not leave the machine.
        retry_after_seconds: worth asking the same again after this long; None if it is not.
    """

    status: int
    sentence: str
    retry_after_seconds: int | None = None


# An error is answered as its nearest base class in this table.
ANSWERS: dict[type[OctobrickError], HttpAnswer] = {
    OctobrickError: HttpAnswer(500, "The server met an error; its log says which."),
    InvalidInputError: HttpAnswer(422, "The request cannot be used as it is."),
    MethodNotAllowedError: HttpAnswer(405, "The route does not take this method."),
    LimitError: HttpAnswer(413, "The request is over a limit of this server."),
    AddressTooLongError: HttpAnswer(414, "The address is longer than this server accepts."),
    HeadersTooLongError: HttpAnswer(431, "The headers are longer than this server accepts."),
    UnauthorizedError: HttpAnswer(401, "This server wants a token."),
    ForbiddenError: HttpAnswer(403, "The caller may not see this."),
    NotFoundError: HttpAnswer(404, "There is nothing of that name here."),
    RevisionGoneError: HttpAnswer(410, "This revision of the volume is no longer here."),
    UnsupportedError: HttpAnswer(501, "The request is sound, but this version cannot do it."),
    ConflictError: HttpAnswer(409, "Something is in the way of the request."),
    CorruptDataError: HttpAnswer(
        500, "Stored data is damaged; everything else is still served. The server's log says where."
    ),
    ResourceError: HttpAnswer(
        503, "The server lacks something that it needs for this; its log says what.", 30
    ),
    PictureTooLargeError: HttpAnswer(413, "The picture does not fit the renderer's memory."),
    NotReadyError: HttpAnswer(503, "The server cannot serve now.", 5),
    BusyError: HttpAnswer(503, "The server is busy.", 2),
    RenderTimeoutError: HttpAnswer(503, "The picture was not ready in time.", 5),
    RenderCrashedError: HttpAnswer(503, "The process that rendered the picture ended.", 2),
    VolumeReplacedError: HttpAnswer(503, "The volume was replaced while it was used.", 1),
}


def answer_to(error: type[OctobrickError]) -> HttpAnswer:
    """The HTTP answer of the nearest base class that has one."""
    return next(ANSWERS[base] for base in error.__mro__ if base in ANSWERS)


def public_view(error: OctobrickError) -> dict[str, Any]:
    """An error as JSON for the network: kind, message and facts, without names of files.

    A message or textual fact that holds a slash may be, or contain, a path on this machine. Such
    a fact is left out; such a message gives way to the sentence of its class. The rule errs on
    the side of silence, so the server's own messages are written without slashes.
    """
    message = error.message
    if _may_name_a_file(message):
        message = answer_to(type(error)).sentence
    facts = {name: fact for name, fact in error.facts.items() if not _may_name_a_file(fact)}
    return {"error": {"kind": error.kind, "message": message, "facts": facts}}


def _may_name_a_file(fact: Fact) -> bool:
    if isinstance(fact, list):
        return any(_may_name_a_file(item) for item in fact)
    return isinstance(fact, str) and ("/" in fact or "\\" in fact)
