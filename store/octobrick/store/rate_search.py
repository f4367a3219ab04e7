"""Finds the codec of each level that gives the PSNR or the ratio that was asked for."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass

from octobrick.codec import metrics
from octobrick.codec.errors import InvalidInputError
from octobrick.store.brick_codec import BrickCodec, codec_text
from octobrick.store.brick_encoder import BrickEncoder, EncodedBrick
from octobrick.store.probes import LevelProbes, Probe
from octobrick.store.rate_target import Dial, RateTarget

_STEPS_MAX = 16
_STEP_LEAST = 2e-4  # of the dial
_PSNR_TOLERANCE_DB = 0.1
_RATIO_TOLERANCE = 0.015
# Beyond these a target counts as missed, and the result says so.
_PSNR_PROMISE_DB = 0.5
_RATIO_PROMISE = 0.1


@dataclass(frozen=True, slots=True)
class LevelSize:
    """Of a level in all time steps and channels: its voxels, and the indexes of its shards."""

    nbytes: int
    index_nbytes: int


@dataclass(frozen=True, slots=True)
class Measured:
    """A codec, and what it makes of a level as far as the probes tell."""

    codec: BrickCodec
    psnr_db: float
    ratio: float


@dataclass(frozen=True, slots=True)
class Choice:
    """The codec of a level, and what there is to say of it, if anything."""

    codec: BrickCodec
    note: str | None = None


class RateSearch:
    """Measures codecs of one dial by coding probes and decoding them again.

    Args:
        dial: the codecs to choose from.
        target: what to reach.
        brick: voxels per brick and axis.
        zstd_level_of: of the entropy layer, behind a codec.
        executor: runs the codecs; neither the number of its threads nor their timing matters.
        tick: called after each measurement; what it raises ends the search.
    """

    def __init__(
        self,
        dial: Dial,
        target: RateTarget,
        brick: int,
        zstd_level_of: Callable[[BrickCodec], int],
        executor: Executor,
        tick: Callable[[], None],
    ) -> None:
        self._dial = dial
        self._target = target
        self._brick = brick
        self._zstd_level_of = zstd_level_of
        self._executor = executor
        self._tick = tick

    def levels(self, probes: list[LevelProbes], sizes: list[LevelSize]) -> list[Choice]:
        """A choice for each level; those without probes get that of the coarsest measured one.

        Raises:
            InvalidInputError: level 0 cannot have what was asked for.
        """
        choices: list[Choice] = []
        for level, (own, size) in enumerate(zip(probes, sizes, strict=False)):
            choices.append(self._choose(level, own, size, choices[-1] if choices else None))
        last = choices[-1].codec
        for level in range(len(choices), len(sizes)):
            note = f"level {level}: {codec_text(last)}, as found for level {len(probes) - 1}"
            choices.append(
                Choice(last, f"{note}; coarser levels of a large source are not measured")
            )
        return choices

    def measure(self, codec: BrickCodec, probes: LevelProbes, size: LevelSize) -> Measured:
        """Code and decode all probes of a level."""
        encoder = BrickEncoder(codec, self._brick, self._zstd_level_of(codec))

        def encode(probe: Probe) -> EncodedBrick:
            return encoder.encode(probe.voxels, probe.voxels.min(), probe.voxels.max())

        squares = frames = 0.0
        encoded = self._executor.map(encode, probes.probes)
        for probe, brick in zip(probes.probes, encoded, strict=True):
            squares += probe.weight * brick.errors.sum_squared
            frames += probe.weight * len(brick.frame or b"")
        self._tick()
        itemsize = probes.probes[0].voxels.itemsize
        stored = frames / (probes.nvoxels * itemsize) * size.nbytes + size.index_nbytes
        errors = metrics.ErrorStats(1, 0.0, squares / probes.nvoxels)
        psnr_db = errors.psnr(probes.peak) if squares else math.inf
        return Measured(codec, psnr_db, size.nbytes / stored if frames else math.inf)

    def _choose(
        self, level: int, probes: LevelProbes, size: LevelSize, finer: Choice | None
    ) -> Choice:
        exact = [self.measure(codec, probes, size) for codec in self._dial.exact]
        exact.sort(key=lambda one: -one.ratio)  # stable: of equals the first
        if probes.peak == 0:  # nothing to lose, and S3Dc has no slope for it
            return Choice(exact[0].codec)
        if self._target.kind == "ratio" and exact[0].ratio >= self._target.value:
            return self._kept_exactly(level, exact[0])
        found = self._search(probes, size)
        if found is None:
            return self._without(level, probes, size, exact[0], finer)
        if exact[0].ratio >= found.ratio and self._target.kind == "psnr":
            return Choice(exact[0].codec)  # costs no more
        return Choice(found.codec, self._missed(level, found))

    def _search(self, probes: LevelProbes, size: LevelSize) -> Measured | None:
        """What comes nearest to the target; None where even the extreme does not reach it.

        A PSNR that lies in a gap is exceeded rather than missed.
        """

        def look(position: float) -> Measured:
            return self.measure(self._dial.at(position, probes.peak), probes, size)

        low, high = look(0.0), look(1.0)
        if self._excess(high) < -self._tolerance and self._target.kind == "psnr":
            return None
        if self._excess(low) > self._tolerance:
            return low if self._target.kind == "psnr" else None
        a, b = 0.0, 1.0
        for step in range(_STEPS_MAX):
            if b - a < _STEP_LEAST:
                break  # a gap: many blocks get a bit at once
            middle = (a + b) / 2 if step % 2 else self._guess(a, b, low, high)
            now = look(middle)
            if abs(self._excess(now)) <= self._tolerance:
                return now
            if self._excess(now) < 0:
                a, low = middle, now
            else:
                b, high = middle, now
        return high if self._target.kind == "psnr" else min(low, high, key=self._distance)

    def _guess(self, a: float, b: float, low: Measured, high: Measured) -> float:
        """Where a straight line between two positions meets the target, well inside of them."""
        below, above = -self._excess(low), self._excess(high)
        share = below / (below + above) if below > 0 and math.isfinite(above) else 0.5
        return a + (b - a) * min(max(share, 0.1), 0.9)

    def _excess(self, measured: Measured) -> float:
        """By how much a measurement is finer than the target: in dB, or of the size's logarithm."""
        if self._target.kind == "psnr":
            return measured.psnr_db - self._target.value
        return math.log(self._target.value / measured.ratio)

    def _distance(self, measured: Measured) -> float:
        return abs(self._excess(measured))

    @property
    def _tolerance(self) -> float:
        return _PSNR_TOLERANCE_DB if self._target.kind == "psnr" else _RATIO_TOLERANCE

    # What there is to say

    def _kept_exactly(self, level: int, exact: Measured) -> Choice:
        if exact.ratio <= self._target.value * (1 + _RATIO_PROMISE):
            return Choice(exact.codec)
        return Choice(
            exact.codec,
            f"level {level}: kept exactly, which takes less than {self._target} "
            f"(ratio {exact.ratio:.4g})",
        )

    def _without(
        self,
        level: int,
        probes: LevelProbes,
        size: LevelSize,
        exact: Measured,
        finer: Choice | None,
    ) -> Choice:
        """What to do where the dial does not reach the target."""
        end = self._dial.at(1.0 if self._target.kind == "psnr" else 0.0, probes.peak)
        best = self.measure(end, probes, size)
        name = codec_text(end).partition(";")[0]
        if self._target.kind == "psnr":
            reached = f"level {level}: kept exactly; {name} comes to {best.psnr_db:.1f} dB at most"
            return Choice(exact.codec, f"{reached}, less than {self._target}")
        reached = f"level {level}: {name} comes to a ratio of {best.ratio:.4g} at most"
        if finer is None:
            raise InvalidInputError(
                f"{reached}, not to {self._target.value:g}; ask for less, or store fewer voxels "
                "(--region, a coarser source)",
                reached=best.ratio,
                wanted=self._target.value,
            )
        return Choice(finer.codec, f"{reached}, so it is coded as level {level - 1}")

    def _missed(self, level: int, found: Measured) -> str | None:
        excess = self._excess(found)
        if self._target.kind == "psnr":
            if excess <= _PSNR_PROMISE_DB:
                return None
            return (
                f"level {level}: {found.psnr_db:.1f} dB, the least that {codec_text(found.codec)} "
                f"can be of {self._target} and more"
            )
        if abs(excess) <= math.log1p(_RATIO_PROMISE):
            return None
        return f"level {level}: ratio {found.ratio:.4g} is as near to {self._target} as comes"
