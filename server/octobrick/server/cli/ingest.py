"""``octobrick ingest``: from a file that people have to a volume of compressed bricks."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from octobrick.server.cli.failure import EXIT_INTERRUPTED
from octobrick.server.cli.stoppable import stoppable
from octobrick.server.cli.text import (
    format_nbytes,
    format_psnr,
    format_ratio,
    format_seconds,
    format_shape,
    print_table,
)
from octobrick.server.cli.values import numbers

if TYPE_CHECKING:
    from octobrick.codec import S3dc
    from octobrick.store import IngestResult


@click.command()
@click.argument("source", type=click.Path(path_type=Path))
@click.argument("dest", type=click.Path(path_type=Path))
@click.option(
    "--codec",
    type=click.Choice(["s3dc", "lossless"]),
    default="s3dc",
    show_default=True,
    help="How bricks are compressed before zstd.",
)
@click.option("--bits", type=int, help="Bits of an S3Dc index, 1 to 8.  [default: 4]")
@click.option("--block", type=int, help="Voxels along each side of an S3Dc block.  [default: 8]")
@click.option(
    "--brick", type=int, default=64, show_default=True, help="Voxels along each side of a brick."
)
@click.option("--levels", type=int, help="Levels of the pyramid.  [default: until one brick]")
@click.option(
    "--shape", metavar="Z,Y,X", callback=numbers(int, "64,512,512"), help="Voxels of a raw file."
)
@click.option("--dtype", help="Sample type of a raw file, such as uint16.")
@click.option(
    "--spacing",
    metavar="Z,Y,X",
    callback=numbers(float, "1.5,0.9,0.9"),
    help="Voxel size, where the file does not say it.",
)
@click.option(
    "--offset", type=int, default=0, show_default=True, help="Bytes before a raw file's voxels."
)
@click.option("--big-endian", is_flag=True, help="Byte order of a raw file.")
@click.option(
    "--replace-nonfinite", type=float, metavar="VALUE", help="What stands for NaN and infinities."
)
@click.option("--overwrite", is_flag=True, help="Replace a volume that is at DEST already.")
@click.option("--workers", type=int, help="Encoding threads.  [default: one per processor]")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@click.option("--quiet", is_flag=True, help="Print nothing but errors (and JSON, if asked).")
def ingest(
    source: Path,
    dest: Path,
    codec: str,
    bits: int | None,
    block: int | None,
    as_json: bool,
    quiet: bool,
    **options: Any,
) -> None:
    """Compress the volume in the file SOURCE into the folder DEST (by custom NAME.zarr).

    SOURCE is NIfTI, NRRD, MetaImage, NumPy, or raw with --shape and --dtype. DEST appears when it
    is complete; an ingest that fails or is interrupted leaves nothing behind.
    """
    from octobrick import store
    from octobrick.server.cli.progress import ProgressReport

    chosen = _codec(codec, bits, block)
    try:
        with stoppable():
            itemsize = _announce(source, options, quiet=quiet or as_json)
            with ProgressReport(itemsize, quiet=quiet) as progress:
                result = store.ingest(source, dest, codec=chosen, progress=progress, **options)
    except KeyboardInterrupt:
        click.echo(f"octobrick: interrupted; {_remains(dest)}", err=True)
        raise click.exceptions.Exit(EXIT_INTERRUPTED) from None
    if as_json:
        click.echo(json.dumps(result.to_dict()))
    elif not quiet:
        _print_result(result)


def _codec(name: str, bits: int | None, block: int | None) -> S3dc | None:
    from octobrick.codec import S3dc

    if name == "s3dc":
        side = 8 if block is None else block
        return S3dc(block=(side, side, side), bits=4 if bits is None else bits)
    if bits is not None or block is not None:
        raise click.UsageError("--bits and --block describe S3Dc; leave them out with lossless.")
    return None


def _announce(source: Path, options: dict[str, Any], *, quiet: bool) -> int:
    """Say what is in the source; returns the bytes of a voxel."""
    from octobrick.store.sources import open_source

    with open_source(
        source,
        shape_zyx=options["shape"],
        dtype=options["dtype"],
        spacing_zyx=options["spacing"],
        offset_nbytes=options["offset"],
        big_endian=options["big_endian"],
    ) as opened:
        itemsize = opened.dtype.itemsize
        if not quiet:
            shape_zyx = opened.shape_zyx
            click.echo(
                f"{source.name}: {opened.format}, {opened.dtype}, {format_shape(shape_zyx)} voxels "
                f"(z×y×x), {format_nbytes(math.prod(shape_zyx) * itemsize)}"
            )
        return itemsize


def _remains(dest: Path) -> str:
    from octobrick.store.destination import partial_path

    partial = partial_path(dest)
    if partial.exists():
        return f"{partial} could not be removed, and can be"
    return f"nothing was left behind at {dest}"


def _print_result(result: IngestResult) -> None:
    print_table(
        ("level", "z×y×x", "size", "stored", "ratio", "PSNR", "max error"),
        (
            (
                str(level.index),
                format_shape(level.shape_zyx),
                format_nbytes(level.nbytes),
                format_nbytes(level.stored_nbytes),
                format_ratio(level.nbytes, level.stored_nbytes),
                format_psnr(level.psnr_db),
                f"{level.max_error:g}",
            )
            for level in result.levels
        ),
    )
    nbytes = sum(level.nbytes for level in result.levels)
    stored_nbytes = sum(level.stored_nbytes for level in result.levels)
    click.echo(
        f"{format_nbytes(nbytes)} in {len(result.levels)} levels became "
        f"{format_nbytes(stored_nbytes)}, {format_ratio(nbytes, stored_nbytes)} times smaller, in "
        f"{format_seconds(result.elapsed_seconds)}: {result.megabytes_per_second:.0f} MB/s, peak "
        f"memory {format_nbytes(result.peak_rss_nbytes)}"
    )
    click.echo(f"{result.path} (revision {result.revision})")
    for warning in result.warnings:
        click.echo(f"octobrick: warning: {warning}", err=True)
