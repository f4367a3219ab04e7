"""Sizes in bytes as people write them: 536870912, "512MiB", "2 GB"."""

from __future__ import annotations

import re
from typing import Final

from octobrick.codec.errors import InvalidInputError

_FACTORS: Final = {
    "": 1, "b": 1,
    "kb": 10**3, "mb": 10**6, "gb": 10**9, "tb": 10**12,
    "kib": 2**10, "mib": 2**20, "gib": 2**30, "tib": 2**40,
}  # fmt: skip


def parse_nbytes(size: int | str, name: str = "size") -> int:
    """Bytes of a size given as a number or as text with a unit.

    Raises:
        InvalidInputError: not such a size, or not positive.
    """
    if isinstance(size, str):
        match = re.fullmatch(r"\s*(\d{1,15}(?:\.\d{1,6})?)\s*([a-z]*)\s*", size.lower())
        if match and match.group(2) in _FACTORS:
            size = int(float(match.group(1)) * _FACTORS[match.group(2)])
    if isinstance(size, bool) or not isinstance(size, int) or size < 1:
        raise InvalidInputError(
            f"{name} {size!r} is no size; use bytes, or text such as '512MiB'", option=name
        )
    return size
