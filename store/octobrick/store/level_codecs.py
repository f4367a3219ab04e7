"""The codecs of all levels of an ingest: as asked for, or found by measurement."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

from octobrick.store.box import Zyx, grid_of
from octobrick.store.brick_codec import BrickCodec, codec_from_json, codec_to_json
from octobrick.store.ingest_options import IngestOptions
from octobrick.store.probes import read_probes
from octobrick.store.rate_search import LevelSize, RateSearch
from octobrick.store.shard import index_nbytes
from octobrick.store.sources import Source


@dataclass(frozen=True, slots=True)
class LevelCodecs:
    """What the bricks of each level are coded by, finest first.

    Attributes:
        codecs: one per level.
        notes: what is worth saying of how they were found.
    """

    codecs: tuple[BrickCodec, ...]
    notes: tuple[str, ...] = ()

    def to_facts(self) -> dict[str, Any]:
        """What a journal keeps, so that a resumed ingest goes on with the same."""
        return {
            "codecs": [codec_to_json(codec) for codec in self.codecs],
            "codec_notes": list(self.notes),
        }

    @classmethod
    def from_facts(cls, facts: Mapping[str, Any], nlevels: int) -> LevelCodecs:
        """What `to_facts` gave.

        Raises:
            KeyError, ValueError, TypeError, OctobrickError: it is damaged.
        """
        codecs = tuple(codec_from_json(value) for value in facts["codecs"])
        if len(codecs) != nlevels:
            raise ValueError(f"{len(codecs)} codecs for {nlevels} levels")
        return cls(codecs, tuple(str(note) for note in facts["codec_notes"]))

    @classmethod
    def find(
        cls,
        source: Source,
        options: IngestOptions,
        shapes: Sequence[Zyx],
        executor: Executor,
        tick: Callable[[], None],
    ) -> LevelCodecs:
        """The codecs that give what the options ask for: the same whenever it is called.

        Args:
            source: with voxels as they are stored.
            options: checked.
            shapes: of all levels.
            executor: runs codecs.
            tick: called now and then; what it raises ends the search.

        Raises:
            InvalidInputError: level 0 cannot have what is asked for.
            NotFiniteError, SourceError: as reading raises them.
        """
        if options.target is None:
            return cls(options.codecs_of(source, len(shapes)))
        probes = read_probes(
            source,
            options.brick,
            tuple(shapes),
            options.reducer_of(source),
            options.replace_nonfinite,
            executor,
            tick,
        )
        sizes = [_size(source, shape, options) for shape in shapes]
        search = RateSearch(
            options.dial, options.target, options.brick, options.zstd_level_of, executor, tick
        )
        choices = search.levels(probes, sizes)
        notes = tuple(choice.note for choice in choices if choice.note)
        return cls(tuple(choice.codec for choice in choices), notes)


def _size(source: Source, shape: Zyx, options: IngestOptions) -> LevelSize:
    nvolumes = source.nt * source.nc
    bricks = grid_of(shape, (options.brick,) * 3)
    nshards = nvolumes * math.prod(grid_of(bricks, (options.shard,) * 3))
    return LevelSize(
        nbytes=nvolumes * math.prod(shape) * source.dtype.itemsize,
        index_nbytes=nshards * index_nbytes(options.shard**3),
    )
