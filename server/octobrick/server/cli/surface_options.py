"""Options of the surface of a solid texture, shared by ingest and render."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from octobrick.server.cli.values import numbers

if TYPE_CHECKING:
    from octobrick.store import Placement

_Command = TypeVar("_Command", bound=Callable[..., Any])

_TWELVE = numbers(float, "1,0,0,0,0,1,0,0,0,0,1,0")


def _placement(
    context: click.Context, parameter: click.Parameter, text: str | None
) -> Placement | None:
    values = _TWELVE(context, parameter, text)
    if values is None:
        return None
    from octobrick.store import Placement

    return Placement.of_numbers(values)


def surface_options(what: str) -> Callable[[_Command], _Command]:
    """Give a command the options ``surface``, ``surface_placement`` and ``surface_up``.

    Args:
        what: a sentence that says what the command does with a surface.
    """
    options = (
        click.option("--surface", type=click.Path(path_type=Path), metavar="MESH", help=what),
        click.option(
            "--surface-placement",
            metavar="M00,…,M23",
            callback=_placement,
            help="Where it lies: world = M · (x, y, z, 1), twelve numbers, row by row.  [default: "
            "fitted into the volume]",
        ),
        click.option(
            "--surface-up",
            type=click.Choice(["x", "y", "z"]),
            default="z",
            show_default=True,
            help="Its axis that becomes the world's z where it is fitted.",
        ),
    )

    def add(command: _Command) -> _Command:
        for option in reversed(options):
            command = option(command)
        return command

    return add
