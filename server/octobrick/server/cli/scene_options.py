"""Options of what rays make of a volume: mode, cuts, light, gradients."""

from __future__ import annotations

from typing import Any

import click

from octobrick.server.cli.values import corners, light, numbers, several

_POINT = numbers(float, "1,0,0")

SCENE_OPTIONS = (
    click.option(
        "--mode",
        type=click.Choice(["dvr", "mip", "minip", "average", "isosurface", "slice"]),
        default="dvr",
        show_default=True,
        help="What rays make of their samples.",
    ),
    click.option("--iso", type=float, help="Value of an isosurface."),
    click.option(
        "--iso-opacity",
        type=float,
        default=1.0,
        show_default=True,
        help="Less lets further surfaces shine through.",
    ),
    click.option(
        "--slice-normal",
        metavar="X,Y,Z",
        callback=_POINT,
        help="World direction across a slice.  [default: that of the view]",
    ),
    click.option(
        "--slice-point",
        metavar="X,Y,Z",
        callback=_POINT,
        help="World position on a slice.  [default: the middle of the volume]",
    ),
    click.option("--rgb", is_flag=True, help="Channels 0, 1 and 2, or those of --c, are colours."),
    click.option(
        "--clip-box",
        metavar="X0,Y0,Z0,X1,Y1,Z1",
        callback=corners,
        help="Show only this box of world space; a part may be left empty.",
    ),
    click.option(
        "--clip-plane",
        "clip_planes",
        multiple=True,
        metavar="NX,NY,NZ,OFFSET",
        callback=several(numbers(float, "0,0,1,-20")),
        help="Show only where n·p + offset >= 0; may be repeated.",
    ),
    click.option(
        "--light",
        "lights",
        multiple=True,
        metavar="X,Y,Z[:#RRGGBB]",
        callback=several(light),
        help="Light from this direction of the world, or from the eye; up to four.  [default: eye]",
    ),
    click.option(
        "--gradients",
        type=click.Choice(["auto", "stored", "differences"]),
        default="auto",
        show_default=True,
        help="What surfaces are lit by.",
    ),
    click.option(
        "--edges",
        metavar="LO,HI",
        callback=numbers(float, "0.01,0.1"),
        help="Opacity grows between these magnitudes of the gradient (windows per voxel).",
    ),
    click.option(
        "--deblock",
        type=float,
        is_flag=False,
        flag_value=4.0,  # as the renderer has it where it is only told to
        metavar="[STRENGTH]",
        help="Smooth what the codec's blocks left; at 4, or another strength.",
    ),
    click.option("--no-deblock", is_flag=True, help="Leave it as it is.  [default]"),
    click.option(
        "--direct",
        type=click.Choice(["nearest", "linear", "shared"]),
        help="Decode what rays touch, from S3Dc at a fixed rate, instead of slabs.",
    ),
)


def scene_fields(given: dict[str, Any]) -> dict[str, Any]:
    """The values of the options as fields of a view; those of other options are left alone."""
    fields = dict(given)
    strength, without = fields.pop("deblock"), fields.pop("no_deblock")
    if strength is not None and without:
        raise click.UsageError("--deblock and --no-deblock exclude one another.")
    return fields | {"deblocking": False if strength is None else strength}
