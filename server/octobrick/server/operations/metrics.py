"""What a process counts: requests as they pass, and what its parts say of themselves.

The counts are plain numbers of the event loop's thread, a microsecond for a request. They become
Prometheus's text only when somebody asks (`metrics_text.py`); the counts of several processes are
added then (`metrics_folder.py`), which is why everything here fits in JSON.
"""

from __future__ import annotations

import logging
import re
from bisect import bisect_left
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

logger = logging.getLogger(__name__)

Kind = Literal["counter", "gauge", "histogram"]
# Numbers by metric and label values: one of a counter or gauge; of a histogram its sum, then how
# many fell into each bucket.
Counts = dict[str, dict[tuple[str, ...], list[float]]]

# Upper ends of the buckets, in seconds: from a brick out of the page cache to a slow picture.
BUCKETS_SECONDS = (
    *(0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5),
    *(1.0, 2.5, 5.0, 10.0, 30.0, 60.0),
)
_STAGE = re.compile(r"\s*(queue|render|encode|select|read)\s*;\s*dur=([0-9.]{1,12})\s*")
_PART_NAME = re.compile(r"[a-z][a-z0-9_]*")


@dataclass(frozen=True, slots=True)
class Family:
    """What one metric is."""

    kind: Kind
    help: str
    labels: tuple[str, ...] = ()


OWN_FAMILIES = {
    "octobrick_requests": Family(
        "counter", "Requests that ended, by what they were answered.", ("route", "method", "status")
    ),
    "octobrick_sent_bytes": Family("counter", "Body bytes of answers.", ("route",)),
    "octobrick_request_seconds": Family(
        "histogram", "From a request's headers to the last byte of its answer.", ("route",)
    ),
    "octobrick_errors": Family("counter", "Errors that were answered, by kind.", ("kind",)),
    "octobrick_stage_seconds": Family(
        "histogram", "Steps of answers, as their Server-Timing header has them.", ("stage",)
    ),
}


class Metrics:
    """The counts of one process. For the event loop's thread alone."""

    def __init__(self) -> None:
        # The status is 0 where the client left before it was answered.
        self._requests: dict[tuple[str, str, int], list[float]] = {}
        self._sent: dict[str, list[float]] = {}
        self._seconds: dict[str, list[float]] = {}
        self._errors: dict[str, list[float]] = {}
        self._stages: dict[str, list[float]] = {}
        self._parts: dict[str, Callable[[], Mapping[str, float]]] = {}

    def count_request(
        self, route: str, method: str, status: int, nbytes: int, seconds: float
    ) -> None:
        """Count a request that ended. The labels are few: they never come from a client."""
        key = (route, method, status)
        count = self._requests.get(key)
        if count is None:
            count = self._requests[key] = [0]
            self._sent.setdefault(route, [0])
        count[0] += 1
        self._sent[route][0] += nbytes
        _observe(self._seconds, route, seconds)

    def count_error(self, kind: str) -> None:
        """Count an error that was answered."""
        self._errors.setdefault(kind, [0])[0] += 1

    def count_stages(self, server_timing: str) -> None:
        """Count the steps in a Server-Timing header of ours, ``name;dur=milliseconds, …``."""
        for item in server_timing.split(","):
            match = _STAGE.fullmatch(item)
            if match is not None:
                _observe(self._stages, match[1], float(match[2]) / 1e3)

    def wire(self, part: str, stats: Callable[[], Mapping[str, float]]) -> None:
        """Let a part of the server tell its own numbers whenever metrics are asked for.

        ``{"queued": 3, "crashes_total": 1}`` of part ``render`` become the gauge
        ``octobrick_render_queued`` and the counter ``octobrick_render_crashes_total``. The part
        ``process`` has no prefix: its names are Prometheus's own.

        Args:
            part: lower-case word.
            stats: called in the event loop's thread, so it must not wait for anything.
        """
        assert _PART_NAME.fullmatch(part), part
        self._parts[part] = stats

    def counts(self) -> Counts:
        """All numbers as they are now."""
        counts: Counts = {
            "octobrick_requests": {(r, m, str(s)): n for (r, m, s), n in self._requests.items()},
            "octobrick_sent_bytes": {(route,): n for route, n in self._sent.items()},
            "octobrick_request_seconds": {(route,): n for route, n in self._seconds.items()},
            "octobrick_errors": {(kind,): n for kind, n in self._errors.items()},
            "octobrick_stage_seconds": {(stage,): n for stage, n in self._stages.items()},
        }
        for part, stats in self._parts.items():
            prefix = "process_" if part == "process" else f"octobrick_{part}_"
            try:
                numbers = stats()
            except Exception:  # a number that cannot be had must not hide all others
                logger.exception("the numbers of %s cannot be had", part)
                continue
            for name, number in numbers.items():
                counts[prefix + name] = {(): [float(number)]}
        return counts


def family_of(name: str) -> Family:
    """What a metric is; one of a part is a counter where its name says ``_total``."""
    if name in OWN_FAMILIES:
        return OWN_FAMILIES[name]
    kind: Kind = "counter" if name.endswith("_total") else "gauge"
    return Family(kind, f"See {name} in docs of operations.")


def added(all_counts: Iterable[Counts]) -> Counts:
    """The sum of the counts of several processes."""
    total: Counts = {}
    for counts in all_counts:
        for name, samples in counts.items():
            sums = total.setdefault(name, {})
            for labels, numbers in samples.items():
                before = sums.get(labels, [0.0] * len(numbers))
                sums[labels] = [a + b for a, b in zip(before, numbers, strict=True)]
    return total


def without_gauges(counts: Counts) -> Counts:
    """What stays true of a process that has ended: what it counted, not what it had."""
    return {name: s for name, s in counts.items() if family_of(name).kind != "gauge"}


def _observe(histograms: dict[str, list[float]], key: str, seconds: float) -> None:
    histogram = histograms.get(key)
    if histogram is None:
        histogram = histograms[key] = [0.0] * (2 + len(BUCKETS_SECONDS))
    histogram[0] += seconds
    histogram[1 + bisect_left(BUCKETS_SECONDS, seconds)] += 1
