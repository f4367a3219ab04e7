"""Processes as the kernel sees them: a tree's memory and descriptors, and whether they grow."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from pathlib import Path


def children(pid: int) -> list[int]:
    """The processes that one started, as they are now."""
    found: list[int] = []
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        try:
            found += [int(word) for word in task.read_text(encoding="ascii").split()]
        except OSError:
            continue
    return found


def descendants(pid: int) -> list[int]:
    """All processes below one, as they are now."""
    found = []
    for child in children(pid):
        found += [child, *descendants(child)]
    return found


def command_of(pid: int) -> str:
    """A process's command line; empty where it is gone."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    except OSError:
        return ""


def resident_nbytes(pid: int) -> int:
    """Anonymous memory, private and shared; pages of files can be taken back and do not count."""
    nbytes = 0
    try:
        for line in Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines():
            if line.startswith(("RssAnon:", "RssShmem:")):
                nbytes += int(line.split()[1]) * 1024
    except OSError:
        return 0
    return nbytes


def descriptors(pid: int) -> int:
    """Open files, sockets and pipes."""
    try:
        return sum(1 for _ in Path(f"/proc/{pid}/fd").iterdir())
    except OSError:
        return 0


def growth(samples: Sequence[tuple[float, float]]) -> dict[str, float]:
    """Medians of the second and the last quarter of (seconds, value), and the slope between.

    The first quarter, in which caches fill, does not count.
    """
    quarter = max(1, len(samples) // 4)
    second, last = samples[quarter : 2 * quarter] or samples, samples[-quarter:]
    early, late = (statistics.median(value for _, value in part) for part in (second, last))
    apart = statistics.median(t for t, _ in last) - statistics.median(t for t, _ in second)
    return {
        "second_quarter": early,
        "last_quarter": late,
        "slope_per_minute": 60 * (late - early) / apart if apart > 0 else 0.0,
    }
