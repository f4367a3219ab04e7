"""What a long command shows while it runs: a live bar on a terminal, else a line now and then."""

from __future__ import annotations

from types import TracebackType
from typing import TYPE_CHECKING, Self

import click

from octobrick.server.cli.text import format_nbytes, format_seconds

if TYPE_CHECKING:
    from octobrick.store import Progress

_LINE_SECONDS = 10.0  # between plain lines: few enough for a log that is kept


class ProgressReport:
    """Shows the progress of an ingest on stderr, so that stdout stays for results.

    Args:
        itemsize: bytes of one voxel, which turn voxels into MB.
        quiet: show nothing.
    """

    def __init__(self, itemsize: int, *, quiet: bool) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, TaskProgressColumn, TextColumn
        from rich.progress import Progress as Bar

        self._itemsize = itemsize
        self._quiet = quiet
        self._line_after_seconds = _LINE_SECONDS
        console = Console(stderr=True)
        columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn())
        rates = TextColumn("{task.fields[rates]}")
        self._bar: Bar | None = None
        if console.is_terminal and not quiet:
            self._bar = Bar(*columns, rates, console=console, transient=True)
            self._task = self._bar.add_task("ingest", total=None, rates="")

    def __enter__(self) -> Self:
        if self._bar:
            self._bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._bar:
            self._bar.stop()

    def __call__(self, progress: Progress) -> None:
        """Take note of a moment of the ingest."""
        if self._bar:
            self._bar.update(
                self._task,
                description=progress.phase,
                completed=progress.done_voxels,
                total=progress.total_voxels,
                rates=self._rates(progress),
            )
        elif not self._quiet and progress.elapsed_seconds >= self._line_after_seconds:
            self._line_after_seconds = progress.elapsed_seconds + _LINE_SECONDS
            percent = 100 * progress.done_voxels / progress.total_voxels
            click.echo(f"{progress.phase} {percent:.0f} %, {self._rates(progress)}", err=True)

    def _rates(self, progress: Progress) -> str:
        voxels_per_second = progress.voxels_per_second
        eta = progress.eta_seconds
        return ", ".join(
            (
                f"{voxels_per_second * self._itemsize / 1e6:.0f} MB/s",
                f"{voxels_per_second / 1e6:.0f} Mvoxel/s",
                f"{'…' if eta is None else format_seconds(eta)} left",
                f"{format_nbytes(progress.rss_nbytes)} in memory",
            )
        )
