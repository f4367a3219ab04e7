"""Codes the sampled bricks with one setting after the other."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial

from octobrick.codec.errors import InvalidInputError
from octobrick.measure.code_row import CodedBrick, CodeTally, code_brick
from octobrick.measure.measurement import CodeRow, Setting
from octobrick.measure.sample import SampleBrick
from octobrick.measure.settings import is_found, named_by_psnr
from octobrick.store.brick_encoder import is_fill
from octobrick.store.in_order import in_order

_TIMED_BRICKS = 5  # a setting's rates are medians of so many
_AHEAD_BRICKS = 4
_PSNR_LEAST_DB = 1.0  # an ingest can be asked for no less


@dataclass(frozen=True, slots=True)
class CodeSweep:
    """Measures settings, each on the same bricks.

    Args:
        peak: greatest less least voxel of the whole volume.
        index_nbytes: of level 0's shards beside their bricks.
        executor: codes bricks.
        coded: told how many voxels were coded.
    """

    peak: float
    index_nbytes: int
    executor: Executor
    coded: Callable[[float], None]

    def rows(
        self,
        settings: Sequence[Setting],
        groups: Iterable[list[SampleBrick]],
        *,
        over: Callable[[], bool],
        report: Callable[[str, float], None],
    ) -> tuple[list[CodeRow], list[str]]:
        """A row for each setting, and what is to be said of those that have none.

        Args:
            settings: the more important the earlier.
            groups: all bricks, some at a time.
            over: whether time is; the first setting is measured all the same, and of several
                groups all, since a setting that saw half of them would stand for nothing.
            report: told what is coded, and what share is done of a group.
        """
        tallies = {setting.label: CodeTally(setting) for setting in settings}
        skipped: dict[str, str] = {}
        for number, group in enumerate(groups):
            timed = _timed(group) if number == 0 else set()
            for rank, setting in enumerate(settings):
                if setting.label in skipped:
                    continue
                if rank and number == 0 and over():
                    skipped |= {s.label: "time" for s in settings[rank:]}
                    break
                report(setting.label, rank / len(settings))
                try:
                    self._code(tallies[setting.label], group, timed)
                except InvalidInputError as error:  # such as a rate that end points exceed
                    skipped[setting.label] = f"{setting.label}: {error.message}"
        rows = [
            tally.row(self.peak, self.index_nbytes)
            for label, tally in tallies.items()
            if label not in skipped
        ]
        late = [label for label, why in skipped.items() if why == "time"]
        notes = [why for why in skipped.values() if why != "time"]
        if late:
            notes.append(f"codes that the time limit left out: {'; '.join(late)}")
        return named(rows), notes

    def row(self, setting: Setting, bricks: Sequence[SampleBrick]) -> CodeRow:
        """The figures of one setting.

        Raises:
            InvalidInputError: its codec cannot code these voxels.
        """
        tally = CodeTally(setting)
        self._code(tally, bricks, _timed(bricks))
        return tally.row(self.peak, self.index_nbytes)

    def _code(self, tally: CodeTally, bricks: Sequence[SampleBrick], timed: set[int]) -> None:
        codec = tally.setting.codec
        done: dict[int, CodedBrick] = {}
        for i in sorted(timed):  # alone, so that they are timed alone
            done[i] = code_brick(codec, bricks[i].voxels, self.peak)
        rest = [i for i in range(len(bricks)) if i not in timed]
        calls = (partial(code_brick, codec, bricks[i].voxels, self.peak) for i in rest)
        done |= zip(rest, in_order(self.executor, calls, _AHEAD_BRICKS), strict=True)
        for i, sampled in enumerate(bricks):  # in order: sums of floats depend on it
            tally.add(done[i], sampled.weight, timed=i in timed)
        self.coded(sum(brick.coded_nvoxels for brick in done.values()))


def named(rows: Sequence[CodeRow]) -> list[CodeRow]:
    """Rows with their final labels; of settings that are found, those that tell something new."""
    kept: dict[str, CodeRow] = {}
    for row in rows:
        if is_found(row.setting):
            if row.psnr_db is None or not row.psnr_db >= _PSNR_LEAST_DB:
                continue  # exact, which others are for less, or no more than noise
            row = CodeRow(
                named_by_psnr(row.setting, row.psnr_db),
                *(getattr(row, name) for name in itertools.islice(CodeRow.__slots__, 1, None)),
            )
        kept.setdefault(row.setting.label, row)
    return list(kept.values())


def front(rows: Sequence[CodeRow]) -> tuple[str, ...]:
    """Labels of the settings that none beats in bits on disk and PSNR, fewest bits first.

    One beats another if it is no worse in both and better in one; of equals all stay.
    """
    points = [(row.disk_bits, psnr_of(row)) for row in rows]

    def beaten(bits: float, psnr_db: float) -> bool:
        return any(b <= bits and p >= psnr_db and (b < bits or p > psnr_db) for b, p in points)

    kept = [row for row in rows if not beaten(row.disk_bits, psnr_of(row))]
    return tuple(row.setting.label for row in sorted(kept, key=lambda row: row.disk_bits))


def psnr_of(row: CodeRow) -> float:
    """In dB; infinite where nothing was lost."""
    return math.inf if row.psnr_db is None else row.psnr_db


def _timed(bricks: Sequence[SampleBrick]) -> set[int]:
    """Which bricks are coded alone: some of those that are coded at all, spread over the sample."""
    present = [i for i, brick in enumerate(bricks) if not is_fill(brick.voxels)]
    count = min(_TIMED_BRICKS, len(present))
    return {present[(2 * k + 1) * len(present) // (2 * count)] for k in range(count)}
