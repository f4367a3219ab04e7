"""Parts of a view as text, as a query and a command line write them: numbers with commas.

Each function returns what the same field is in JSON, and refuses other text with an
`InvalidInputError` that names the field.
"""

from __future__ import annotations

import re
from typing import Any

from octobrick.codec.errors import InvalidInputError


def numbers(field: str, text: str, example: str) -> list[float]:
    """As many numbers as the example has, with commas between them."""
    count = example.count(",") + 1
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count:
        raise _refused(field, text, f"{count} numbers like {example}")
    return values


def corners(field: str, text: str) -> list[float | None]:
    """A box in world space, x0,y0,z0,x1,y1,z1; None for a side that is left empty."""
    try:
        ends = [float(part) if part.strip() else None for part in text.split(",")]
    except ValueError:
        ends = []
    if len(ends) != 6:
        raise _refused(
            field, text, "a box like 0,0,0,64,64,32 (x0,y0,z0,x1,y1,z1); a part may be empty"
        )
    return ends


def channels(field: str, text: str) -> int | list[int]:
    """A channel, or several with commas between them."""
    if not re.fullmatch(r"\d{1,9}(,\d{1,9})*", text, re.ASCII):
        raise _refused(field, text, "a channel like 0, or several like 0,2")
    parsed = [int(part) for part in text.split(",")]
    return parsed[0] if len(parsed) == 1 else parsed


def light(field: str, text: str) -> dict[str, Any]:
    """A light: a direction towards it, or ``eye``, perhaps with ``:`` and a colour, rrggbb."""
    found = re.fullmatch(r"(eye|[^:]+)(?::#?([0-9a-fA-F]{6}))?", text)
    if found is None:
        raise _refused(field, text, "a light like 1,-1,2 or 1,-1,2:ffcc88 or eye")
    toward = None if found[1] == "eye" else numbers(field, found[1], "1,-1,2")
    return {"toward_world_xyz": toward, "color": found[2] or "ffffff"}


def switch_or_number(field: str, text: str) -> bool | float:
    """``true``, ``false``, or a number."""
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    try:
        return float(text)
    except ValueError:
        raise _refused(field, text, "true, false, or a number like 4") from None


def _refused(field: str, text: str, wanted: str) -> InvalidInputError:
    return InvalidInputError(f"{field}: {text!r:.40} is not {wanted}", field=field)
