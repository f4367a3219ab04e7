"""``octobrick measure``: what codes and ways of drawing make of the user's own data."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from octobrick.server.cli.measure_text import print_measurement, print_stress
from octobrick.server.cli.source_options import source_options
from octobrick.server.cli.stoppable import stoppable
from octobrick.server.cli.values import numbers, several, size

if TYPE_CHECKING:
    from octobrick.measure import Measurement


@click.command()
@click.argument("source", required=False)
@click.option(
    "--target",
    "targets",
    multiple=True,
    metavar="KIND=VALUE",
    help="What to recommend settings for: psnr=45, max-error=2, ratio=8, bits=3 or fps=10; may "
    "be repeated.  [default: psnr=45]",
)
@click.option("--full", is_flag=True, help="Measure every brick, however long it takes.")
@click.option(
    "--seconds",
    type=float,
    default=180.0,
    show_default=True,
    help="Time limit; what it leaves out is named.",
)
@click.option("--seed", type=int, default=0, show_default=True, help="Of the choice of bricks.")
@click.option(
    "--view",
    "views",
    multiple=True,
    metavar="AZIMUTH,ELEVATION",
    callback=several(numbers(float, "30,15")),
    help="Where pictures are taken from, in degrees; may be repeated.  [default: four views]",
)
@click.option(
    "--size", default="384x384", show_default=True, callback=size, help="Of pictures, in pixels."
)
@click.option("--preset", help="Transfer function.  [default: the first that shows something]")
@click.option("--no-pictures", is_flag=True, help="Measure codes and levels alone.")
@source_options
@click.option(
    "--labels/--no-labels",
    default=None,
    help="Voxels are names, which are kept exactly.  [default: as the source says]",
)
@click.option("--convert", metavar="TYPE", help="Store voxels as TYPE, such as uint16.")
@click.option(
    "--window",
    metavar="LOW,HIGH",
    callback=numbers(float, "0,4095"),
    help="Values that become the ends of the integer TYPE.",
)
@click.option(
    "--replace-nonfinite", type=float, metavar="VALUE", help="What stands for NaN and infinities."
)
@click.option(
    "-o",
    "--output",
    "outputs",
    multiple=True,
    type=click.Path(path_type=Path),
    help="File to write: .html or .json; may be repeated.  [default: NAME.measure.html]",
)
@click.option(
    "--extremes", is_flag=True, help="Tell how far each system keeps its promise, of no SOURCE."
)
@click.option("--json", "as_json", is_flag=True, help="Print all of it as JSON.")
@click.option("--quiet", is_flag=True, help="Print nothing but errors (and JSON, if asked).")
def measure(
    source: str | None,
    outputs: tuple[Path, ...],
    extremes: bool,
    no_pictures: bool,
    as_json: bool,
    quiet: bool,
    **options: Any,
) -> None:
    """Measure what accuracy costs of SOURCE, a file that ingest takes or a volume that it made.

    Codes are tried on bricks that stand for the whole, and pictures of the most telling of them
    compared with the original; a report is written, and settings recommended for a target.
    """
    if extremes:
        _stress(options["seed"], as_json=as_json, quiet=quiet, source=source)
        return
    if source is None:
        raise click.UsageError("Missing argument 'SOURCE'.")
    _require_names(outputs)
    from octobrick import measure as component
    from octobrick.server.cli.progress import MeasureReport

    with stoppable(), MeasureReport(quiet=quiet) as progress:
        found = component.measure(
            source, pictures=not no_pictures, progress=progress, **_known(options)
        )
    name = found.source["name"]
    written = _write(found, outputs or (() if as_json else (Path(f"{name}.measure.html"),)))
    if as_json:
        click.echo(json.dumps(found.to_dict(), allow_nan=False))
    elif not quiet:
        print_measurement(found)
        for path in written:
            click.echo(f"report: {path}")


def _known(options: dict[str, Any]) -> dict[str, Any]:
    """The options as `octobrick.measure.measure` takes them."""
    dtype = options["dtype"]
    return options | {"dtype": dtype or None}


def _require_names(outputs: tuple[Path, ...]) -> None:
    """Before an hour is spent: files must be of a kind that is written, in a folder that is there.

    Raises:
        click.UsageError: they are not.
    """
    for path in outputs:
        if path.suffix not in (".html", ".json"):
            raise click.UsageError(f"{path}: a report is NAME.html or NAME.json.")
        if not path.absolute().parent.is_dir():
            raise click.UsageError(f"{path}: there is no folder {path.parent}.")


def _write(found: Measurement, outputs: tuple[Path, ...]) -> list[Path]:
    for path in outputs:
        if path.suffix == ".json":
            text = json.dumps(found.to_dict(), allow_nan=False, indent=1) + "\n"
        else:
            text = _html(found)
        part = path.with_name(f".{path.name}.part")
        part.write_text(text, encoding="utf-8")
        part.replace(path)
    return list(outputs)


def _html(found: Measurement) -> str:
    import importlib

    # By name, as its packages are an extra, and nobody needs them for JSON.
    report = importlib.import_module("octobrick.measure.report")
    return str(report.report_html(found))


def _stress(seed: int, *, as_json: bool, quiet: bool, source: str | None) -> None:
    """How far each system keeps its promise.

    Raises:
        click.UsageError: a source was given, which says nothing of that.
    """
    if source is not None:
        raise click.UsageError("--extremes measures octobrick itself; give no SOURCE with it.")
    from octobrick.measure import extremes

    rows = extremes.stress(seed=seed)
    if as_json:
        click.echo(json.dumps(extremes.to_dict(rows, seed), allow_nan=False))
    elif not quiet:
        print_stress(rows)
