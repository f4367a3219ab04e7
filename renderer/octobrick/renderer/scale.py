"""Round numbers for people: lengths of a scale bar, values along an axis, units in words."""

from __future__ import annotations

import math
from typing import Final

SIDE_MIN: Final = 128
"""Pixels: below it a bar and its label are no longer readable."""

_METRES: Final = {
    "picometer": 1e-12,
    "nanometer": 1e-9,
    "micrometer": 1e-6,
    "millimeter": 1e-3,
    "centimeter": 1e-2,
    "meter": 1.0,
    "kilometer": 1e3,
}
_PREFIXED: Final = (
    ("km", 1e3),
    ("m", 1.0),
    ("mm", 1e-3),
    ("um", 1e-6),
    ("nm", 1e-9),
    ("pm", 1e-12),
)
"""Largest first. `um`, since the letters of pictures are ASCII."""


def round_length(at_most: float) -> float:
    """The largest 1, 2 or 5 times a power of ten that is no longer than a length."""
    power = 10.0 ** math.floor(math.log10(at_most))
    factor = max(factor for factor in (1, 2, 5) if factor == 1 or factor * power <= at_most)
    return factor * power


def round_ticks(low: float, high: float) -> list[float]:
    """Three to eight multiples of a round number, strictly between two values."""
    step = round_length((high - low) / 3)
    first = math.floor(low / step) + 1
    ticks = [index * step for index in range(first, first + 10)]
    return [tick for tick in ticks if low < tick < high]


def format_length(length: float, unit: str | None) -> str:
    """A length as people write it, such as ``50 mm``; metres in the prefix that suits it.

    Args:
        length: in units, positive.
        unit: by its UDUNITS name; None where unknown.
    """
    metres = _METRES.get(unit or "")
    if metres is None:
        return f"{length:g} {unit or 'world units'}"
    size = length * metres
    name, scale = next(
        (prefixed for prefixed in _PREFIXED if size >= prefixed[1] * (1 - 1e-9)), _PREFIXED[-1]
    )
    return f"{size / scale:g} {name}"
