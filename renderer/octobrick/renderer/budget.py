"""Memory budgets: sizes as people write them, 536870912, "512MiB", "2 GB", and their parts."""

from __future__ import annotations

import re
from typing import Final

from octobrick.codec.errors import InvalidInputError

_FACTORS: Final = {
    "": 1, "b": 1,
    "kb": 10**3, "mb": 10**6, "gb": 10**9, "tb": 10**12,
    "kib": 2**10, "mib": 2**20, "gib": 2**30, "tib": 2**40,
}  # fmt: skip

SLAB_SHARE: Final = 4
"""The slab buffers take one part in so many of the memory budget, compressed bricks the rest."""


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


def split_budget(memory: int | str, slab: int | str | None) -> tuple[int, int]:
    """Bytes for compressed bricks and for the slab buffer, of a memory budget.

    Args:
        memory: for both.
        slab: the slab buffer's part; None is one in `SLAB_SHARE`.

    Raises:
        InvalidInputError: no sizes, or nothing is left for bricks.
    """
    total = parse_nbytes(memory, "memory_budget")
    slab_nbytes = total // SLAB_SHARE if slab is None else parse_nbytes(slab, "slab_budget")
    if slab_nbytes >= total:
        raise InvalidInputError(
            f"slab_budget {slab_nbytes} leaves nothing of memory_budget {total} for compressed "
            "bricks; raise the one or lower the other"
        )
    return total - slab_nbytes, slab_nbytes
