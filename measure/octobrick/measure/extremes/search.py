"""The search for the range in which a promise holds: growing steps outwards, then bisection."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

from octobrick.codec.errors import OctobrickError
from octobrick.measure.extremes.stress_row import StressRow

Check = Callable[[float], float]
"""From a parameter to the value that a promise limits; infinite or NaN where it is broken."""

BISECTIONS = 6


@dataclass(frozen=True, slots=True)
class Promise:
    """What is to be searched.

    Attributes:
        system, implementation, parameter, promise, tolerance: as in `StressRow`.
        check: what is limited, at a parameter. An `OctobrickError` counts as broken.
        start: a parameter that is nothing special.
        low, high: of the parameter; nothing beyond is tried.
        scale: "log" multiplies by growing factors, "linear" adds growing steps, "whole" the same
            with whole numbers.
        steps: to either side, from the start to the end, when all hold.
    """

    system: str
    implementation: str
    parameter: str
    promise: str
    tolerance: float
    check: Check = field(repr=False)
    start: float
    low: float
    high: float
    scale: Literal["log", "linear", "whole"] = "log"
    steps: int = 8


def search(promise: Promise) -> StressRow:
    """The row of a promise.

    Values grow away from the start by exponential steps until one breaks the promise or the end is
    reached; between the last that held and the first that did not, the border is halved. A range
    that is told to hold is one in which nothing that was tried failed: what lies between was not
    tried.
    """
    tried: dict[float, float] = {}
    reasons: dict[float, str] = {}
    holds = _Trial(promise, tried, reasons)
    start = promise.start
    if not holds(start):
        return _row(promise, tried, reasons, None, [start])
    ends, broken = [], []
    for end in (promise.low, promise.high):
        good, bad = _outwards(holds, start, waypoints(promise, end))
        if bad is not None:
            good, bad = _halved(holds, promise.scale, good, bad)
            broken.append(bad)
        ends.append(good)
    return _row(promise, tried, reasons, (ends[0], ends[1]), broken)


def not_run(system: str, parameter: str, promise: str, why: str) -> StressRow:
    """A row of what could not be tried."""
    return StressRow(
        system, "none", parameter, promise, math.nan, None, None, None, None, None, 0,
        f"not run: {why}",
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Trial:
    promise: Promise
    tried: dict[float, float]
    reasons: dict[float, str]

    def __call__(self, at: float) -> bool:
        """Whether the promise holds at a parameter; each is tried once."""
        if at not in self.tried:
            try:
                value = float(self.promise.check(at))
            except OctobrickError as error:
                value, self.reasons[at] = math.inf, f"{error.kind}: {error.message}"
            self.tried[at] = value
        return self.tried[at] <= self.promise.tolerance  # False for NaN


def waypoints(promise: Promise, end: float) -> list[float]:
    """From the start to an end, each step longer than the one before; the end is the last."""
    start, parts = promise.start, []
    total = 2.0**promise.steps - 1
    for i in range(1, promise.steps + 1):
        part = (2.0**i - 1) / total
        parts.append(_between(promise.scale, start, end, part) if part < 1 else end)
    points: list[float] = []
    for point in parts:
        if point != start and point not in points:
            points.append(point)
    return points


def _outwards(holds: _Trial, start: float, points: Sequence[float]) -> tuple[float, float | None]:
    good = start
    for point in points:
        if not holds(point):
            return good, point
        good = point
    return good, None


def _halved(holds: _Trial, scale: str, good: float, bad: float) -> tuple[float, float]:
    """Nearer to the border: the last that holds, and the first that does not."""
    for _ in range(BISECTIONS):
        middle = _between(scale, good, bad, 0.5)
        if middle in (good, bad):
            break
        if holds(middle):
            good = middle
        else:
            bad = middle
    return good, bad


def _between(scale: str, a: float, b: float, part: float) -> float:
    """A parameter some part of the way from a to b."""
    if scale == "log":
        # By logarithms, as ratios of the greatest and the least floats are none.
        at = math.log2(a) + (math.log2(b) - math.log2(a)) * part
        return min(max(a, b), max(min(a, b), 2.0**at if at > -1074 else 5e-324))
    at = a + (b - a) * part
    return float(round(at)) if scale == "whole" else at


def _row(
    promise: Promise,
    tried: dict[float, float],
    reasons: dict[float, str],
    held: tuple[float, float] | None,
    broken: Sequence[float],
) -> StressRow:
    inside = {} if held is None else {a: v for a, v in tried.items() if held[0] <= a <= held[1]}
    worst_at = max(inside, key=lambda at: inside[at]) if inside else None
    return StressRow(
        promise.system,
        promise.implementation,
        promise.parameter,
        promise.promise,
        promise.tolerance,
        (min(tried), max(tried)),
        held,
        None if worst_at is None else inside[worst_at],
        worst_at,
        "; ".join(f"at {at:.4g}: {reasons.get(at) or f'{tried[at]:.4g}'}" for at in broken) or None,
        len(tried),
    )
