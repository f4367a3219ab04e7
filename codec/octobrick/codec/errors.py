"""The error tree of octobrick, grouped by what the caller should do about it.

Every error has a stable ``kind`` (an append-only vocabulary, listed in docs/errors.md and pinned
by a test), a message that says what, where, both values and the next step, and the same facts as
fields in ``facts`` so that programs need not parse prose. No error knows of HTTP; the server maps
classes to status codes.
"""

from __future__ import annotations

from typing import ClassVar

Fact = str | int | float | bool | None | list[int] | list[float] | list[str]


class OctobrickError(Exception):
    """Base of every error that octobrick raises on purpose.

    Args:
        message: what happened, where, both values, and what to do next; one or two sentences.
        facts: the same facts as JSON-ready values, by name.
    """

    kind: ClassVar[str] = "error"

    def __init__(self, message: str, **facts: Fact) -> None:
        super().__init__(message)
        self.message = message
        self.facts: dict[str, Fact] = facts


class InvalidInputError(OctobrickError, ValueError):
    """What the caller passed cannot be used as it is: change it and call again."""

    kind = "invalid-input"


class NotFiniteError(InvalidInputError):
    """Floating-point data holds NaN or ±Inf: say what replaces them, or clean the data."""

    kind = "not-finite"


class UnsupportedError(OctobrickError):
    """The request is sound, but this version cannot do it: choose another way."""

    kind = "unsupported"


class CorruptDataError(OctobrickError):
    """Stored bytes are not what was written: fetch them again, repair or re-ingest."""

    kind = "corrupt-data"


class CorruptBrickError(CorruptDataError):
    """The bytes of one brick are not what ``encode`` makes; other bricks are unaffected."""

    kind = "corrupt-brick"


class NotFoundError(OctobrickError, LookupError):
    """The thing named does not exist: name another."""

    kind = "not-found"


class ConflictError(OctobrickError):
    """Something is in the way, such as an existing destination: remove it or say so."""

    kind = "conflict"


class ResourceError(OctobrickError):
    """The machine lacks something (space, memory, a driver, a package): provide it."""

    kind = "resource"
