"""Measures a source or a volume: codes, levels, pictures, and what follows for the targets."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import math
import os
import platform
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from numpy.typing import DTypeLike

from octobrick.measure import progress as shares
from octobrick.measure.code_sweep import CodeSweep, front
from octobrick.measure.levels import LevelTally
from octobrick.measure.measurement import CodeRow, LevelRow, Measurement, Recommendation, Setting
from octobrick.measure.options import MeasureOptions, SourceOptions
from octobrick.measure.picture_stage import PictureSweep, draw, swept_pictures, worth_drawing
from octobrick.measure.progress import MeasureCallback, ProgressMeter, TimeLimit
from octobrick.measure.recommendation import Advisor, for_frames
from octobrick.measure.reference import Reference, open_reference
from octobrick.measure.sample import Sample, SampleBrick
from octobrick.measure.scan import Scan, scan
from octobrick.measure.settings import swept
from octobrick.measure.target import Target
from octobrick.store import Zyx
from octobrick.store.box import grid_of
from octobrick.store.shard import index_nbytes

DEFAULT_TARGET = Target("psnr", 45.0)
"""Answered where nobody asks for anything: in most pictures hardly to be told from the original."""

_SHARD_BRICKS = 4  # along each side, as an ingest makes shards by default


def measure(
    source: str | os.PathLike[str],
    *,
    targets: Sequence[str] = (),
    full: bool = False,
    seconds: float = 180.0,
    seed: int = 0,
    views: Sequence[tuple[float, float]] = (),
    size: tuple[int, int] = (384, 384),
    preset: str | None = None,
    pictures: bool = True,
    progress: MeasureCallback | None = None,
    shape: Zyx | None = None,
    dtype: DTypeLike | None = None,
    spacing: tuple[float, float, float] | None = None,
    offset: int = 0,
    big_endian: bool = False,
    dataset: str | None = None,
    axes: str | None = None,
    labels: bool | None = None,
    convert: str | None = None,
    window: tuple[float, float] | None = None,
    replace_nonfinite: float | None = None,
    picture_sweep: PictureSweep = swept_pictures,
    clock: Callable[[], float] = time.monotonic,
) -> Measurement:
    """Measure what codes, levels and ways of drawing make of a volume; nothing of it is changed.

    Args:
        source: anything that `octobrick.store.ingest` takes, or a volume that it made, or the
            address of one. Of a lossy volume the reference is what is stored.
        targets: what to recommend settings for: ``"psnr=45"`` (dB), ``"max-error=2"`` (values),
            ``"ratio=8"``, ``"bits=3"`` (a voxel, in memory), ``"fps=10"``; by default ``psnr=45``.
        full: measure every brick instead of a sample. Codes then take the time that they take.
        seconds: what is left of the work when this time is over is skipped, and named. What was
            begun is finished.
        seed: of the sample; the same seed gives the same figures, but for times.
        views: (azimuth, elevation) in degrees; by default four, chosen by the picture sweep.
        size: width and height of pictures.
        preset: of the transfer function; by default one that shows something.
        pictures: draw any.
        progress: called from this thread now and then.
        shape, dtype, spacing, offset, big_endian, dataset, axes, labels, convert, window,
            replace_nonfinite: as for `octobrick.store.ingest`.
        picture_sweep: draws; another for tests.
        clock: monotonic seconds; another for tests.

    Raises:
        InvalidInputError: an option or a target makes no sense.
        NotFiniteError: NaN or ±Inf, and nothing stands for it.
        SourceError, VolumeNotFoundError: or their relatives, as opening and reading raise them.
    """
    options = MeasureOptions.of(
        targets,
        full=full,
        seconds=seconds,
        seed=seed,
        views=tuple(views),
        size=size,
        preset=preset,
        pictures=pictures,
    )
    reading = SourceOptions(
        shape=shape,
        dtype=dtype,
        spacing=spacing,
        offset=offset,
        big_endian=big_endian,
        dataset=dataset,
        axes=axes,
        labels=labels,
        convert=convert,
        window=window,
        replace_nonfinite=replace_nonfinite,
    )
    limit = TimeLimit(seconds, clock)
    with (
        open_reference(os.fspath(source), reading) as reference,
        _workers(options.workers) as executor,
    ):
        meter = ProgressMeter(limit, progress)
        return _Run(reference, options, limit, meter, executor, picture_sweep).run()


@dataclass(slots=True)
class _Codes:
    """What the first half of a run found."""

    rows: list[CodeRow]
    levels: tuple[LevelRow, ...]
    sweep: CodeSweep
    bricks: list[SampleBrick]
    skipped: list[str]


@dataclass(frozen=True, slots=True)
class _Run:
    """One measurement under way."""

    reference: Reference
    options: MeasureOptions
    limit: TimeLimit
    meter: ProgressMeter
    executor: ThreadPoolExecutor
    picture_sweep: PictureSweep

    def run(self) -> Measurement:
        """All stages, the more important the earlier."""
        codes_end = shares.CODES_END if self.options.pictures else 1.0
        self.meter.stage(0.0, 0.1)
        seen = scan(
            self.reference,
            self.executor,
            full=self.options.full,
            over=lambda: self.limit.over(shares.SCAN_END),
            report=lambda share: self.meter.report("looking at bricks", share),
        )
        sample = Sample.of(seen, self.options.seed, full=self.options.full)
        self.meter.stage(0.1, codes_end - 0.08)
        codes = self._codes(seen, sample)
        self.meter.stage(codes_end - 0.08, codes_end)
        advice = self._advice(seen, codes)
        best = front(codes.rows)
        found = Measurement(
            source=self._source(seen),
            options=self.options.to_dict() | {"source_flags": self.reference.options.flags()},
            sample=sample.to_dict(seen),
            machine=machine(self.options.workers),
            codes=tuple(codes.rows),
            levels=codes.levels,
            pictures=(),
            front=best,
            recommendations=(),
            skipped=tuple(codes.skipped),
            elapsed_seconds=0.0,
        )
        self.meter.stage(codes_end, 1.0)
        found = self._with_pictures(found, seen, [advised.setting for advised in advice.values()])
        return dataclasses.replace(
            found,
            recommendations=tuple(
                for_frames(target, self.reference, found.pictures, codes.rows)
                if target.kind == "fps"
                else advice[target]
                for target in self._targets
            ),
            elapsed_seconds=self.limit.elapsed_seconds,
        )

    def _codes(self, seen: Scan, sample: Sample) -> _Codes:
        source = self.reference.source
        sweep = CodeSweep(seen.peak, _index_nbytes(self.reference), self.executor, self.meter.coded)
        tally = LevelTally(source.shape_zyx)
        held: list[SampleBrick] = []

        def groups() -> Iterator[list[SampleBrick]]:
            for group in sample.groups(self.reference, seen, self.executor):
                if not self.reference.labels:
                    tally.add(group)
                if not held:  # of all bricks, those of the first group are kept for searches
                    held.extend(group)
                yield group

        share = shares.SWEEP_END if self.options.pictures else shares.SWEEP_ALONE_END
        rows, skipped = sweep.rows(
            swept(source.dtype, seen.peak, labels=self.reference.labels),
            groups(),
            over=lambda: not self.options.full and self.limit.over(share),
            report=lambda label, done: self.meter.report(f"codes: {label}", done),
        )
        if len(held) < len(sample.weights):  # too many to hold: a sample stands for them
            few = Sample.of(seen, self.options.seed, full=False)
            held = [b for g in few.groups(self.reference, seen, self.executor) for b in g]
        return _Codes(rows, tally.rows(seen.peak), sweep, held, skipped)

    def _advice(self, seen: Scan, codes: _Codes) -> dict[Target, Recommendation]:
        """For all targets but frames; what was measured for them joins the rows."""
        share = shares.SEARCH_END if self.options.pictures else shares.SEARCH_ALONE_END
        advisor = Advisor(
            self.reference,
            seen.nvoxels,
            codes.sweep,
            codes.bricks,
            tuple(codes.rows),
            lambda: not self.options.full and self.limit.over(share),
        )
        advice = {}
        for number, target in enumerate(t for t in self._targets if t.kind != "fps"):
            self.meter.report(f"target {target}", number / len(self._targets))
            advice[target], row = advisor.answer(target)
            known = {row.setting.label for row in codes.rows}
            # Rows are all of the same bricks.
            same = not self.options.full or sum(b.weight == 1 for b in codes.bricks) == seen.nbricks
            if same and row.setting.label not in known:
                codes.rows.append(row)
        return advice

    @property
    def _targets(self) -> tuple[Target, ...]:
        return tuple(dict.fromkeys(self.options.targets)) or (DEFAULT_TARGET,)

    def _with_pictures(
        self, found: Measurement, seen: Scan, recommended: list[Setting]
    ) -> Measurement:
        if not self.options.pictures:
            return found
        if self.reference.labels:
            note = "pictures: labels are kept exactly, so no picture differs"
            return dataclasses.replace(found, skipped=(*found.skipped, note))
        drawn, box, notes = draw(
            self.reference,
            seen,
            worth_drawing(found.codes, found.front, recommended),
            self.options,
            sweep=self.picture_sweep,
            deadline=lambda: self.limit.over(shares.PICTURES_END),
            report=self.meter.report,
        )
        part = {"start_zyx": list(box.start_zyx), "stop_zyx": list(box.stop_zyx)}
        return dataclasses.replace(
            found,
            source=found.source | {"drawn": part},
            pictures=drawn.rows if drawn else (),
            images=drawn.images if drawn else {},
            machine=found.machine | ({"gl_renderer": drawn.gl_renderer} if drawn else {}),
            skipped=(*found.skipped, *notes),
        )

    def _source(self, seen: Scan) -> dict[str, Any]:
        return self.reference.describe() | {
            "value_range": list(seen.value_range),
            "value_range_of": seen.range_of,
            "window": list(seen.window),
            "reference": (
                "voxels of the source"
                if self.reference.volume is None
                else "voxels as the volume stores them"
            ),
        }


@contextmanager
def _workers(count: int) -> Iterator[ThreadPoolExecutor]:
    """Threads for the block; when it fails, or is interrupted, what was not begun is dropped."""
    executor = ThreadPoolExecutor(count, thread_name_prefix="octobrick-measure")
    try:
        yield executor
    finally:
        executor.shutdown(wait=True, cancel_futures=True)


def machine(workers: int) -> dict[str, Any]:
    """What figures of time depend on, JSON-ready."""
    return {
        "processors": workers,
        "architecture": platform.machine(),
        "system": platform.system(),
        "python": ".".join(map(str, sys.version_info[:3])),
        "octobrick": importlib.metadata.version("octobrick"),
        "load": [round(load, 2) for load in os.getloadavg()],
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _index_nbytes(reference: Reference) -> int:
    """Of the indexes of all shards of level 0, as an ingest lays them out by default."""
    source = reference.source
    side = 64 * _SHARD_BRICKS
    nshards = source.nt * source.nc * math.prod(grid_of(source.shape_zyx, (side,) * 3))
    return nshards * index_nbytes(_SHARD_BRICKS**3)
