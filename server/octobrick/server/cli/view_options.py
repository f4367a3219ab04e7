"""Options that say what a picture shows, shared by the commands that make some.

Another option is a line of the table here, a field of `octobrick.server.view.View` of the same
name, and a row in docs/cli.md for each command.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from octobrick.codec.errors import InvalidInputError, NotFoundError
from octobrick.server import view as defaults
from octobrick.server.cli.values import numbers, size
from octobrick.server.view import View, parse_background, preset_function

if TYPE_CHECKING:
    from octobrick.renderer import TransferFunction

_Command = TypeVar("_Command", bound=Callable[..., Any])

_OPTIONS = (
    click.option(
        "--azimuth",
        type=float,
        default=defaults.AZIMUTH_DEGREES,
        show_default=True,
        help="Degrees around the volume.",
    ),
    click.option(
        "--elevation",
        type=click.FloatRange(-90, 90),
        default=defaults.ELEVATION_DEGREES,
        show_default=True,
        help="Degrees above its middle.",
    ),
    click.option(
        "--fit",
        type=click.Choice(["visible", "volume"]),
        default="visible",
        show_default=True,
        help="Look at what the transfer function shows, or at all of the volume.",
    ),
    click.option(
        "--distance", type=float, help="World units from its centre.  [default: all in view]"
    ),
    click.option(
        "--fov",
        type=float,
        default=defaults.FOV_DEGREES,
        show_default=True,
        help="Degrees across the shorter side.",
    ),
    click.option(
        "--projection",
        type=click.Choice(["perspective", "orthographic"]),
        default="perspective",
        show_default=True,
        help="Of the camera.",
    ),
    click.option(
        "--preset",
        default=defaults.PRESET,
        show_default=True,
        help="Transfer function: ct-bone, ct-soft-tissue, mr, microscopy.",
    ),
    click.option(
        "--transfer-function",
        "function_file",
        type=click.Path(path_type=Path),
        metavar="FILE",
        help="Transfer function as JSON, instead of a preset.",
    ),
    click.option(
        "--window", metavar="LO,HI", callback=numbers(float, "-100,900"), help="Values at its ends."
    ),
    click.option(
        "--size",
        callback=size,
        metavar="WIDTHxHEIGHT",
        default="768x768",
        show_default=True,
        help="Pixels.",
    ),
    click.option("--shading/--no-shading", default=True, help="Light surfaces.  [default: on]"),
    click.option(
        "--background",
        default="#000000",
        show_default=True,
        help="#rrggbb, or r,g,b from 0 to 1, or transparent.",
    ),
    click.option(
        "--step",
        "step_voxels",
        type=float,
        default=defaults.STEP_VOXELS,
        show_default=True,
        help="Distance of samples along a ray, in voxels.",
    ),
    click.option("--level", type=int, help="Resolution to render.  [default: as fits the picture]"),
    click.option("--t", type=int, default=0, show_default=True, help="Time step."),
    click.option("--c", type=int, default=0, show_default=True, help="Channel."),
    click.option("--scale-bar", is_flag=True, help="Draw a round length on the picture."),
    click.option("--legend", is_flag=True, help="Draw the colours of the values on it."),
)


def view_options(command: _Command) -> _Command:
    """Give a command the options that `view_of` takes."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def view_of(given: dict[str, Any]) -> View:
    """The view that a command line describes.

    Args:
        given: the values of `view_options`, and no others.

    Raises:
        InvalidInputError: a preset or a colour that does not exist.
        NotFoundError: the file of the transfer function is missing.
    """
    fields = dict(given)
    function = _transfer_function(fields.pop("preset"), fields.pop("function_file"))
    background = parse_background(fields.pop("background"))
    return View(transfer_function=function, background=background, **fields)


def require_folder(path: Path) -> None:
    """Refuse a file whose folder is not there: before the work, not after it.

    Raises:
        NotFoundError: there is no such folder.
    """
    if not path.absolute().parent.is_dir():
        raise NotFoundError(f"{path}: there is no such folder; make it, or name another")


def require_no_annotations(view: View, path: Path) -> None:
    """Refuse to lose scale bar and legend in a file that holds what the rays gathered.

    Raises:
        InvalidInputError: one of them was asked for.
    """
    if view.scale_bar or view.legend:
        raise InvalidInputError(
            f"{path}: {path.suffix} holds what the rays gathered, on which nothing is drawn; leave "
            "--scale-bar and --legend out, or choose .png, .webp or .jpg"
        )


def _transfer_function(preset: str, file: Path | None) -> TransferFunction:
    if file is None:
        return preset_function(preset)
    try:
        text = file.read_text()
    except FileNotFoundError as error:
        raise NotFoundError(f"{file}: no such file; name a transfer function as JSON") from error
    from octobrick.renderer import TransferFunction

    return TransferFunction.from_json(text)
