"""Where an ingest is: what its checkpoints hold, and how it goes on from one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import metrics
from octobrick.store.journal import Arrays
from octobrick.store.level_writer import LevelRecord, LevelWriter
from octobrick.store.pyramid import Held, LevelStream


@dataclass(slots=True)
class ChannelState:
    """One channel of the time step under way: its pyramid and the writers of its levels."""

    stream: LevelStream
    writers: list[LevelWriter]


@dataclass(slots=True)
class IngestState:
    """How far an ingest is.

    Attributes:
        records: per level, what is known of all bricks so far.
        t: the time step under way; those before are complete.
        z: planes of it that have gone into the pyramids.
        channels: of that step; none where it has not begun.
    """

    records: list[LevelRecord]
    t: int = 0
    z: int = 0
    channels: list[ChannelState] = field(default_factory=list)

    def pack(self) -> tuple[dict[str, Any], Arrays]:
        """The state as JSON-ready facts and arrays; everything written so far is made durable."""
        arrays: Arrays = {}
        facts = {
            "t": self.t,
            "z": self.z,
            "levels": [_pack_record(i, record, arrays) for i, record in enumerate(self.records)],
            "channels": [_pack_channel(c, state, arrays) for c, state in enumerate(self.channels)],
        }
        return facts, arrays

    def restore(
        self,
        facts: Mapping[str, Any],
        arrays: Mapping[str, NDArray[Any]],
        begin_step: Callable[[int], list[ChannelState]],
    ) -> None:
        """Become what `pack` saw.

        Args:
            facts: of a checkpoint.
            arrays: of the same.
            begin_step: gives fresh channels of a time step.

        Raises:
            KeyError, ValueError, TypeError, IndexError, OSError: the checkpoint, or a shard that it
                names, is damaged.
        """
        for index, record in enumerate(self.records):
            _restore_record(index, record, facts["levels"][index], arrays)
        self.t, self.z = facts["t"], facts["z"]
        self.channels = begin_step(self.t) if facts["channels"] else []
        for c, state in enumerate(self.channels):
            _restore_channel(c, state, facts["channels"][c], arrays)


def _pack_record(index: int, record: LevelRecord, arrays: Arrays) -> dict[str, Any]:
    arrays[f"ranges-{index}"], arrays[f"fidelity-{index}"] = record.ranges, record.fidelity
    if record.preview:
        arrays[f"preview-{index}"] = np.concatenate(record.preview)
    errors = record.errors
    return {
        "errors": [errors.count, errors.max_abs, errors.sum_squared],
        "shards": record.shards,
    }


def _restore_record(
    index: int, record: LevelRecord, facts: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
) -> None:
    record.ranges[...] = arrays[f"ranges-{index}"]
    record.fidelity[...] = arrays[f"fidelity-{index}"]
    record.errors = metrics.ErrorStats(*facts["errors"])
    record.shards = {key: (int(n), str(digest)) for key, (n, digest) in facts["shards"].items()}
    preview = arrays.get(f"preview-{index}")
    if record.preview is not None:
        record.preview = [] if preview is None else [preview]


def _pack_channel(c: int, state: ChannelState, arrays: Arrays) -> dict[str, Any]:
    held = []
    for level, (layer, first_z, planes) in enumerate(state.stream.held()):
        held.append([layer, first_z])
        arrays[f"held-{c}-{level}"] = planes
    shards: list[list[int | str]] = []
    for level, writer in enumerate(state.writers):
        for key, shard in writer.shards_under_way.items():
            shard.sync()
            arrays[f"shard-{c}-{len(shards)}"] = shard.index
            shards.append([level, key, shard.nbytes])
    return {"held": held, "shards": shards}


def _restore_channel(
    c: int, state: ChannelState, facts: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
) -> None:
    state.stream.restore(
        [
            Held(layer, first_z, arrays[f"held-{c}-{level}"])
            for level, (layer, first_z) in enumerate(facts["held"])
        ]
    )
    for i, (level, key, nbytes) in enumerate(facts["shards"]):
        state.writers[level].resume_shard(key, arrays[f"shard-{c}-{i}"], nbytes)
