"""The stress report: all promises, searched one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from octobrick.codec.errors import ResourceError
from octobrick.measure.extremes.deblocking import deblocking_promises
from octobrick.measure.extremes.directions import gradient_promises
from octobrick.measure.extremes.pictures import PICTURE_PROMISES, Scenes, picture_promises
from octobrick.measure.extremes.s3dc import s3dc_promises
from octobrick.measure.extremes.search import Promise, not_run, search
from octobrick.measure.extremes.stress_row import StressRow
from octobrick.measure.extremes.zerobit import zerobit_promises

Progress = Callable[[str, float], None]
"""What is searched next, and the share of promises that are done, 0 to 1."""

COLUMNS = ("system", "parameter", "held", "tested", "worst", "tolerance", "first failure")


def stress(
    seed: int = 0,
    progress: Progress | None = None,
    *,
    make_scenes: Callable[[], Scenes] = Scenes,
) -> tuple[StressRow, ...]:
    """For each system, the widest range of its parameters in which its promises held here.

    The same seed tries the same values; of the same code on the same device the report is the same.
    Takes about half a minute without a GPU. Where there is no OpenGL the renderer's rows say so.

    Args:
        seed: of the data.
        progress: called before each promise.
        make_scenes: what pictures are made with; for tests.
    """
    codecs = [
        *s3dc_promises(seed),
        *zerobit_promises(seed),
        *gradient_promises(seed),
        *deblocking_promises(seed),
    ]
    total = len(codecs) + len(PICTURE_PROMISES)
    rows = list(searched(codecs, progress, 0, total))
    try:
        scenes = make_scenes()
    except ResourceError as error:
        why = f"no OpenGL ({error.kind})"
        rows += [not_run("renderer", parameter, what, why) for parameter, what in PICTURE_PROMISES]
        return tuple(rows)
    with scenes:
        rows += searched(picture_promises(scenes), progress, len(codecs), total)
    return tuple(rows)


def searched(
    promises: Iterable[Promise], progress: Progress | None, done: int, total: int
) -> Iterable[StressRow]:
    """The rows of promises, in their order."""
    for at, promise in enumerate(promises):
        if progress is not None:
            progress(f"{promise.system}: {promise.parameter}", (done + at) / total)
        yield search(promise)


def to_dict(rows: Sequence[StressRow], seed: int = 0) -> dict[str, Any]:
    """JSON-ready: the seed and a list of rows."""
    return {"seed": seed, "rows": [row.to_dict() for row in rows]}


def table_rows(rows: Sequence[StressRow]) -> list[tuple[str, ...]]:
    """Cells of text for a table whose heads are `COLUMNS`."""
    return [
        (
            f"{row.system} ({row.implementation})",
            row.parameter,
            row.note or ("nowhere" if row.held is None else span(row.held)),
            "" if row.tested is None else span(row.tested),
            "" if row.worst is None or row.worst_at is None
            else f"{row.worst:.4g} at {row.worst_at:.4g}",
            "" if row.note else f"{row.tolerance:.4g}",
            row.first_failure or "",
        )
        for row in rows
    ]  # fmt: skip


def span(ends: tuple[float, float]) -> str:
    """Both ends of a range as text."""
    return f"{ends[0]:.4g} … {ends[1]:.4g}"
