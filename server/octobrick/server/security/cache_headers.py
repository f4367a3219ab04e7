"""What caches may do with answers that not everybody may see."""

from __future__ import annotations

import re

_MAX_AGE = re.compile(rb"max-age=([0-9]+)")


def keep_private(cache_control: bytes) -> bytes:
    """The Cache-Control of an answer to a token: only the client's own cache may keep it.

    A shared cache would give it to the next caller, whose token it has not seen.
    """
    return cache_control.replace(b"public", b"private")


def keep_until(cache_control: bytes, seconds_left: int) -> bytes:
    """The Cache-Control of an answer to a signed address: no cache keeps it beyond its expiry.

    Shared caches may keep it: they find it only by the whole address, and that is the secret.
    """

    def shorter(match: re.Match[bytes]) -> bytes:
        return b"max-age=%d" % min(int(match[1]), max(seconds_left, 0))

    return _MAX_AGE.sub(shorter, cache_control)
