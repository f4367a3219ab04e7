"""Option values of several numbers: callbacks that turn their text into a tuple."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from octobrick.store.box import Box

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


def size(_context: click.Context, _parameter: click.Parameter, text: str) -> tuple[int, int]:
    """The callback for width and height of a picture, both positive, such as ``768x768``."""
    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal() and int(width) and int(height)):
        raise click.BadParameter(f"{text!r} is not a size like 768x768")
    return int(width), int(height)


def box(_context: click.Context, _parameter: click.Parameter, text: str | None) -> Box | None:
    """The callback for a box of voxels, as Python slices in the order z, y, x: ``0:64,:,8:72``.

    An end that is left out is the volume's; it is written as -1 and known when the source is.
    """
    from octobrick.store.box import Box

    if text is None:
        return None
    sides = [part.split(":") for part in text.split(",")]
    is_box = len(sides) == 3 and all(
        len(side) == 2 and all(not end or end.isdecimal() for end in side) for side in sides
    )
    if not is_box:
        raise click.BadParameter(f"{text!r} is not a box like 0:64,100:612,: (z, y, x)")
    (z0, z1), (y0, y1), (x0, x1) = ((int(a or 0), int(b or -1)) for a, b in sides)
    return Box((z0, y0, x0), (z1, y1, x1))
