"""``octobrick ingest``: from a file that people have to a volume of compressed bricks."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from octobrick.server.cli.codec_options import codec_options, take_codec
from octobrick.server.cli.failure import EXIT_INTERRUPTED
from octobrick.server.cli.source_options import (
    camera_options,
    open_given,
    source_options,
    take_cameras,
)
from octobrick.server.cli.stoppable import cancellable
from octobrick.server.cli.surface_options import surface_options
from octobrick.server.cli.text import (
    format_nbytes,
    format_psnr,
    format_ratio,
    format_seconds,
    format_shape,
    print_table,
)
from octobrick.server.cli.values import Ends, nbytes, numbers, ranges

if TYPE_CHECKING:
    from octobrick.store import Box, IngestResult
    from octobrick.store.report import LevelReport


@click.command()
@click.argument("source")
@click.argument("dest", type=click.Path(path_type=Path))
@codec_options
@click.option(
    "--brick", type=int, default=64, show_default=True, help="Voxels along each side of a brick."
)
@click.option(
    "--shard", type=int, default=4, show_default=True, help="Bricks along each side of a shard."
)
@click.option(
    "--zstd-level", type=int, help="Effort of zstd, 1 to 19.  [default: 1, of lossless 3]"
)
@click.option("--levels", type=int, help="Levels of the pyramid.  [default: until one brick]")
@click.option(
    "--reducer",
    type=click.Choice(["mean", "max", "min", "mode", "nearest"]),
    help="What makes a coarser voxel of 2×2×2.  [default: mean, of labels mode]",
)
@click.option(
    "--gradients", is_flag=True, help="Also store directions of gradients, of levels from 1 on."
)
@click.option(
    "--labels/--no-labels",
    default=None,
    help="Voxels are names: keep them exactly, reduce by mode.  [default: as the source says]",
)
@click.option("--convert", metavar="TYPE", help="Store voxels as TYPE, such as uint16.")
@click.option(
    "--window",
    metavar="LOW,HIGH",
    callback=numbers(float, "0,4095"),
    help="Values that become the ends of the integer TYPE.",
)
@click.option(
    "--region",
    metavar="Z0:Z1,Y0:Y1,X0:X1",
    callback=ranges,
    help="Store only these voxels; an end may be left out.",
)
@source_options
@camera_options
@surface_options("Store only what this mesh (.ply, .obj) touches, whose solid texture it is.")
@click.option(
    "--replace-nonfinite", type=float, metavar="VALUE", help="What stands for NaN and infinities."
)
@click.option("--overwrite", is_flag=True, help="Replace a volume that is at DEST already.")
@click.option("--restart", is_flag=True, help="Forget an ingest that did not finish.")
@click.option("--workers", type=int, help="Encoding threads.  [default: one per processor]")
@click.option(
    "--memory",
    metavar="SIZE",
    callback=nbytes,
    help="Memory to take at most, about, such as 512MiB.  [default: half of the system's]",
)
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@click.option("--quiet", is_flag=True, help="Print nothing but errors (and JSON, if asked).")
def ingest(
    source: str,
    dest: Path,
    region: Ends | None,
    as_json: bool,
    quiet: bool,
    **options: Any,
) -> None:
    """Compress the volume in SOURCE into the folder DEST (by custom NAME.zarr).

    SOURCE is a file, folder or pattern of files in a format that docs/formats.md lists, the
    address of an OME-Zarr (https://, s3://), or raw voxels with --shape and --dtype; with
    --light-field, the pictures of a grid of cameras. DEST appears when it is complete. An ingest
    that was stopped, by Ctrl-C, a full disk, a lost server or a crash, goes on where it was when
    the same command is run again.
    """
    from octobrick import store
    from octobrick.server.cli.progress import ProgressReport
    from octobrick.store.errors import IngestCancelledError

    coding = take_codec(options)
    try:
        with cancellable() as cancel:
            itemsize = _announce(source, options, quiet=quiet or as_json)
            with ProgressReport(itemsize, quiet=quiet) as progress:
                result = store.ingest(
                    source,
                    dest,
                    **coding,
                    cameras=take_cameras(options),
                    region=_region(region),
                    progress=progress,
                    cancel=cancel,
                    **options,
                )
    except (KeyboardInterrupt, IngestCancelledError):
        click.echo(f"octobrick: interrupted; {_remains(dest)}", err=True)
        raise click.exceptions.Exit(EXIT_INTERRUPTED) from None
    if as_json:
        click.echo(json.dumps(result.to_dict()))
    elif not quiet:
        _print_result(result)


def _region(ends: Ends | None) -> Box | None:
    """The box of voxels, with -1 for an end that only the source knows."""
    from octobrick.store import Box

    if ends is None:
        return None
    (z0, z1), (y0, y1), (x0, x1) = ((a or 0, -1 if b is None else b) for a, b in ends)
    return Box((z0, y0, x0), (z1, y1, x1))


def _announce(source: str, options: dict[str, Any], *, quiet: bool) -> int:
    """Say what is in the source; returns the bytes of a voxel."""
    with open_given(source, options) as opened:
        itemsize = opened.dtype.itemsize
        if not quiet:
            shape_zyx = opened.shape_zyx
            click.echo(
                f"{opened.path.name}: {opened.format}, {opened.dtype}, "
                f"{_parts(opened.nt, opened.nc)}{format_shape(shape_zyx)} voxels (z×y×x), "
                f"{format_nbytes(math.prod(shape_zyx) * opened.nt * opened.nc * itemsize)}"
            )
        return itemsize


def _parts(nt: int, nc: int) -> str:
    """How many time steps and channels, where there are several."""
    steps = f"{nt} time steps, " if nt > 1 else ""
    return steps + (f"{nc} channels, " if nc > 1 else "")


def _remains(dest: Path) -> str:
    from octobrick.store.destination import partial_path
    from octobrick.store.journal import has_checkpoint

    partial = partial_path(dest)
    if has_checkpoint(partial):
        return f"run the same command again to go on from the checkpoint in {partial}"
    if partial.exists():
        return f"{partial} could not be removed, and can be"
    return f"nothing was left behind at {dest}"


def _print_result(result: IngestResult) -> None:
    from octobrick.store.brick_codec import codec_text

    gradients = any(level.gradient_nbytes is not None for level in result.levels)
    print_table(
        ("level", "z×y×x", "size", "stored", "ratio", "PSNR", "max error", "codec")
        + (("gradients",) if gradients else ()),
        (
            (
                str(level.index),
                format_shape(level.shape_zyx),
                format_nbytes(level.nbytes),
                format_nbytes(level.stored_nbytes),
                format_ratio(level.nbytes, level.stored_nbytes),
                format_psnr(level.psnr_db),
                f"{level.max_error:g}",
                codec_text(level.codec),
                *((_gradients(level),) if gradients else ()),
            )
            for level in result.levels
        ),
    )
    size_nbytes = sum(level.nbytes for level in result.levels)
    stored_nbytes = sum(level.stored_nbytes for level in result.levels)
    if result.resumed_voxels:
        click.echo(f"went on after {result.resumed_voxels / 1e6:.0f} Mvoxel of an earlier run")
    click.echo(
        f"{format_nbytes(size_nbytes)} in {len(result.levels)} levels became "
        f"{format_nbytes(stored_nbytes)}, {format_ratio(size_nbytes, stored_nbytes)} times "
        f"smaller, in {format_seconds(result.elapsed_seconds)}: "
        f"{result.megabytes_per_second:.0f} MB/s, peak memory "
        f"{format_nbytes(result.peak_rss_nbytes)}"
    )
    click.echo(f"{result.path} (revision {result.revision})")
    for warning in result.warnings:
        click.echo(f"octobrick: warning: {warning}", err=True)


def _gradients(level: LevelReport) -> str:
    return "" if level.gradient_nbytes is None else format_nbytes(level.gradient_nbytes)
