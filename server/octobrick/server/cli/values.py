"""Option values of several numbers: callbacks that turn their text into a tuple."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

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
