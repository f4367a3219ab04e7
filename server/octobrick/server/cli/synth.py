"""``octobrick synth``: a procedural volume of any size, for those who have no data at hand."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from octobrick.server.cli.stoppable import stoppable
from octobrick.server.cli.text import format_nbytes, format_seconds, format_shape
from octobrick.server.cli.values import numbers

if TYPE_CHECKING:
    from octobrick.store.synth import SynthResult

# As octobrick.store.synth has them, which is not imported for --help; a test compares.
KINDS = ("marschner-lobb", "fractal-noise", "spheres", "blocks", "marble", "wood")
DTYPES = ("uint8", "uint16", "int16", "float32")


@click.command()
@click.argument("kind", type=click.Choice(KINDS))
@click.argument("out", type=click.Path(path_type=Path))
@click.option(
    "--shape",
    metavar="Z,Y,X",
    callback=numbers(int, "256,256,256"),
    required=True,
    help="Voxels along each axis.",
)
@click.option(
    "--dtype", type=click.Choice(DTYPES), default="uint8", show_default=True, help="Sample type."
)
@click.option(
    "--seed", type=int, default=0, show_default=True, help="Chooses among the volumes of a kind."
)
@click.option("--rgb", is_flag=True, help="Colours of marble or wood, (z, y, x, 3), into .npy.")
@click.option("--overwrite", is_flag=True, help="Replace a file that is at OUT already.")
@click.option("--workers", type=int, help="Threads.  [default: one per processor]")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@click.option("--quiet", is_flag=True, help="Print nothing but errors (and JSON, if asked).")
def synth(
    kind: str,
    out: Path,
    shape: tuple[int, int, int],
    dtype: str,
    seed: int,
    rgb: bool,
    overwrite: bool,
    workers: int | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Write a procedural volume of KIND to OUT, NAME.raw (with NAME.raw.json) or NAME.npy.

    The same KIND, shape, type and seed give the same file. Memory holds a few planes, whatever the
    shape. OUT appears when it is complete.
    """
    import numpy as np

    from octobrick.server.cli.progress import ProgressReport
    from octobrick.store.synth import synth as write

    itemsize = np.dtype(dtype).itemsize * (3 if rgb else 1)
    with stoppable(), ProgressReport(itemsize, quiet=quiet) as progress:
        result = write(
            kind,
            shape,
            dtype,
            out,
            seed,
            progress,
            rgb=rgb,
            overwrite=overwrite,
            workers=workers,
        )
    if as_json:
        click.echo(json.dumps(result.to_dict()))
    elif not quiet:
        _print_result(result)


def _print_result(result: SynthResult) -> None:
    click.echo(
        f"{result.path}: {result.kind}, seed {result.seed}, {result.dtype}"
        f"{', RGB' if result.rgb else ''}, {format_shape(result.shape_zyx)} voxels (z×y×x), "
        f"{format_nbytes(result.nbytes)} in {format_seconds(result.elapsed_seconds)}: "
        f"{result.megavoxels_per_second:.0f} Mvoxel/s, peak memory "
        f"{format_nbytes(result.peak_rss_nbytes)}"
    )
