"""Option values of several numbers: callbacks that turn their text into a tuple."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import click

Ends = tuple[tuple[int | None, int | None], ...]  # first and last but one along z, y and x

Callback = Callable[[click.Context, click.Parameter, str | None], tuple[Any, ...] | None]


def numbers(kind: type[int] | type[float], example: str) -> Callback:
    """A callback for as many numbers as the example has, with commas between them."""
    count = example.count(",") + 1

    def parse(
        _context: click.Context, _parameter: click.Parameter, text: str | None
    ) -> tuple[Any, ...] | None:
        if text is None:
            return None
        try:
            values = tuple(kind(part) for part in text.split(","))
        except ValueError:
            values = ()
        if len(values) != count:
            what = "whole numbers" if kind is int else "numbers"
            raise click.BadParameter(f"{text!r} is not {count} {what} like {example}")
        return values

    return parse


def several(one: Callback) -> Callable[..., tuple[Any, ...]]:
    """A callback for an option that may be repeated, each of its values parsed by another."""

    def parse(
        context: click.Context, parameter: click.Parameter, texts: tuple[str, ...]
    ) -> tuple[Any, ...]:
        return tuple(one(context, parameter, text) for text in texts)

    return parse


def channels(
    _context: click.Context, _parameter: click.Parameter, text: str
) -> int | tuple[int, ...]:
    """The callback for a channel, or several with commas between them."""
    if not re.fullmatch(r"\d+(,\d+)*", text, re.ASCII):
        raise click.BadParameter(f"{text!r} is not a channel like 0, or several like 0,2")
    parsed = tuple(int(part) for part in text.split(","))
    return parsed[0] if len(parsed) == 1 else parsed


def corners(
    _context: click.Context, _parameter: click.Parameter, text: str | None
) -> tuple[float | None, ...] | None:
    """The callback for a box in world space, such as ``0,0,,64,64,``; None for an open side."""
    if text is None:
        return None
    try:
        ends = tuple(float(part) if part.strip() else None for part in text.split(","))
    except ValueError:
        ends = ()
    if len(ends) != 6:
        raise click.BadParameter(
            f"{text!r} is not a box like 0,0,0,64,64,32 (x0,y0,z0,x1,y1,z1); a part may be empty"
        )
    return ends


def light(_context: click.Context, _parameter: click.Parameter, text: str | None) -> Any:
    """The callback for a light: a direction towards it, or ``eye``, perhaps with a colour."""
    from octobrick.renderer import Light

    found = re.fullmatch(r"(eye|[^:]+)(?::#?([0-9a-fA-F]{6}))?", text or "")
    try:
        if found is None:
            raise ValueError
        toward = None if found[1] == "eye" else tuple(float(part) for part in found[1].split(","))
        if toward is not None and len(toward) != 3:
            raise ValueError
    except ValueError:
        raise click.BadParameter(
            f"{text!r} is not a light like 1,-1,2 or 1,-1,2:#ffcc88 or eye"
        ) from None
    color = found[2] or "ffffff"
    red, green, blue = (int(color[i : i + 2], 16) / 255 for i in (0, 2, 4))
    return Light(toward, (red, green, blue))


_UNITS = {"": 1, "kb": 10**3, "mb": 10**6, "gb": 10**9, "tb": 10**12}
_UNITS |= {"kib": 2**10, "mib": 2**20, "gib": 2**30, "tib": 2**40}


def nbytes(_context: click.Context, _parameter: click.Parameter, text: str | None) -> int | None:
    """The callback for an amount of memory, such as ``512MiB`` or ``2GB``."""
    if text is None:
        return None
    found = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([a-z]*)", text.strip().lower(), re.ASCII)
    if found is None or found[2] not in _UNITS:
        raise click.BadParameter(f"{text!r} is not an amount of memory like 512MiB or 2GB")
    return int(float(found[1]) * _UNITS[found[2]])


def size(_context: click.Context, _parameter: click.Parameter, text: str) -> tuple[int, int]:
    """The callback for width and height of a picture, both positive, such as ``768x768``."""
    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal() and int(width) and int(height)):
        raise click.BadParameter(f"{text!r} is not a size like 768x768")
    return int(width), int(height)


def ranges(_context: click.Context, _parameter: click.Parameter, text: str | None) -> Ends | None:
    """The callback for a box of voxels, such as ``0:64,:,128:``; None for ends that are open."""
    if text is None:
        return None
    found = re.fullmatch(r"(\d*):(\d*),(\d*):(\d*),(\d*):(\d*)", text.replace(" ", ""), re.ASCII)
    if found is None:
        raise click.BadParameter(f"{text!r} is not a box of voxels like 0:64,0:128,32:96 (z, y, x)")
    ends = [int(end) if end else None for end in found.groups()]
    return tuple(zip(ends[0::2], ends[1::2], strict=True))


def interval(
    _context: click.Context, _parameter: click.Parameter, text: str | None
) -> tuple[float, float] | None:
    """The callback for a range of values, such as ``-100:300`` or ``0.5:``, open ends infinite."""
    if text is None:
        return None
    low, colon, high = text.partition(":")
    try:
        if not colon:
            raise ValueError
        return float(low or -math.inf), float(high or math.inf)
    except ValueError:
        raise click.BadParameter(
            f"{text!r} is not a range of values like 100:300 or 0.5:"
        ) from None


def steps(
    _context: click.Context, _parameter: click.Parameter, text: str | None
) -> tuple[int, int | None, int] | None:
    """The callback for time steps, such as ``0:10`` or ``:``, or every other, ``0:10:2``."""
    if text is None:
        return None
    found = re.fullmatch(r"(\d*):(\d*)(?::(\d+))?", text.replace(" ", ""), re.ASCII)
    if found is None or found[3] == "0":
        raise click.BadParameter(f"{text!r} is not a range of time steps like 0:10 or 0:10:2")
    return int(found[1] or 0), int(found[2]) if found[2] else None, int(found[3] or 1)
