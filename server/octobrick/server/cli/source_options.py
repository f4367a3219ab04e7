"""Options that say what a source is, shared by the commands that read one."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import click

from octobrick.server.cli.values import numbers

if TYPE_CHECKING:
    from octobrick.store.sources import Source

_Command = TypeVar("_Command", bound=Callable[..., Any])

_OPTIONS = (
    click.option("--dataset", help="Which volume of a file that holds several."),
    click.option("--axes", help="Axes of an array that does not name them, such as tzyx or zyxs."),
    click.option(
        "--shape",
        metavar="Z,Y,X",
        callback=numbers(int, "64,512,512"),
        help="Voxels of a raw file.",
    ),
    click.option("--dtype", help="Sample type of a raw file, such as uint16."),
    click.option(
        "--spacing",
        metavar="Z,Y,X",
        callback=numbers(float, "1.5,0.9,0.9"),
        help="Voxel size, where the file does not say it.",
    ),
    click.option(
        "--offset",
        type=int,
        default=0,
        show_default=True,
        help="Bytes before a raw file's voxels.",
    ),
    click.option("--big-endian", is_flag=True, help="Byte order of a raw file."),
)


def source_options(command: _Command) -> _Command:
    """Give a command the options that `open_given` takes."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def open_given(source: str, given: dict[str, Any]) -> Source:
    """The source that a command line names; close it.

    Args:
        source: file, folder or pattern.
        given: the values of `source_options`, among others.
    """
    from octobrick.store.sources import open_source

    return open_source(
        source,
        shape_zyx=given["shape"],
        dtype=given["dtype"],
        spacing_zyx=given["spacing"],
        offset_nbytes=given["offset"],
        big_endian=given["big_endian"],
        dataset=given["dataset"],
        axes=given["axes"],
    )
