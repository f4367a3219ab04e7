"""How far an ingest is, how fast it goes and how much memory it takes."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Progress:
    """A moment of an ingest; ``eta_seconds`` is None until a rate is known."""

    phase: str
    done_voxels: int
    total_voxels: int
    elapsed_seconds: float
    voxels_per_second: float
    eta_seconds: float | None
    rss_nbytes: int


ProgressCallback = Callable[[Progress], None]


class ProgressMeter:
    """Counts source voxels and reports them to a callback."""

    def __init__(self, total_voxels: int, callback: ProgressCallback | None) -> None:
        self._total_voxels = total_voxels
        self._callback = callback
        self.begun_at_voxels = self.done_voxels = 0
        self._start_seconds = time.monotonic()

    def begin_at(self, done_voxels: int) -> None:
        """So many voxels were stored by an earlier run; they do not count for the rate."""
        self.begun_at_voxels = self.done_voxels = done_voxels

    @property
    def new_voxels(self) -> int:
        """Stored since the meter began."""
        return self.done_voxels - self.begun_at_voxels

    @property
    def elapsed_seconds(self) -> float:
        """Since the meter was made."""
        return time.monotonic() - self._start_seconds

    def advance(self, nvoxels: int, phase: str) -> None:
        """Note that so many source voxels more are stored, and tell the callback."""
        self.done_voxels += nvoxels
        if self._callback is None:
            return
        elapsed = self.elapsed_seconds
        rate = self.new_voxels / elapsed if elapsed > 0 else 0.0
        eta = (self._total_voxels - self.done_voxels) / rate if rate > 0 else None
        self._callback(
            Progress(
                phase=phase,
                done_voxels=self.done_voxels,
                total_voxels=self._total_voxels,
                elapsed_seconds=elapsed,
                voxels_per_second=rate,
                eta_seconds=eta,
                rss_nbytes=rss_nbytes(),
            )
        )


def rss_nbytes() -> int:
    """Resident memory of this process now; 0 where the system does not tell."""
    return _status_nbytes("VmRSS")


def peak_rss_nbytes() -> int:
    """The most resident memory that this process has had; 0 where the system does not tell.

    Not getrusage: its figure starts at what the parent had when it made this process.
    """
    return _status_nbytes("VmHWM")


def _status_nbytes(field: str) -> int:
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return 0
    kibibytes = next((line.split()[1] for line in lines if line.startswith(f"{field}:")), "0")
    return int(kibibytes) * 1024
