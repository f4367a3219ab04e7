"""One line for each request: who asked for what, and what became of it."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Literal
from urllib.parse import unquote

from octobrick.server.operations.route_label import BRICKS, GRADIENTS
from octobrick.server.security.signed_paths import without_signature

AccessPolicy = Literal["none", "errors", "routes", "all"]

_PATH_LENGTH = 256  # characters of a path that a line shows
_FIRST_ERROR_STATUS = 400
# What comes so often that its lines would hide all others.
_FREQUENT = frozenset({BRICKS, GRADIENTS, "healthz", "readyz", "metrics"})


@dataclass(frozen=True, slots=True)
class Passed:
    """A request that was answered, or given up by its client.

    Args:
        status: 0 where nothing was answered.
        nbytes: body bytes handed to the connection.
        seconds: from the request's headers to the last byte handed over.
        error_kind: of the error that was answered; empty where there was none.
        cut: the answer broke off after its first byte.
    """

    client: str
    method: str
    raw_path: bytes
    route: str
    status: int
    nbytes: int
    seconds: float
    error_kind: str
    cut: bool


class AccessLog:
    """Writes the lines that the policy wants to the logger ``octobrick.access``.

    Args:
        policy: ``all``; ``routes``, that is all but single bricks, probes and metrics that were
            served well; ``errors``, answers from 400 on and those that broke off; or ``none``.
    """

    def __init__(self, policy: AccessPolicy) -> None:
        self._policy = policy
        self._logger = logging.getLogger("octobrick.access")

    def wants(self, route: str, status: int, cut: bool) -> bool:
        """Whether a request gets a line."""
        if self._policy == "none":
            return False
        if self._policy == "all" or cut or not 0 < status < _FIRST_ERROR_STATUS:
            return True
        return self._policy == "routes" and route not in _FREQUENT

    def write(self, passed: Passed) -> None:
        """Write the line of a request. The query is not shown, nor is a signature."""
        path = shown_path(passed.raw_path)
        fields: dict[str, object] = {
            "client": passed.client,
            "method": passed.method,
            "path": path,
            "route": passed.route,
            "status": passed.status,
            "nbytes": passed.nbytes,
            "seconds": round(passed.seconds, 6),
        }
        if passed.error_kind:
            fields["error_kind"] = passed.error_kind
        if passed.cut:
            fields["cut"] = True
        self._logger.info("%s %s", passed.method, path, extra={"fields": fields})


def shown_path(raw_path: bytes) -> str:
    """A path, decoded, but short, printable and without its secret, however that is spelled."""
    text = unquote(raw_path[: 2 * _PATH_LENGTH].decode("ascii", "backslashreplace"))
    text = without_signature(text)[:_PATH_LENGTH]
    return text if text.isprintable() else text.encode("unicode_escape").decode("ascii")
