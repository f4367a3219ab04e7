"""Every way to fail, in one JSON shape: ``{"error": {"kind", "message", "facts"}}``."""

from __future__ import annotations

import logging
from http import HTTPStatus

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.responses import JSONResponse

from octobrick.codec.errors import InvalidInputError, OctobrickError
from octobrick.server.errors import (
    InternalError,
    LimitError,
    MethodNotAllowedError,
    RouteNotFoundError,
    answer_to,
    public_view,
)

logger = logging.getLogger(__name__)

# Also for answers to HEAD, which have no body that could tell the kind.
ERROR_KIND_HEADER = b"x-octobrick-error"


def error_reply(error: OctobrickError, headers: dict[str, str] | None = None) -> JSONResponse:
    """The HTTP answer to an error; what is the server's own fault is also logged in full."""
    answer = answer_to(type(error))
    if answer.status >= 500:
        # What passes by itself, such as a full queue, is no reason to wake anybody.
        level = logging.ERROR if answer.retry_after_seconds is None else logging.WARNING
        logger.log(level, "%s: %s", error.kind, error.message)
    headers = {
        "cache-control": "no-store",
        ERROR_KIND_HEADER.decode(): error.kind,
        **(headers or {}),
    }
    if answer.status == HTTPStatus.UNAUTHORIZED:
        headers["www-authenticate"] = 'Bearer realm="octobrick"'
    if answer.retry_after_seconds is not None:
        headers["retry-after"] = str(answer.retry_after_seconds)
    return JSONResponse(public_view(error), answer.status, headers)


def internal_error_reply(error: Exception) -> JSONResponse:
    """The HTTP answer to an error that nobody foresaw: the traceback stays in the log."""
    logger.error("unexpected error", exc_info=error)
    return error_reply(InternalError("The server met an unexpected error; its log has the details"))


def handle_errors(app: FastAPI) -> None:
    """Have the app answer its own errors and those of its framework in our shape."""

    @app.exception_handler(OctobrickError)
    async def _octobrick(_request: Request, error: OctobrickError) -> JSONResponse:
        return error_reply(error)

    @app.exception_handler(RequestValidationError)
    async def _validation(_request: Request, error: RequestValidationError) -> JSONResponse:
        return error_reply(validation_error(error))

    @app.exception_handler(HTTPException)
    async def _http(request: Request, error: HTTPException) -> JSONResponse:
        return error_reply(_framework_error(request, error), dict(error.headers or {}))


def validation_error(error: RequestValidationError) -> InvalidInputError:
    """What pydantic found wrong first, with the field that it is about."""
    first = error.errors()[0]
    field = ".".join(str(part) for part in first["loc"][1:]) or str(first["loc"][0])
    cause = first.get("ctx", {}).get("error")
    if isinstance(cause, InvalidInputError):
        return cause
    return InvalidInputError(
        f"{field}: {first['msg']}", field=field, where=str(first["loc"][0]), rule=first["type"]
    )


def _framework_error(request: Request, error: HTTPException) -> OctobrickError:
    match error.status_code:
        case 404:
            return RouteNotFoundError("No route has this address; see the list of routes at docs")
        case 405:
            return MethodNotAllowedError(
                f"This route does not take {request.method}", method=request.method
            )
        case 413:
            return LimitError("The request is longer than this server accepts")
        case status if status < 500:
            return InvalidInputError(str(error.detail), status=status)
        case _:
            return InternalError("The server met an unexpected error; its log has the details")
