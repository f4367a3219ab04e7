"""One range of bytes of a body, as RFC 9110 (14.1.2) writes it."""

from __future__ import annotations

import re

# 18 digits: more than any body has, and turned into an integer without a thought.
_RANGE = re.compile(r"bytes=\s*([0-9]{0,18})-([0-9]{0,18})\s*", re.IGNORECASE)


def byte_range(header: str, nbytes: int) -> range | None:
    """The bytes that a Range header names; None where the whole body is the answer.

    That is without the header, and, as the RFC lets a server choose, for several ranges at once,
    one that lies outside, and anything malformed.
    """
    match = _RANGE.fullmatch(header)
    if match is None:
        return None
    first, last = match.groups()
    if first:
        wanted = range(int(first), min(int(last) + 1, nbytes) if last else nbytes)
    elif last:
        wanted = range(max(nbytes - int(last), 0), nbytes)
    else:
        return None
    return wanted or None
