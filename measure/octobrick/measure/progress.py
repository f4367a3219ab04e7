"""How far a measurement is, and when its time is over."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class MeasureProgress:
    """A moment of a measurement.

    Attributes:
        phase: what is being done, for people.
        done: share of all work, 0 to 1, as far as it can be told.
        elapsed_seconds: since it began.
        eta_seconds: what remains at this pace; None until there is one.
        coded_voxels_per_second: voxels that were coded and decoded, over the time since the codes
            began; 0 before.
    """

    phase: str
    done: float
    elapsed_seconds: float
    eta_seconds: float | None
    coded_voxels_per_second: float


MeasureCallback = Callable[[MeasureProgress], None]

CODES_END = 0.45
"""The share of the time after which no further code is begun."""

# Of the time limit. Pictures end before the limit, because one that is begun is finished.
SCAN_END, SWEEP_END, SEARCH_END, PICTURES_END = 0.12, 0.3, CODES_END, 0.9
SWEEP_ALONE_END, SEARCH_ALONE_END = 0.6, 0.85  # where no pictures are drawn
_RATE_SECONDS = 0.5  # before that a rate is chance


class TimeLimit:
    """The time that a measurement may take.

    Args:
        seconds: all of it.
        clock: monotonic, in seconds.
    """

    def __init__(self, seconds: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._seconds = seconds
        self._clock = clock
        self._start = clock()

    @property
    def elapsed_seconds(self) -> float:
        """Since it was made."""
        return self._clock() - self._start

    def over(self, share: float) -> bool:
        """Whether this share of the time has gone by."""
        return self.elapsed_seconds >= share * self._seconds


class ProgressMeter:
    """Turns what the stages say into moments for a callback.

    Args:
        limit: knows the time.
        callback: told of each moment; None tells nobody.
    """

    def __init__(self, limit: TimeLimit, callback: MeasureCallback | None) -> None:
        self._limit = limit
        self._callback = callback
        self._stage = (0.0, 1.0)
        self._codes_start: float | None = None
        self._coded_nvoxels = 0.0

    def stage(self, first: float, last: float) -> None:
        """From now on shares are of this part of all work."""
        self._stage = (first, last)

    def coded(self, nvoxels: float) -> None:
        """So many voxels more were coded and decoded."""
        if self._codes_start is None:
            self._codes_start = self._limit.elapsed_seconds
        self._coded_nvoxels += nvoxels

    def report(self, phase: str, share: float) -> None:
        """Say what is done now, and how much of the stage is."""
        if self._callback is None:
            return
        first, last = self._stage
        done = first + (last - first) * min(max(share, 0.0), 1.0)
        elapsed = self._limit.elapsed_seconds
        since = elapsed - self._codes_start if self._codes_start is not None else 0.0
        self._callback(
            MeasureProgress(
                phase=phase,
                done=done,
                elapsed_seconds=elapsed,
                eta_seconds=elapsed * (1 - done) / done if done > 0.02 else None,
                coded_voxels_per_second=self._coded_nvoxels / since
                if since > _RATE_SECONDS
                else 0.0,
            )
        )
