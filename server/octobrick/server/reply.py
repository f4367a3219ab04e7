"""Answers as values, and what HTTP says of caches and encodings."""

from __future__ import annotations

from dataclasses import dataclass

from octobrick.server.errors import RevisionGoneError
from octobrick.store import Volume

Headers = dict[str, str]

IMMUTABLE = "public, max-age=31536000, immutable"  # a year: the longest that HTTP caches honour


@dataclass(frozen=True, slots=True)
class Reply:
    """An HTTP answer as a value."""

    status: int
    headers: Headers
    body: bytes


def require_revision(volume: Volume, volume_id: str, revision: str) -> None:
    """Refuse a revision that is not the volume's own.

    Raises:
        RevisionGoneError: with the revision that the volume has.
    """
    if revision != volume.revision:
        raise RevisionGoneError(
            f"Volume {volume_id!r} has revision {volume.revision} now; fetch its metadata again",
            id=volume_id,
            current_revision=volume.revision,
        )


def accepts_zstd(accept_encoding: str) -> bool:
    """Whether an Accept-Encoding header (RFC 9110, 12.5.3) names zstd, or everything, with q > 0.

    An absent header accepts anything by the letter; it gets plain bytes, because the programs
    that send none do not decode.
    """
    weights: dict[str, bool] = {}
    for item in accept_encoding.lower().split(","):
        coding, _, parameters = item.partition(";")
        weights[coding.strip()] = _weight(parameters) > 0
    return weights.get("zstd", weights.get("*", False))


def matches_etag(if_none_match: str, etag: str) -> bool:
    """Whether an If-None-Match header (RFC 9110, 13.1.2) names this entity tag."""
    names = (name.strip().removeprefix("W/") for name in if_none_match.split(","))
    return any(name in ("*", etag.removeprefix("W/")) for name in names)


def _weight(parameters: str) -> float:
    for parameter in parameters.split(";"):
        name, _, value = parameter.partition("=")
        if name.strip() == "q":
            try:
                return float(value)
            except ValueError:
                return 0.0  # not a weight: the client gets what everyone understands
    return 1.0
