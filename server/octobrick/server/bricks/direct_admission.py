"""What the layers before the application let pass, add and count, for requests that skip them."""

from __future__ import annotations

from functools import lru_cache

from starlette.types import Scope

from octobrick.server.bricks.brick_headers import header_lines
from octobrick.server.operations.request_id import RequestIds
from octobrick.server.operations.route_label import route_label
from octobrick.server.security.security_headers import DEFAULT_POLICY, security_headers
from octobrick.server.services import Services

_route_label = lru_cache(4_096)(route_label)  # paths of bricks, some hundred bytes long


class DirectAdmission:
    """Lets the plainest requests pass, as `Gate` and `FrontDoor` would; leaves the others to them.

    Nobody passes here where tokens or signatures are asked for, or every request is logged.

    Args:
        services: of the server.
    """

    def __init__(self, services: Services) -> None:
        settings = services.settings
        self._services = services
        self._ids = RequestIds()
        self._max_target_nbytes = settings.max_target_nbytes
        self._max_header_count = settings.max_header_count
        self._logs_all = settings.access_log == "all"
        headers = security_headers(other_origins=bool(settings.cors_origins))
        self._lines = header_lines([DEFAULT_POLICY, *headers]) + b"x-request-id: "

    def admit(self, scope: Scope) -> bytes | None:
        """The lines of headers that the answer gets; None where the layers have to see it."""
        if self._services.guard is not None or self._logs_all:
            return None
        if len(scope["headers"]) > self._max_header_count:
            return None
        if len(scope["raw_path"]) + len(scope["query_string"]) > self._max_target_nbytes:
            return None
        return self._lines + self._ids.choose(None).encode() + b"\r\n"

    def note(self, scope: Scope, status: int, nbytes: int, seconds: float) -> None:
        """Count an answer."""
        route = _route_label(scope["path"])
        self._services.metrics.count_request(route, scope["method"], status, nbytes, seconds)
