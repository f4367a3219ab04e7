"""What a server says went wrong, as our errors: bounded, printable, never trusted further."""

from __future__ import annotations

import json
import re
from typing import Any, Final

from octobrick.codec.errors import (
    ConflictError,
    CorruptBrickError,
    CorruptDataError,
    InvalidInputError,
    NotFoundError,
    OctobrickError,
    ResourceError,
    UnsupportedError,
)
from octobrick.store.errors import (
    IncompleteVolumeError,
    RevisionGoneError,
    ServerUnreachableError,
    VolumeFormatError,
    VolumeNotFoundError,
)

BODY_NBYTES_MAX: Final = 65_536
"""An error takes no more, as in brick streams."""
_MESSAGE_MAX = 500
_KIND = re.compile(r"[a-z][a-z0-9-]{0,63}")
_CLASSES: dict[str, type[OctobrickError]] = {
    cls.kind: cls
    for cls in (
        CorruptBrickError,
        CorruptDataError,
        IncompleteVolumeError,
        InvalidInputError,
        RevisionGoneError,
        VolumeFormatError,
        VolumeNotFoundError,
    )
}
_BY_STATUS: dict[int, type[OctobrickError]] = {
    404: NotFoundError,
    409: ConflictError,
    410: NotFoundError,
    429: ResourceError,
    501: UnsupportedError,
    502: ResourceError,
    503: ResourceError,
    504: ResourceError,
}


def error_of_answer(status: int, body: bytes, where: str) -> OctobrickError:
    """The error of an HTTP answer, with the server's kind and message where it has them."""
    fields = _parsed(body)
    if fields is not None:
        return error_of_fields(fields, where, status)
    if status in (401, 403):
        return ServerUnreachableError(
            f"{where}: the server refuses (status {status}); give a token that is right, by "
            "OCTOBRICK_TOKEN or an argument",
            status=status,
        )
    if 300 <= status < 400:
        return ServerUnreachableError(
            f"{where}: the server sends elsewhere (status {status}), where neither a token nor "
            "trust goes along; give the address that it leads to",
            status=status,
        )
    return ServerUnreachableError(
        f"{where}: the server answers with status {status} and not as an octobrick server does; "
        "check the address, and whether the server is up",
        status=status,
    )


def error_of_fields(fields: Any, where: str, status: int = 500) -> OctobrickError:
    """The error of ``kind``, ``message`` and ``facts``, as JSON has them."""
    kind = fields.get("kind") if isinstance(fields, dict) else None
    message = fields.get("message") if isinstance(fields, dict) else None
    if not isinstance(kind, str) or not _KIND.fullmatch(kind) or not isinstance(message, str):
        return ServerUnreachableError(
            f"{where}: the server answers with an error that says nothing (status {status}); "
            "check whether this is an octobrick server",
            status=status,
        )
    text = "".join(ch if ch.isprintable() else " " for ch in message[:_MESSAGE_MAX])
    if kind == RevisionGoneError.kind:
        return RevisionGoneError(
            f"{where}: the volume was replaced since it was opened; open it anew", status=status
        )
    facts = _small(fields.get("facts"))
    usual = InvalidInputError if 400 <= status < 500 else OctobrickError
    cls = _CLASSES.get(kind) or _BY_STATUS.get(status, usual)
    error = cls(f"{where}: {text}", **facts | {"status": status})
    vars(error)["kind"] = kind  # of a server that may know more kinds than we do
    return error


def _parsed(body: bytes) -> Any:
    try:
        document = json.loads(body)
        return document["error"]
    except (ValueError, TypeError, LookupError, RecursionError):
        return None


def _small(facts: Any) -> dict[str, Any]:
    if not isinstance(facts, dict):
        return {}
    return {
        name: fact
        for name, fact in list(facts.items())[:16]
        if re.fullmatch("[a-z_]{1,40}", name)
        and name != "message"
        and (fact is None or isinstance(fact, (bool, int, float, str)))
        and (not isinstance(fact, str) or (len(fact) <= 200 and fact.isprintable()))
    }
