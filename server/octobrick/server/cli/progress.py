"""What a long command shows while it runs: a live bar on a terminal, else a line now and then."""

from __future__ import annotations

import time
from types import TracebackType
from typing import TYPE_CHECKING, Self

import click

from octobrick.server.cli.text import format_nbytes, format_seconds

if TYPE_CHECKING:
    from octobrick.measure import MeasureProgress
    from octobrick.store import Progress

_LINE_SECONDS = 10.0  # between plain lines: few enough for a log that is kept


class _Report:
    """A bar or lines on stderr, so that stdout stays for results.

    Args:
        task: what the bar is called until something is done.
        quiet: show nothing.
    """

    def __init__(self, task: str, *, quiet: bool) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, TaskProgressColumn, TextColumn
        from rich.progress import Progress as Bar

        self._quiet = quiet
        self._line_after_seconds = _LINE_SECONDS
        console = Console(stderr=True)
        columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn())
        rates = TextColumn("{task.fields[rates]}")
        self._bar: Bar | None = None
        if console.is_terminal and not quiet:
            self._bar = Bar(*columns, rates, console=console, transient=True)
            self._task = self._bar.add_task(task, total=None, rates="")

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

    def _show(self, phase: str, done: int, total: int, elapsed_seconds: float, rates: str) -> None:
        if self._bar:
            self._bar.update(
                self._task, description=phase, completed=done, total=total, rates=rates
            )
        elif not self._quiet and elapsed_seconds >= self._line_after_seconds:
            self._line_after_seconds = elapsed_seconds + _LINE_SECONDS
            click.echo(f"{phase} {100 * done / total:.0f} %, {rates}", err=True)


class ProgressReport(_Report):
    """Shows the progress of an ingest.

    Args:
        itemsize: bytes of one voxel, which turn voxels into MB.
        quiet: show nothing.
    """

    def __init__(self, itemsize: int, *, quiet: bool) -> None:
        super().__init__("ingest", quiet=quiet)
        self._itemsize = itemsize

    def __call__(self, progress: Progress) -> None:
        """Take note of a moment of the ingest."""
        self._show(
            progress.phase,
            progress.done_voxels,
            progress.total_voxels,
            progress.elapsed_seconds,
            self._rates(progress),
        )

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


class MeasureReport(_Report):
    """Shows how far a measurement is.

    Args:
        quiet: show nothing.
    """

    def __init__(self, *, quiet: bool) -> None:
        super().__init__("measure", quiet=quiet)

    def __call__(self, progress: MeasureProgress) -> None:
        """Take note of a moment of the measurement."""
        eta = progress.eta_seconds
        left = f"{'…' if eta is None else format_seconds(eta)} left"
        rate = progress.coded_voxels_per_second
        rates = f"{rate / 1e6:.1f} Mvoxel/s, {left}" if rate else left
        share = round(1000 * progress.done)
        self._show(progress.phase, share, 1000, progress.elapsed_seconds, rates)


class FrameReport(_Report):
    """Shows how many frames of a movie are done.

    Args:
        total: frames to make.
        quiet: show nothing.
    """

    def __init__(self, total: int, *, quiet: bool) -> None:
        super().__init__("movie", quiet=quiet)
        self._total, self._done = total, 0
        self._started = time.monotonic()

    @property
    def elapsed_seconds(self) -> float:
        """Since the report was made."""
        return time.monotonic() - self._started

    def advance(self) -> None:
        """Take note of another frame."""
        self._done += 1
        elapsed = self.elapsed_seconds
        rate = self._done / elapsed
        left = format_seconds((self._total - self._done) / rate)
        self._show("movie", self._done, self._total, elapsed, f"{rate:.1f} frames/s, {left} left")
