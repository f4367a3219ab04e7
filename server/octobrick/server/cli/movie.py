"""``octobrick movie``: a turntable, a time series or a path of cameras, as a movie or frames."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from octobrick.codec.errors import InvalidInputError, NotFoundError
from octobrick.server.cli.movie_output import Writing, movie_output
from octobrick.server.cli.progress import FrameReport
from octobrick.server.cli.stoppable import stoppable
from octobrick.server.cli.text import format_nbytes, format_seconds
from octobrick.server.cli.values import steps
from octobrick.server.cli.view_options import holds_depth, view_of, view_options

if TYPE_CHECKING:
    from octobrick.renderer import Camera, Shot
    from octobrick.server.views.view import View
    from octobrick.store import Volume

Steps = tuple[int, int | None, int]

FRAMES = 120
"""A turn in steps of 3 degrees: slow enough to follow at 25 frames a second."""


@click.command()
@click.argument("volume")
@click.argument("out", type=click.Path(path_type=Path))
@click.option("--turntable", is_flag=True, help="Go once around the volume.  [default]")
@click.option(
    "--times",
    metavar="A:B[:STEP]",
    callback=steps,
    help="Show time steps, each in a frame; an end may be left out (: for all).",
)
@click.option(
    "--cameras",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Move between the cameras of a JSON file.",
)
@click.option(
    "--frames", type=click.IntRange(min=1), help=f"Of a turn or a path.  [default: {FRAMES}]"
)
@click.option("--fps", type=float, default=25, show_default=True, help="Frames per second.")
@view_options
@click.option("--quality", type=click.IntRange(1, 100), help="Of lossy files.")
@click.option("--resume", is_flag=True, help="Keep frames that are in the folder already.")
@click.option("--overwrite", is_flag=True, help="Replace what is at OUT already.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@click.option("--quiet", is_flag=True, help="Print nothing but errors (and JSON, if asked).")
def movie(
    volume: str,
    out: Path,
    turntable: bool,
    times: Steps | None,
    cameras: Path | None,
    frames: int | None,
    fps: float,
    quality: int | None,
    resume: bool,
    overwrite: bool,
    as_json: bool,
    quiet: bool,
    **options: Any,
) -> None:
    """Render a movie of VOLUME to OUT.

    OUT is NAME.mp4, .webm, .webp or .gif, which appears when it is complete; or a folder for
    frame_0001.png and so on; or a pattern of frames such as out/f_%04d.exr.
    """
    from octobrick.renderer import Renderer
    from octobrick.store import open_volume

    if turntable + (times is not None) + (cameras is not None) > 1:
        raise click.UsageError("--turntable, --times and --cameras exclude one another.")
    if times is not None and (frames is not None or options["t"]):
        raise click.UsageError("--times says which frames there are: leave --frames and --t out.")
    view = replace(view_of(options), depth=holds_depth(out))
    keys = None if cameras is None else _read_cameras(cameras)
    how = Writing(fps, quality, resume, overwrite)
    output = movie_output(out, view, how)
    with stoppable(), open_volume(volume) as opened, Renderer() as renderer:
        shots = _shots(opened, view, times, keys, frames or FRAMES)
        report = FrameReport(len(shots), quiet=quiet)
        made = _Made(len(shots))
        with output.opened(_shown(opened, view, shots, quality)) as write, report:
            for index, shot in enumerate(shots):
                if output.has(index):
                    made.kept += 1
                else:
                    if shot.t != shots[min(index + 1, len(shots) - 1)].t:
                        following = shots[index + 1]
                        view.prefetch(renderer, opened, following.camera, following.t)
                    image = view.render(renderer, opened, camera=shot.camera, t=shot.t)
                    write(index, image)
                    made.max_error = max(made.max_error, image.fidelity.max_error)
                report.advance()
    _print_result(out, view, how, made, output.nbytes(len(shots)), report, as_json, quiet)


@dataclass(slots=True)
class _Made:
    """What became of the frames."""

    frames: int
    kept: int = 0
    max_error: float = 0.0


def _shots(
    volume: Volume, view: View, times: Steps | None, keys: list[Camera] | None, nframes: int
) -> list[Shot]:
    from octobrick.renderer import Shot, camera_path, through_time, turntable

    if keys is not None:
        return [Shot(camera, view.t) for camera in camera_path(keys, nframes)]
    if times is None:
        around = turntable(replace(view, oriented=False).camera(volume), nframes, t=view.t)
        return [Shot(view.turned(shot.camera, volume), shot.t) for shot in around]
    start, stop, step = times
    stop = volume.nt if stop is None else stop
    if not 0 <= start < stop <= volume.nt:
        raise InvalidInputError(
            f"time steps {start}:{stop} are not in the volume, which has 0:{volume.nt}"
        )
    chosen = range(start, stop, step)
    return through_time(view.camera(volume, chosen), chosen)


def _read_cameras(file: Path) -> list[Camera]:
    from octobrick.renderer import Camera

    try:
        data = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise NotFoundError(f"{file}: no such file; name a list of cameras as JSON") from error
    except ValueError as error:
        raise InvalidInputError(f"{file}: not JSON: {error}") from error
    if not isinstance(data, list) or not all(isinstance(item, dict) for item in data):
        raise InvalidInputError(f"{file}: must be a list of cameras, as Camera.to_dict gives them")
    return [Camera.from_dict(item) for item in data]


def _shown(volume: Volume, view: View, shots: list[Shot], quality: int | None) -> dict[str, Any]:
    """All that decides what the frames look like, JSON-ready."""
    every = json.dumps([[shot.t, shot.camera.to_dict()] for shot in shots])
    return {
        "octobrick_movie": 1,
        "revision": volume.revision,
        "frames": len(shots),
        "quality": quality,
        **asdict(view),
        "cameras and times": hashlib.blake2b(every.encode(), digest_size=16).hexdigest(),
    }


def _print_result(
    out: Path,
    view: View,
    how: Writing,
    made: _Made,
    nbytes: int,
    report: FrameReport,
    as_json: bool,
    quiet: bool,
) -> None:
    seconds = report.elapsed_seconds
    if as_json:
        result = {
            "path": str(out),
            "frames": made.frames,
            "kept": made.kept,
            "size": list(view.size),
            "fps": how.fps,
            "max_error": made.max_error,
            "nbytes": nbytes,
            "elapsed_seconds": seconds,
        }
        click.echo(json.dumps(result))
    elif not quiet:
        width, height = view.size
        kept = f", {made.kept} of them kept" if made.kept else ""
        click.echo(
            f"{out}: {made.frames} frames of {width}×{height} pixels{kept}, max error "
            f"{made.max_error:g}, {format_nbytes(nbytes)} in {format_seconds(seconds)}: "
            f"{(made.frames - made.kept) / seconds:.1f} frames/s"
        )
