"""Numbers and facts as text, as people read them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

_PEOPLE = {
    "shape_zyx": "shape (z, y, x)",
    "spacing_xyz": "spacing (x, y, z)",
    "spacing_zyx": "spacing (z, y, x)",
    "dtype": "sample type",
    "gl_renderer": "OpenGL device",
}
_TEXT_MAX = 300  # characters of a fact: a report is no dump
_DEPTH_MAX = 4


def decibels(value: float | None) -> str:
    """Two decimals; "∞" where nothing was lost."""
    return "∞" if value is None else f"{value:.2f}"


def digits(value: float, count: int = 3) -> str:
    """So many significant digits, without an exponent where that is readable; "–" for NaN."""
    if value == 0 or not math.isfinite(value):
        return "–" if math.isnan(value) else f"{value:g}"
    if 1e-4 <= abs(value) < 10**7:
        return f"{value:.{max(0, count - 1 - math.floor(math.log10(abs(value))))}f}"
    return f"{value:.{count}g}"


def per_second(value: float) -> str:
    """Voxels per second, in millions."""
    return digits(value / 1e6)


def milliseconds(seconds: float) -> str:
    """Seconds in ms."""
    return digits(1e3 * seconds)


def percent(share: float) -> str:
    """A share of one, without a place to break a line; what is there at all is not called 0."""
    return "<\u00a00.1\u00a0%" if 0 < share < 0.001 else f"{100 * share:.1f}\u00a0%"


def facts(values: Mapping[str, Any], prefix: str = "", depth: int = 0) -> Iterator[tuple[str, str]]:
    """Names and values for people; those of mappings inside, too, with both names."""
    for key, value in values.items():
        name = _PEOPLE.get(str(key), str(key).replace("_", " "))
        label = f"{prefix}, {name}" if prefix else name
        if isinstance(value, Mapping) and depth < _DEPTH_MAX:
            yield from facts(value, label, depth + 1)
        elif value is not None and not is_table(value):
            yield label, fact_text(value, "×" if str(key).startswith("shape") else ", ")


def is_table(value: Any) -> bool:
    """Whether a value is a list of mappings that all have the same keys."""
    if not isinstance(value, Sequence) or isinstance(value, (str, bytes)) or not value:
        return False
    return all(isinstance(row, Mapping) and row.keys() == value[0].keys() for row in value)


def tables(values: Mapping[str, Any]) -> Iterator[tuple[str, list[str], list[list[str]]]]:
    """Names, heads and rows of those values that are tables."""
    for key, value in values.items():
        if is_table(value):
            heads = [str(name).replace("_", " ") for name in value[0]]
            rows = [[fact_text(one) for one in row.values()] for row in value]
            yield str(key).replace("_", " "), heads, rows


def fact_text(value: Any, between: str = ", ") -> str:
    """One fact: numbers with few digits, lists with something between, text cut where long."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Mapping):
        return "; ".join(f"{key} {fact_text(one)}" for key, one in value.items())[:_TEXT_MAX]
    if isinstance(value, Sequence) and not isinstance(value, (str, bytes)):
        inner = "; " if any(isinstance(one, (Mapping, list, tuple)) for one in value) else between
        return inner.join(fact_text(one) for one in value)[:_TEXT_MAX]
    return str(value)[:_TEXT_MAX]
