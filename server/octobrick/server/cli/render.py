"""``octobrick render``: a picture of a volume, without a screen."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from octobrick.server.cli.text import format_seconds
from octobrick.server.cli.view_options import (
    require_folder,
    require_no_annotations,
    view_of,
    view_options,
)


@click.command()
@click.argument("volume", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    required=True,
    help="File to write: .png, .webp, .jpg, .exr or .npy.",
)
@view_options
@click.option(
    "--quality",
    type=click.IntRange(1, 100),
    help="Of .jpg and .webp.  [default: 92; lossless]",
)
@click.option("--stats", is_flag=True, help="Print what was done and what was lost, as JSON.")
def render(volume: Path, output: Path, quality: int | None, stats: bool, **options: Any) -> None:
    """Render VOLUME, a folder made by ingest, to a picture file."""
    from octobrick.renderer import Renderer
    from octobrick.renderer.picture_files import holds_floats, require_picture
    from octobrick.store import open_volume

    view = view_of(options)
    require_folder(output)
    require_picture(output, quality, transparent=view.background is None)
    if holds_floats(output):
        require_no_annotations(view, output)
    with open_volume(volume) as opened, Renderer() as renderer:
        image = view.render(renderer, opened)
        image.save(output, quality=quality)
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
