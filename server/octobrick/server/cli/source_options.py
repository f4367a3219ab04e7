"""Options that say what a source is, shared by the commands that read one."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import click

from octobrick.server.cli.values import numbers

if TYPE_CHECKING:
    from octobrick.store import CameraStep
    from octobrick.store.sources import Source

_Command = TypeVar("_Command", bound=Callable[..., Any])

_CAMERAS = ("light_field", "camera_step", "camera_unit")

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

_CAMERA_OPTIONS = (
    click.option(
        "--light-field",
        is_flag=True,
        help="Pictures are the views of a grid of cameras, named ..._ROW_COLUMN.",
    ),
    click.option(
        "--camera-step",
        metavar="U,V",
        callback=numbers(float, "30.8,30.8"),
        help="Distance of the cameras of a light field.  [default: 1,1]",
    ),
    click.option("--camera-unit", help="Unit of that distance, such as millimeter."),
)


def source_options(command: _Command) -> _Command:
    """Give a command the options that say how a source is read."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def camera_options(command: _Command) -> _Command:
    """Give a command, besides `source_options`, those that make pictures a light field."""
    for option in reversed(_CAMERA_OPTIONS):
        command = option(command)
    return command


def open_given(source: str, given: dict[str, Any]) -> Source:
    """The source that a command line names; close it.

    Args:
        source: file, folder or pattern.
        given: the values of `source_options` and `camera_options`, among others.
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
        cameras=_cameras(given),
    )


def take_cameras(options: dict[str, Any]) -> CameraStep | None:
    """The argument ``cameras`` of ingest; takes its options out of all.

    Raises:
        click.UsageError: cameras are described, and it is not said that this is a light field.
        InvalidInputError: a step that no grid can have.
    """
    return _cameras({name: options.pop(name) for name in _CAMERAS})


def _cameras(given: dict[str, Any]) -> CameraStep | None:
    from octobrick.store import CameraStep

    is_light_field, step, unit = (given[name] for name in _CAMERAS)
    if is_light_field:
        return CameraStep(step or (1.0, 1.0), unit)
    if step is not None or unit is not None:
        raise click.UsageError("--camera-step and --camera-unit are of a --light-field.")
    return None
