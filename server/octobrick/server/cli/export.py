"""``octobrick export``: a region of a volume as a file that other programs open."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from octobrick.server.cli.stoppable import stoppable
from octobrick.server.cli.text import (
    format_nbytes,
    format_ratio,
    format_seconds,
    format_shape,
    print_table,
)
from octobrick.server.cli.values import Ends, interval, ranges

if TYPE_CHECKING:
    from octobrick.store import Box, Volume
    from octobrick.store.export import ExportResult


@click.command()
@click.argument("volume")
@click.argument("out", type=click.Path(path_type=Path))
@click.option(
    "--level", type=int, default=0, show_default=True, help="Resolution; 0 is the original."
)
@click.option(
    "--box",
    metavar="Z0:Z1,Y0:Y1,X0:X1",
    callback=ranges,
    help="Voxels of that level; an end may be left out.  [default: all]",
)
@click.option("--t", type=int, default=0, show_default=True, help="Time step.")
@click.option("--c", type=int, default=0, show_default=True, help="Channel.")
@click.option("--compress", is_flag=True, help="gzip in .nrrd, zlib in .tif.")
@click.option(
    "--active",
    metavar="LO:HI",
    callback=interval,
    help="Values of the voxels that .vdb keeps; an end may be left out.  [default: all]",
)
@click.option("--overwrite", is_flag=True, help="Replace what is at OUT already.")
@click.option("--workers", type=int, help="Decoding threads.  [default: one per processor]")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@click.option("--quiet", is_flag=True, help="Print nothing but errors (and JSON, if asked).")
def export(
    volume: str,
    out: Path,
    level: int,
    box: Ends | None,
    t: int,
    c: int,
    compress: bool,
    active: tuple[float, float] | None,
    overwrite: bool,
    workers: int | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Write a region of VOLUME to OUT, whose name says the format.

    NAME.npy, .nrrd, .nii, .nii.gz, .tif (OME-TIFF), .ome.zarr (all coarser levels too) or .vdb.
    Memory holds a layer of bricks, at most 512 MiB, and all active voxels of a .vdb. OUT appears
    when it is complete.
    """
    from octobrick.server.cli.progress import ProgressReport
    from octobrick.store import open_volume
    from octobrick.store.export import export as write

    with (
        stoppable(),
        open_volume(volume) as opened,
        ProgressReport(opened.dtype.itemsize, quiet=quiet) as progress,
    ):
        result = write(
            opened,
            out,
            level=level,
            box=_box(opened, level, box),
            t=t,
            c=c,
            compress=compress,
            active=active,
            overwrite=overwrite,
            workers=workers,
            progress=progress,
        )
    if as_json:
        click.echo(json.dumps(result.to_dict()))
    elif not quiet:
        _print_result(result)


def _box(volume: Volume, level: int, ends: Ends | None) -> Box | None:
    """The box, with the level's own ends where none are given."""
    from octobrick.store import Box

    if ends is None:
        return None
    (z0, z1), (y0, y1), (x0, x1) = (
        (start or 0, n if stop is None else stop)
        for (start, stop), n in zip(ends, volume.level(level).shape_zyx, strict=True)
    )
    return Box((z0, y0, x0), (z1, y1, x1))


def _print_result(result: ExportResult) -> None:
    spacing_xyz = ", ".join(f"{size:g}" for size in reversed(result.spacing_zyx))
    origin_xyz = ", ".join(f"{size:g}" for size in result.origin_xyz)
    unit = f" ({result.unit})" if result.unit else ""
    print_table(
        ("level", "z×y×x", "dtype", f"spacing{unit}", f"origin{unit}", "max error"),
        [
            (
                f"{result.level}" if result.levels == 1 else f"{result.level} and coarser",
                format_shape(result.shape_zyx),
                result.dtype,
                spacing_xyz,
                origin_xyz,
                f"{result.max_error:g}",
            )
        ],
    )
    seconds = result.elapsed_seconds
    voxels_nbytes = result.megabytes_per_second * 1e6 * seconds
    click.echo(
        f"{format_nbytes(voxels_nbytes)} of voxels became {format_nbytes(result.nbytes)}, "
        f"{format_ratio(round(voxels_nbytes), result.nbytes)} times smaller, in "
        f"{format_seconds(seconds)}: {result.megabytes_per_second:.0f} MB/s, peak memory "
        f"{format_nbytes(result.peak_rss_nbytes)}"
    )
    click.echo(f"{result.path} ({result.format})")
    for warning in result.warnings:
        click.echo(f"octobrick: warning: {warning}", err=True)
