"""A name for each request: the client's own where it is sane, in every log line and answer."""

from __future__ import annotations

import itertools
import re
import secrets
from contextvars import ContextVar

# A context variable has to be a module's own. It holds the request of the running task alone.
current_request_id: ContextVar[str] = ContextVar("octobrick_request_id", default="")

# Goes into logs and headers as it is, so nothing that could break a line or a quote.
_SANE = re.compile(rb"[A-Za-z0-9._-]{1,64}")


class RequestIds:
    """Gives ids that are unique among processes: one random start, then a count."""

    def __init__(self) -> None:
        self._start = secrets.token_hex(6)
        self._count = itertools.count(1)

    def choose(self, sent: bytes | None) -> str:
        """The id that the client sent in ``X-Request-Id`` if it is sane, else a new one."""
        if sent is not None and _SANE.fullmatch(sent):
            return sent.decode("ascii")
        return f"{self._start}-{next(self._count):x}"
