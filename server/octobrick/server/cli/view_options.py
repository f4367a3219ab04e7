"""Options that say what a picture shows, shared by the commands that make some.

Another option is a line of the table here, or of that in scene_options.py; a field of
`octobrick.server.views.view.View` of the same name; and a row in docs/cli.md for each command.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from octobrick.codec.errors import InvalidInputError, NotFoundError
from octobrick.server.cli.scene_options import SCENE_OPTIONS, scene_fields
from octobrick.server.cli.values import channels, numbers, several, size
from octobrick.server.views import view as defaults
from octobrick.server.views.view import View, parse_background, preset_function

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
        "--oriented", is_flag=True, help="Mean angles in the space of the source, as a patient's."
    ),
    click.option(
        "--preset",
        "presets",
        multiple=True,
        help="Transfer function: ct-bone, ct-soft-tissue, mr, microscopy; one for all channels, "
        "or one for each.  [default: ct-bone; greys, ivory or the channels' colours, as fits]",
    ),
    click.option(
        "--transfer-function",
        "function_files",
        type=click.Path(path_type=Path),
        multiple=True,
        metavar="FILE",
        help="Transfer function as JSON, instead of a preset; likewise.",
    ),
    click.option(
        "--window",
        "windows",
        multiple=True,
        metavar="LO,HI",
        callback=several(numbers(float, "-100,900")),
        help="Values at its ends; likewise.",
    ),
    *SCENE_OPTIONS,
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
    click.option(
        "--c",
        callback=channels,
        default="0",
        show_default=True,
        metavar="C[,C…]",
        help="Channel, or up to four.",
    ),
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
    fields = scene_fields(given)
    functions = _transfer_functions(fields.pop("presets"), fields.pop("function_files"))
    windows = fields.pop("windows")
    background = parse_background(fields.pop("background"))
    return View(
        transfer_function=_one_or_all(functions),
        window=_one_or_all(windows),
        background=background,
        **fields,
    )


def require_folder(path: Path) -> None:
    """Refuse a file whose folder is not there: before the work, not after it.

    Raises:
        NotFoundError: there is no such folder.
    """
    if not path.absolute().parent.is_dir():
        raise NotFoundError(f"{path}: there is no such folder; make it, or name another")


def holds_depth(path: Path) -> bool:
    """Whether a picture file has a channel for the depth."""
    return path.suffix.lower() == ".exr"


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


def _one_or_all(values: tuple[Any, ...]) -> Any:
    """None of no values; of one, that for all channels."""
    return values if len(values) > 1 else next(iter(values), None)


def _transfer_functions(
    presets: tuple[str, ...], files: tuple[Path, ...]
) -> tuple[TransferFunction, ...]:
    if presets and files:
        raise click.UsageError(
            "--preset and --transfer-function exclude one another; give only one of them."
        )
    return (*map(preset_function, presets), *map(_read_function, files))


def _read_function(file: Path) -> TransferFunction:
    try:
        text = file.read_text()
    except FileNotFoundError as error:
        raise NotFoundError(f"{file}: no such file; name a transfer function as JSON") from error
    from octobrick.renderer import TransferFunction

    return TransferFunction.from_json(text)
