"""From what was measured to what to do: the cheapest setting that meets a target."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from octobrick.codec.errors import InvalidInputError
from octobrick.measure.brick_pass import BRICK
from octobrick.measure.code_sweep import CodeSweep, psnr_of
from octobrick.measure.commands import ingest_command, render_command
from octobrick.measure.measurement import CodeRow, PictureRow, Recommendation, Setting
from octobrick.measure.reference import Reference
from octobrick.measure.sample import SampleBrick
from octobrick.measure.settings import (
    FOUND_FAMILIES,
    LOSSLESS,
    bounded_setting,
    found_setting,
    position_of,
    rated_setting,
)
from octobrick.measure.target import Target
from octobrick.store.ingest_options import default_zstd_level
from octobrick.store.probes import LevelProbes, Probe
from octobrick.store.rate_search import LevelSize, RateSearch
from octobrick.store.rate_target import Dial, RateTarget

_PSNR_TOLERANCE_DB = 0.5  # within which an ingest lands
_RATIO_TOLERANCE = 0.02  # relative
_BLOCKS = (4, 8)


class _TimeOverError(Exception):
    """Ends a search; never leaves this module."""


@dataclass(frozen=True, slots=True)
class Advisor:
    """Answers targets of codes.

    Args:
        reference: what was measured.
        nvoxels: of level 0.
        sweep: measures what was not swept.
        bricks: that stand for all.
        rows: of the sweep.
        over: whether no search may go on.
    """

    reference: Reference
    nvoxels: int
    sweep: CodeSweep
    bricks: Sequence[SampleBrick]
    rows: Sequence[CodeRow]
    over: Callable[[], bool]

    def answer(self, target: Target) -> tuple[Recommendation, CodeRow]:
        """What to do for a target other than frames a second, and the figures that say so."""
        if self.reference.labels or self.sweep.peak == 0:
            return self._exactly(target)
        if target.kind == "max-error":
            return self._bounded(target)
        if target.kind == "bits":
            return self._in_memory(target)
        return self._searched(target)

    # Exact

    def _exactly(self, target: Target) -> tuple[Recommendation, CodeRow]:
        """Labels, and volumes of one value, are kept as they are."""
        row = self._lossless
        what = "labels are kept exactly" if self.reference.labels else "all voxels are equal"
        return self._recommend(target, row, self._meets(target, row), what)

    @property
    def _lossless(self) -> CodeRow:
        exact = [row for row in self.rows if row.setting is LOSSLESS]
        return exact[0] if exact else self.sweep.row(LOSSLESS, self.bricks)

    # A bound

    def _bounded(self, target: Target) -> tuple[Recommendation, CodeRow]:
        """The cheapest that cannot exceed it: only a bound that the codec keeps is a promise."""
        settings = [bounded_setting(block, target.value) for block in _BLOCKS]
        rows = [*self._measured(settings), self._lossless]
        best = min(rows, key=lambda row: (row.disk_bits, row.resident_bits))
        if best.setting is LOSSLESS:
            why = "exact voxels take no more than any code with this bound"
        else:
            why = "the codec keeps the bound for every voxel"
        return self._recommend(target, best, True, why)

    def _in_memory(self, target: Target) -> tuple[Recommendation, CodeRow]:
        """The best PSNR of what fits; a rate of a brick and a fixed one are kept by every brick."""
        settings = []
        # A rate is of whole bricks; what the volume lacks of them at its ends counts here, too.
        own = sum(brick.weight * brick.voxels.size for brick in self.bricks)
        share = own / sum(brick.weight * BRICK**3 for brick in self.bricks)
        rate = math.floor(1000 * target.value * share) / 1000
        for block in _BLOCKS:
            try:
                settings.append(rated_setting(block, rate))
            except InvalidInputError:
                continue
        kept = ("S3Dc, fixed", "S3Dc, bits a voxel")
        rows = [row for row in self.rows if row.setting.family.startswith((*kept, "lossless"))]
        rows += self._measured(settings)
        fitting = [row for row in rows if self._meets(target, row)]
        if fitting:
            best = max(fitting, key=lambda row: (psnr_of(row), -row.disk_bits))
            return self._recommend(target, best, True, "the best PSNR of what fits")
        nearest = min(rows, key=lambda row: row.resident_bits)
        return self._recommend(target, nearest, False, "nothing is smaller in memory")

    # A rate that is searched for

    def _searched(self, target: Target) -> tuple[Recommendation, CodeRow]:
        family = self._best_family(target)
        kind: Literal["psnr", "ratio"] = "psnr" if target.kind == "psnr" else "ratio"

        def tick() -> None:
            if self.over():
                raise _TimeOverError

        search = RateSearch(
            Dial(FOUND_FAMILIES[family][0]),
            RateTarget(kind, target.value),
            BRICK,
            default_zstd_level,
            self.sweep.executor,
            tick,
        )
        try:
            codec = search.levels([self._probes], [self._size])[0].codec
        except _TimeOverError:
            return self._estimated(target, family)
        except InvalidInputError:  # a ratio that none of this family has
            nearest = min(self.rows, key=lambda row: row.disk_bits)
            met = self._meets(target, nearest)
            return self._recommend(target, nearest, met, "nothing that was measured is smaller")
        row = self.sweep.row(found_setting(family, kind, target.value, codec), self.bricks)
        met = self._meets(target, row)
        return self._recommend(target, row, met, self._why(target, row, met))

    def _why(self, target: Target, row: CodeRow, met: bool) -> str:
        value = target.value
        if row.psnr_db is None:
            return (
                "exact voxels take no more than what was asked for"
                if met
                else "no code reaches it but exact voxels"
            )
        if not met:
            return "this comes nearest"
        if target.kind == "psnr" and row.psnr_db > value + _PSNR_TOLERANCE_DB:
            return "the code has nothing between this and less than was asked for"
        return "fewest bits on disk of the codes whose rate an ingest finds"

    def _estimated(self, target: Target, family: str) -> tuple[Recommendation, CodeRow]:
        """Without a search, as time is over: between those of the family that were measured."""
        kind = "psnr" if target.kind == "psnr" else "ratio"
        own = [row for row in self.rows if row.setting.family == family and row.psnr_db]
        codec = LOSSLESS.codec
        if own:
            dial = Dial(FOUND_FAMILIES[family][0])
            wanted = target.value if kind == "psnr" else -math.log(target.value)
            points = sorted(
                (
                    psnr_of(row) if kind == "psnr" else -math.log(self._ratio(row)),
                    position_of(row.setting.codec, self.sweep.peak),
                )
                for row in own
            )
            codec = dial.at(_on_the_line(wanted, points), self.sweep.peak)
        row = self.sweep.row(found_setting(family, kind, target.value, codec), self.bricks)
        # An ingest keeps exactly what no code has the PSNR for; a ratio it may have to refuse.
        met = kind == "psnr" or any(self._meets(target, one) for one in (*own, row))
        why = "time was over before its rate was found, so the figures are of one near it"
        return self._recommend(target, row, met, f"{why}; the ingest finds it")

    def _best_family(self, target: Target) -> str:
        """Whose curve has the fewest bits at the PSNR, or the best PSNR at the ratio."""

        def cost(family: str) -> float:
            points = sorted(
                (row.psnr_db, row.disk_bits)
                for row in self.rows
                if row.setting.family == family and row.psnr_db is not None
            )
            if not points:
                return math.inf
            psnrs, bits = np.array(points).T
            if target.kind == "psnr":
                if target.value > psnrs[-1]:
                    # Beyond what was measured, on at the pace of a bit for 6 dB.
                    return float(bits[-1] + (target.value - psnrs[-1]) / 6.02)
                return float(np.interp(target.value, psnrs, bits))
            wanted = self._itembits / target.value
            if wanted < bits.min():
                return float(bits.min() - wanted)  # above 0, and PSNRs count as less
            return -float(np.interp(wanted, np.maximum.accumulate(bits), psnrs))

        # Zerobit takes 20 times as long to decode, so it must be worth it: ties go to the first.
        return min(FOUND_FAMILIES, key=cost)

    # Inside

    @property
    def _itembits(self) -> int:
        return 8 * self.reference.source.dtype.itemsize

    @property
    def _probes(self) -> LevelProbes:
        probes = tuple(Probe(brick.voxels, brick.weight) for brick in self.bricks)
        return LevelProbes(probes, self.sweep.peak, self.nvoxels, whole=True)

    @property
    def _size(self) -> LevelSize:
        return LevelSize(self.nvoxels * self._itembits // 8, self.sweep.index_nbytes)

    def _ratio(self, row: CodeRow) -> float:
        return self._itembits / row.disk_bits if row.disk_bits else math.inf

    def _meets(self, target: Target, row: CodeRow) -> bool:
        match target.kind:
            case "psnr":
                return psnr_of(row) >= target.value - _PSNR_TOLERANCE_DB
            case "max-error":
                return row.max_error <= target.value
            case "ratio":
                return self._ratio(row) >= target.value * (1 - _RATIO_TOLERANCE)
            case _:
                return row.resident_bits <= target.value

    def _measured(self, settings: Sequence[Setting]) -> list[CodeRow]:
        """Rows of settings, those that were swept as they are; none of what cannot be coded."""
        known = {row.setting.label: row for row in self.rows}
        rows = []
        for setting in settings:
            try:
                rows.append(known.get(setting.label) or self.sweep.row(setting, self.bricks))
            except InvalidInputError:
                continue
        return rows

    def _recommend(
        self, target: Target, row: CodeRow, met: bool, why: str
    ) -> tuple[Recommendation, CodeRow]:
        setting = row.setting
        reason = f"{setting.label}: {figures(row, self._ratio(row))}; {why}"
        command = ingest_command(self.reference, setting)
        return Recommendation(str(target), met, setting, reason, command), row


def _on_the_line(wanted: float, points: Sequence[tuple[float, float]]) -> float:
    """The position of a dial between those of ascending points, or beyond them as they go on."""
    xs, ys = np.array(points).T
    at = float(np.interp(wanted, xs, ys))
    if len(xs) > 1 and not xs[0] <= wanted <= xs[-1]:
        i, j = (0, 1) if wanted < xs[0] else (-2, -1)
        if xs[j] > xs[i]:
            at = float(ys[i] + (wanted - xs[i]) * (ys[j] - ys[i]) / (xs[j] - xs[i]))
    return min(max(at, 0.0), 1.0)


def for_frames(
    target: Target, reference: Reference, pictures: Sequence[PictureRow], codes: Sequence[CodeRow]
) -> Recommendation:
    """The best picture of those that are drawn in time; where none is, the fastest.

    Args:
        target: frames a second.
        reference: what was measured.
        pictures: all that were drawn.
        codes: measured, the first of which stands in where nothing was drawn.
    """
    bits = {row.setting.label: row.disk_bits for row in codes}

    def quality(row: PictureRow) -> tuple[float, float]:
        psnr_db = math.inf if row.psnr_db is None else row.psnr_db
        return psnr_db, -bits.get(row.setting.label, math.inf)

    if not pictures:
        setting = codes[0].setting
        reason = "no picture was drawn, so nothing is known of frames a second"
        return Recommendation(
            str(target), False, setting, reason, ingest_command(reference, setting)
        )
    in_time = [row for row in pictures if row.frame_seconds * target.value <= 1]
    best = (
        max(in_time, key=quality) if in_time else min(pictures, key=lambda row: row.frame_seconds)
    )
    psnr = "no difference" if best.psnr_db is None else f"{best.psnr_db:.1f} dB"
    what = "the best picture in time" if in_time else "the fastest; nothing is drawn in time"
    reason = (
        f"{best.setting.label}, {best.path}: {1 / max(best.frame_seconds, 1e-9):.1f} frames a "
        f"second here, pictures {psnr} from the uncompressed; {what}"
    )
    gradients = "stored" in best.render_flags
    return Recommendation(
        target=str(target),
        met=bool(in_time),
        setting=best.setting,
        reason=reason,
        ingest_command=ingest_command(reference, best.setting, gradients=gradients),
        render_command=render_command(reference, best.render_flags),
    )


def figures(row: CodeRow, ratio: float) -> str:
    """A row in a sentence's part."""
    quality = "exact" if row.psnr_db is None else f"{row.psnr_db:.1f} dB"
    smaller = f", {ratio:.1f} times smaller" if math.isfinite(ratio) else ""
    return (
        f"{quality}, largest error {row.max_error:.4g}, {row.disk_bits:.2f} bits a voxel on disk"
        f"{smaller}, {row.resident_bits:.2f} in memory"
    )
