"""Counts in the words of Prometheus."""

from __future__ import annotations

from collections.abc import Iterator

from prometheus_client import CollectorRegistry
from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    Metric,
)
from prometheus_client.exposition import choose_encoder
from prometheus_client.process_collector import ProcessCollector
from prometheus_client.registry import Collector

from octobrick.server.operations.metrics import BUCKETS_SECONDS, Counts, family_of

# Of the numbers of a process those that mean something when several are added.
_PROCESS_NUMBERS = {
    "process_cpu_seconds": "cpu_seconds_total",
    "process_resident_memory_bytes": "resident_memory_bytes",
    "process_virtual_memory_bytes": "virtual_memory_bytes",
    "process_open_fds": "open_fds",
    "process_max_fds": "max_fds",
}


def metrics_text(counts: Counts, accept: str) -> tuple[bytes, str]:
    """The body and the content type that an Accept header asks for: Prometheus or OpenMetrics."""
    registry = CollectorRegistry()  # of this one answer: nothing is shared between apps
    registry.register(_Counted(counts))
    encode, content_type = choose_encoder(accept)
    return encode(registry), content_type


def process_stats() -> dict[str, float]:
    """Processor time, memory and descriptors of this process; its number, 1, adds up as well."""
    stats = {"count": 1.0}
    # The registry is its own: a collector wants one, and the global one is not ours to change.
    for metric in ProcessCollector(registry=CollectorRegistry()).collect():
        if metric.name in _PROCESS_NUMBERS:
            stats[_PROCESS_NUMBERS[metric.name]] = metric.samples[0].value
    return stats


class _Counted(Collector):
    def __init__(self, counts: Counts) -> None:
        self._counts = counts

    def collect(self) -> Iterator[Metric]:
        """Each metric with all of its samples."""
        for name, samples in self._counts.items():
            family = family_of(name)
            match family.kind:
                case "histogram":
                    yield _histogram(name, family.help, family.labels, samples)
                case "counter":
                    counter = CounterMetricFamily(name, family.help, labels=family.labels)
                    for labels, (number,) in samples.items():
                        counter.add_metric(labels, number)
                    yield counter
                case _:
                    gauge = GaugeMetricFamily(name, family.help, labels=family.labels)
                    for labels, (number,) in samples.items():
                        gauge.add_metric(labels, number)
                    yield gauge


def _histogram(
    name: str, text: str, label_names: tuple[str, ...], samples: dict[tuple[str, ...], list[float]]
) -> HistogramMetricFamily:
    metric = HistogramMetricFamily(name, text, labels=label_names)
    for labels, (total, *numbers) in samples.items():
        buckets, below = [], 0.0
        for end, number in zip((*map(str, BUCKETS_SECONDS), "+Inf"), numbers, strict=True):
            below += number
            buckets.append((end, below))
        metric.add_metric(labels, buckets, total)
    return metric
