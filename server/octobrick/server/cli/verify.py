"""``octobrick verify``: whether a volume is what was written, and how to make it so again."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import click

from octobrick.server.cli.failure import EXIT_FAILED
from octobrick.server.cli.source_options import camera_options, open_given, source_options
from octobrick.server.cli.text import format_nbytes, format_seconds

if TYPE_CHECKING:
    from octobrick.server.cli.progress import ProgressReport
    from octobrick.store.repair import RepairResult
    from octobrick.store.verify import Problem, VerifyReport

_ROWS_MAX = 50  # of problems on a terminal; --json has them all


@click.command()
@click.argument("volume")
@click.option("--source", metavar="SOURCE", help="Compare every brick with this source, too.")
@click.option("--repair", metavar="SOURCE", help="Write damaged shards anew from this source.")
@source_options
@camera_options
@click.option(
    "--replace-nonfinite", type=float, metavar="VALUE", help="What stood for NaN and infinities."
)
@click.option("--workers", type=int, help="Threads.  [default: one per processor]")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@click.option("--quiet", is_flag=True, help="Print nothing but errors (and JSON, if asked).")
def verify(
    volume: str,
    source: str | None,
    repair: str | None,
    as_json: bool,
    quiet: bool,
    **options: Any,
) -> None:
    """Check every shard, brick and range of VOLUME; exit code 1 if something is not as written."""
    from octobrick.server.cli.progress import ProgressReport

    if source is not None and repair is not None:
        raise click.UsageError("--repair checks what it writes; leave out --source.")
    with ProgressReport(1, quiet=quiet) as progress:
        if repair is not None:
            mended = _repair(volume, repair, options, progress)
            _tell_repair(mended, as_json=as_json, quiet=quiet)
            problems = mended.left
        else:
            report = _verify(volume, source, options, progress)
            _tell_report(report, as_json=as_json, quiet=quiet)
            problems = report.problems
    if problems:
        raise click.exceptions.Exit(EXIT_FAILED)


def _verify(
    volume: str, source: str | None, options: dict[str, Any], progress: ProgressReport
) -> VerifyReport:
    from octobrick.store.verify import verify
    from octobrick.store.verify_source import verify_against

    if source is None:
        return verify(volume, workers=options["workers"], progress=progress)
    with open_given(source, options) as opened:
        return verify_against(volume, opened, **_of_run(options), progress=progress)


def _repair(
    volume: str, source: str, options: dict[str, Any], progress: ProgressReport
) -> RepairResult:
    from octobrick.store.repair import repair

    with open_given(source, options) as opened:
        return repair(volume, opened, **_of_run(options), progress=progress)


def _of_run(options: dict[str, Any]) -> dict[str, Any]:
    """The options that are not of the source."""
    return {name: options[name] for name in ("replace_nonfinite", "workers")}


def _tell_report(report: VerifyReport, *, as_json: bool, quiet: bool) -> None:
    if as_json:
        click.echo(json.dumps(report.to_dict()))
    elif not quiet:
        _print_problems(report.problems)
        against = ", equal to the source" if report.against_source and report.sound else ""
        state = f"sound{against}" if report.sound else f"{len(report.problems)} problems"
        click.echo(
            f"{report.path}: {state}; {report.shards} shards, {report.bricks} bricks, "
            f"{format_nbytes(report.nbytes)} in {format_seconds(report.elapsed_seconds)}"
        )


def _tell_repair(result: RepairResult, *, as_json: bool, quiet: bool) -> None:
    if as_json:
        click.echo(json.dumps(result.to_dict()))
    elif not quiet:
        _print_problems(result.left)
        click.echo(
            f"{len(result.repaired)} shards written anew, {len(result.removed)} stray files "
            f"removed, {len(result.left)} problems left"
            + ("; ingest the volume again to mend those" if result.left else "")
        )


def _print_problems(problems: tuple[Problem, ...]) -> None:
    for problem in problems[:_ROWS_MAX]:
        click.echo(f"{problem.kind}: {problem.path}: {problem.message}")
    if len(problems) > _ROWS_MAX:
        click.echo(f"… and {len(problems) - _ROWS_MAX} more (--json lists all)")
