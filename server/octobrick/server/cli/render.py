"""``octobrick render``: a picture of a volume, without a screen."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import click

from octobrick.codec.errors import NotFoundError
from octobrick.server import view as defaults
from octobrick.server.cli.text import format_seconds
from octobrick.server.cli.values import numbers, size
from octobrick.server.view import Fit, Projection, View, parse_background, preset_function

if TYPE_CHECKING:
    from octobrick.renderer import TransferFunction


@click.command()
@click.argument("volume", type=click.Path(path_type=Path))
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), required=True, help="PNG file to write."
)
@click.option(
    "--azimuth",
    type=float,
    default=defaults.AZIMUTH_DEGREES,
    show_default=True,
    help="Degrees around the volume.",
)
@click.option(
    "--elevation",
    type=click.FloatRange(-90, 90),
    default=defaults.ELEVATION_DEGREES,
    show_default=True,
    help="Degrees above its middle.",
)
@click.option(
    "--fit",
    type=click.Choice(["visible", "volume"]),
    default="visible",
    show_default=True,
    help="Look at what the transfer function shows, or at all of the volume.",
)
@click.option("--distance", type=float, help="World units from its centre.  [default: all in view]")
@click.option(
    "--fov",
    type=float,
    default=defaults.FOV_DEGREES,
    show_default=True,
    help="Degrees across the shorter side.",
)
@click.option(
    "--projection",
    type=click.Choice(["perspective", "orthographic"]),
    default="perspective",
    show_default=True,
    help="Of the camera.",
)
@click.option(
    "--preset",
    default=defaults.PRESET,
    show_default=True,
    help="Transfer function: ct-bone, ct-soft-tissue, mr, microscopy.",
)
@click.option(
    "--transfer-function",
    "function_file",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Transfer function as JSON, instead of a preset.",
)
@click.option(
    "--window", metavar="LO,HI", callback=numbers(float, "-100,900"), help="Values at its ends."
)
@click.option(
    "--size",
    callback=size,
    metavar="WIDTHxHEIGHT",
    default="768x768",
    show_default=True,
    help="Pixels.",
)
@click.option("--shading/--no-shading", default=True, help="Light surfaces.  [default: on]")
@click.option(
    "--background",
    default="#000000",
    show_default=True,
    help="#rrggbb, or r,g,b from 0 to 1, or transparent.",
)
@click.option(
    "--step",
    "step_voxels",
    type=float,
    default=defaults.STEP_VOXELS,
    show_default=True,
    help="Distance of samples along a ray, in voxels.",
)
@click.option("--level", type=int, help="Resolution to render.  [default: as fits the picture]")
@click.option("--stats", is_flag=True, help="Print what was done and what was lost, as JSON.")
def render(
    volume: Path,
    output: Path,
    preset: str,
    function_file: Path | None,
    fit: str,
    projection: str,
    background: str,
    stats: bool,
    **options: Any,
) -> None:
    """Render VOLUME, a folder made by ingest, to a PNG file."""
    view = View(
        transfer_function=_transfer_function(preset, function_file),
        fit=cast("Fit", fit),
        projection=cast("Projection", projection),
        background=parse_background(background),
        **options,
    )
    if not output.absolute().parent.is_dir():  # before the work, not after it
        raise NotFoundError(f"{output}: there is no such folder; make it, or name another")
    from octobrick.renderer import Renderer
    from octobrick.store import open_volume

    with open_volume(volume) as opened, Renderer() as renderer:
        image = view.render(renderer, opened)
        image.save(output)
    if stats:
        report = {"fidelity": image.fidelity.to_dict(), "stats": image.stats.to_dict()}
        click.echo(json.dumps(report))
    else:
        width, height = view.size
        click.echo(
            f"{output}: {width}×{height} pixels, level {image.fidelity.level}, "
            f"max error {image.fidelity.max_error:g}, "
            f"{format_seconds(image.stats.milliseconds['total'] / 1000)}"
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
