"""``octobrick render``: a picture of a volume, without a screen."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from octobrick.codec.errors import InvalidInputError
from octobrick.server.cli.surface_options import surface_options
from octobrick.server.cli.text import format_seconds
from octobrick.server.cli.view_options import (
    holds_depth,
    require_folder,
    require_no_annotations,
    view_of,
    view_options,
)

if TYPE_CHECKING:
    from octobrick.renderer import RenderedImage
    from octobrick.server.views.mesh_view import MeshView
    from octobrick.server.views.view import View
    from octobrick.store import Placement


@click.command()
@click.argument("volume")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    required=True,
    help="File to write: .png, .webp, .jpg, .exr or .npy.",
)
@view_options
@surface_options("Draw this mesh (.ply, .obj) with the volume as its solid texture.")
@click.option(
    "--surface-sampling",
    type=click.Choice(["linear", "nearest"]),
    default="linear",
    show_default=True,
    help="How the texture is sampled.",
)
@click.option(
    "--quality",
    type=click.IntRange(1, 100),
    help="Of .jpg and .webp.  [default: 92; lossless]",
)
@click.option(
    "--depth",
    "depth_file",
    type=click.Path(path_type=Path),
    metavar="FILE.npy",
    help="Also write how far away is what is seen.",
)
@click.option("--stats", is_flag=True, help="Print what was done and what was lost, as JSON.")
def render(
    volume: str,
    output: Path,
    quality: int | None,
    depth_file: Path | None,
    stats: bool,
    surface: Path | None,
    surface_placement: Placement | None,
    surface_up: str,
    surface_sampling: str,
    **options: Any,
) -> None:
    """Render VOLUME, a folder made by ingest or an address, to a picture file."""
    from octobrick.renderer import Renderer
    from octobrick.renderer.picture_files import holds_floats, require_picture
    from octobrick.server.views.mesh_view import MeshView
    from octobrick.store import open_volume, read_mesh

    view = view_of(options)
    require_folder(output)
    require_picture(output, quality, transparent=view.background is None)
    if holds_floats(output):
        require_no_annotations(view, output)
    if depth_file is not None:
        _require_depth_file(depth_file)
    if surface is not None:
        if depth_file is not None:
            raise InvalidInputError("depth: is not told of surfaces; leave it out", field="depth")
        shown: View | MeshView = MeshView(
            view, read_mesh(surface), surface_placement, surface_up, surface_sampling
        )
    else:
        shown = replace(view, depth=depth_file is not None or holds_depth(output))
    with open_volume(volume) as opened, Renderer() as renderer:
        image = shown.render(renderer, opened)
        if isinstance(shown, MeshView) and (warning := shown.warning(opened)):
            click.echo(f"octobrick: warning: {warning}", err=True)
        image.save(output, quality=quality)
        if depth_file is not None:
            _save_depth(image, depth_file)
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


def _require_depth_file(file: Path) -> None:
    require_folder(file)
    if file.suffix != ".npy":
        raise InvalidInputError(f"{file}: depth is written as .npy; choose a name that ends so")


def _save_depth(image: RenderedImage, file: Path) -> None:
    import numpy as np

    from octobrick.store.staging import staged_file

    assert image.depth is not None
    with staged_file(file.resolve(), overwrite=True) as partial, partial.open("wb") as stream:
        np.save(stream, image.depth)
