"""``octobrick light-field``: what an eye sees between the cameras of a light field."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from octobrick.server.cli.movie_output import Writing, movie_output
from octobrick.server.cli.progress import FrameReport
from octobrick.server.cli.stoppable import stoppable
from octobrick.server.cli.text import format_nbytes, format_seconds
from octobrick.server.cli.values import nbytes, numbers
from octobrick.server.cli.view_options import require_folder

if TYPE_CHECKING:
    from octobrick.renderer import RenderedImage
    from octobrick.renderer.light_field import Eye, Interpolation, LightField

_FRAMES = 50  # two seconds
_uv = numbers(float, "7.5,7.5")


@click.command("light-field")
@click.argument("volume")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    required=True,
    help="Picture to write; of a path, a movie, a folder, or a pattern such as f_%04d.png.",
)
@click.option(
    "--eye", metavar="U,V", callback=_uv, help="Where the eye is, in views.  [default: the middle]"
)
@click.option(
    "--focus",
    type=float,
    default=0.0,
    show_default=True,
    help="Pixels that a point in focus moves from one view to the next.",
)
@click.option(
    "--spread",
    type=float,
    default=0.0,
    show_default=True,
    help="Views that the picture's width crosses: how far the eye is behind the cameras.",
)
@click.option(
    "--interpolation",
    type=click.Choice(["nearest", "st", "uvst"]),
    default="uvst",
    show_default=True,
    help="Blend nothing, pixels, or pixels and views.",
)
@click.option("--to", metavar="U,V", callback=_uv, help="Move the eye to there, in a movie.")
@click.option("--to-focus", type=float, help="Move the focus to there, in a movie.")
@click.option("--frames", type=click.IntRange(min=2), help=f"Of a movie.  [default: {_FRAMES}]")
@click.option("--fps", type=float, default=25, show_default=True, help="Frames per second.")
@click.option("--quality", type=click.IntRange(1, 100), help="Of lossy files.")
@click.option("--overwrite", is_flag=True, help="Replace a movie that is there already.")
@click.option(
    "--memory",
    metavar="SIZE",
    callback=nbytes,
    default="128MiB",
    show_default=True,
    help="Of decoded views that are kept.",
)
@click.option("--stats", is_flag=True, help="Print what was done and what was lost, as JSON.")
def light_field(
    volume: str,
    output: Path,
    eye: tuple[float, float] | None,
    focus: float,
    spread: float,
    interpolation: Interpolation,
    to: tuple[float, float] | None,
    to_focus: float | None,
    frames: int | None,
    fps: float,
    quality: int | None,
    overwrite: bool,
    memory: int,
    stats: bool,
) -> None:
    """Show VOLUME, a light field that ingest made, from between its cameras.

    With --to or --to-focus eye and focus move in a straight line, in as many frames as are asked
    for. docs/light-fields.md shows what focus and interpolation do.
    """
    from octobrick.renderer.light_field import Eye, LightField
    from octobrick.renderer.picture_files import require_picture
    from octobrick.store import open_volume

    if to is None and to_focus is None and frames is not None:
        raise click.UsageError("--frames is of a movie: say where it goes by --to or --to-focus.")
    moves = to is not None or to_focus is not None
    how = Writing(fps, quality, resume=False, overwrite=overwrite)
    if not moves:
        require_folder(output)
        require_picture(output, quality)
    with stoppable(), open_volume(volume) as opened:
        scene = LightField(opened, memory)
        start = Eye(*(eye or ((scene.nu - 1) / 2, (scene.nv - 1) / 2)), focus, spread)
        if moves:
            end = Eye(*(to or (start.u, start.v)), focus if to_focus is None else to_focus, spread)
            said = {"revision": opened.revision, "interpolation": interpolation}
            _movie(scene, (start, end), frames or _FRAMES, output, how, said, stats=stats)
        else:
            image = scene.render(start, interpolation)
            image.save(output, quality=quality)
            _tell_picture(image, output, stats=stats)


def _movie(
    scene: LightField,
    ends: tuple[Eye, Eye],
    nframes: int,
    output: Path,
    how: Writing,
    said: dict[str, Any],
    *,
    stats: bool,
) -> None:
    """Write the frames between two eyes."""
    from octobrick.renderer.light_field import eye_path
    from octobrick.server.views.view import View

    for end in ends:  # before the work, not after half of it
        end.require_within(scene.nu, scene.nv)
    files = movie_output(output, View(background=(0.0, 0.0, 0.0)), how)
    shown = said | {"eyes": [end.to_dict() for end in ends], "frames": nframes}
    report, max_error = FrameReport(nframes, quiet=stats), 0.0
    with files.opened(shown) as write, report:
        for index, eye in enumerate(eye_path(ends, nframes)):
            image = scene.render(eye, said["interpolation"])
            write(index, image)
            max_error = max(max_error, image.fidelity.max_error)
            report.advance()
    seconds, written_nbytes = report.elapsed_seconds, files.nbytes(nframes)
    if stats:
        result = {"frames": nframes, "max_error": max_error, "nbytes": written_nbytes}
        click.echo(json.dumps(result | {"elapsed_seconds": seconds}))
    else:
        width, height = scene.size
        click.echo(
            f"{output}: {nframes} frames of {width}×{height} pixels, max error {max_error:g}, "
            f"{format_nbytes(written_nbytes)} in {format_seconds(seconds)}"
        )


def _tell_picture(image: RenderedImage, output: Path, *, stats: bool) -> None:
    if stats:
        report = {"fidelity": image.fidelity.to_dict(), "stats": image.stats.to_dict()}
        click.echo(json.dumps(report))
        return
    width, height = image.size
    click.echo(
        f"{output}: {width}×{height} pixels, max error {image.fidelity.max_error:g}, "
        f"{format_seconds(image.stats.milliseconds['total'] / 1000)}"
    )
