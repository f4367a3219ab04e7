"""Where an ingest is: what its checkpoints hold, and how it goes on from one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from octobrick.codec import metrics
from octobrick.store.journal import Arrays, Checkpoint, Planes
from octobrick.store.pyramid import Pyramid
from octobrick.store.volume_writer import VolumeRecord, VolumeWriter
from octobrick.store.window import Window


@dataclass(slots=True)
class IngestState:
    """How far an ingest is.

    Attributes:
        record: what is known of all bricks so far.
        writer: the shards under way.
        t: the time step under way; those before are complete.
        z: planes of it that have gone into the pyramids.
        pyramids: of that step's channels; none where it has not begun.
    """

    record: VolumeRecord
    writer: VolumeWriter
    t: int = 0
    z: int = 0
    pyramids: list[Pyramid] = field(default_factory=list)

    def pack(self) -> tuple[dict[str, Any], Arrays]:
        """The state as JSON-ready facts and arrays; everything written so far is made durable."""
        arrays: Arrays = {}
        facts = {
            "t": self.t,
            "z": self.z,
            "record": _pack_record(self.record, arrays),
            "shards": _pack_shards(self.writer, arrays),
            "pyramids": [_pack_pyramid(c, p, arrays) for c, p in enumerate(self.pyramids)],
        }
        return facts, arrays

    def restore(self, checkpoint: Checkpoint, begin_step: Callable[[int], list[Pyramid]]) -> None:
        """Become what `pack` saw.

        Args:
            checkpoint: what it was written as.
            begin_step: gives fresh pyramids of a time step.

        Raises:
            KeyError, ValueError, TypeError, IndexError, OSError, BadZipFile: the checkpoint, or a
                shard that it names, is damaged.
        """
        facts = checkpoint.facts
        _restore_record(self.record, facts["record"], checkpoint)
        for i, (array, t, c, key, nbytes) in enumerate(facts["shards"]):
            self.writer.resume_shard(array, t, c, key, checkpoint.array(f"shard-{i}"), nbytes)
        self.t, self.z = facts["t"], facts["z"]
        self.pyramids = begin_step(self.t) if facts["pyramids"] else []
        for c, pyramid in enumerate(self.pyramids):
            _restore_pyramid(c, pyramid, facts["pyramids"][c], checkpoint)


# What is known


def _pack_record(record: VolumeRecord, arrays: Arrays) -> dict[str, Any]:
    for index, level in enumerate(record.levels):
        arrays[f"ranges-{index}"], arrays[f"fidelity-{index}"] = level.ranges, level.fidelity
    for c, histogram in enumerate(record.histograms):
        arrays[f"histogram-{c}"] = histogram.counts
    return {
        "shards": {path: array.shards for path, array in record.arrays.items()},
        "errors": [
            [level.errors.count, level.errors.max_abs, level.errors.sum_squared]
            for level in record.levels
        ],
        "histograms": [[h.exponent, h.first] for h in record.histograms],
    }


def _restore_record(record: VolumeRecord, facts: Mapping[str, Any], checkpoint: Checkpoint) -> None:
    for index, level in enumerate(record.levels):
        level.ranges[...] = checkpoint.array(f"ranges-{index}")
        level.fidelity[...] = checkpoint.array(f"fidelity-{index}")
        level.errors = metrics.ErrorStats(*facts["errors"][index])
    for c, (exponent, first) in enumerate(facts["histograms"]):
        counts = checkpoint.array(f"histogram-{c}")
        record.histograms[c] = metrics.Histogram(exponent, first, counts)
    for path, array in record.arrays.items():
        array.shards = {key: (int(n), str(d)) for key, (n, d) in facts["shards"][path].items()}


def _pack_shards(writer: VolumeWriter, arrays: Arrays) -> list[list[int | str]]:
    shards: list[list[int | str]] = []
    for (array, t, c), own in writer.shards_under_way.items():
        for key, shard in own.items():
            shard.sync()
            arrays[f"shard-{len(shards)}"] = shard.index
            shards.append([array, t, c, key, shard.nbytes])
    return shards


# The pyramid


def _pack_pyramid(c: int, pyramid: Pyramid, arrays: Arrays) -> dict[str, Any]:
    levels = []
    for level, (layer, window) in enumerate(pyramid.held()):
        levels.append([layer, window.first_z])
        arrays[f"held-{c}-{level}"] = _planes(window)
    gradients, waiting = {}, []
    if pyramid.gradients is not None:
        for level, window in pyramid.gradients.windows.items():
            gradients[level] = [pyramid.gradients.layers[level], window.first_z]
            arrays[f"gradient-{c}-{level}"] = _planes(window)
        for level, plane in pyramid.gradients.waiting.items():
            waiting.append(level)
            arrays[f"waiting-{c}-{level}"] = plane
    return {"levels": levels, "gradients": gradients, "waiting": waiting}


def _planes(window: Window) -> Planes:
    return Planes(window.held_shape, window.dtype, window.held)


def _restore_pyramid(
    c: int, pyramid: Pyramid, facts: Mapping[str, Any], checkpoint: Checkpoint
) -> None:
    for level, (held, (_, first_z)) in enumerate(zip(pyramid.held(), facts["levels"], strict=True)):
        _fill(held.window, first_z, checkpoint, f"held-{c}-{level}")
    pyramid.restore([layer for layer, _ in facts["levels"]])
    if pyramid.gradients is None:
        return
    for level, window in pyramid.gradients.windows.items():
        layer, first_z = facts["gradients"][str(level)]
        pyramid.gradients.layers[level] = layer
        _fill(window, first_z, checkpoint, f"gradient-{c}-{level}")
    for level in facts["waiting"]:
        plane = checkpoint.array(f"waiting-{c}-{level}")
        pyramid.gradients.waiting[level] = plane.astype(np.float32, copy=False)


def _fill(window: Window, first_z: int, checkpoint: Checkpoint, name: str) -> None:
    window.begin_at(first_z)
    stop_z = first_z
    for z, y, rows in checkpoint.pieces(name, window.held_shape[1:], window.dtype):
        window.put(first_z + z, y, rows)
        stop_z = max(stop_z, first_z + z + len(rows))
    window.complete_to(stop_z)
