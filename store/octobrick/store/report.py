"""What an ingest did, for people and programs."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

from octobrick.store.attributes import Number
from octobrick.store.box import Zyx
from octobrick.store.brick_codec import BrickCodec, codec_to_json


@dataclass(frozen=True, slots=True)
class LevelReport:
    """One level as it was stored.

    ``ratio`` is uncompressed bytes over bytes on disk. ``psnr_db`` (peak: the level's largest
    minus its smallest voxel) and ``max_error`` compare decoded voxels with that level's; None and
    0 where nothing was lost. ``codec`` is what the level's bricks are coded by. ``gradient_nbytes``
    are those of gradients on disk; None without any.
    """

    index: int
    shape_zyx: Zyx
    nbytes: int
    stored_nbytes: int
    ratio: float | None
    psnr_db: float | None
    max_error: Number
    codec: BrickCodec
    gradient_nbytes: int | None


@dataclass(frozen=True, slots=True)
class IngestResult:
    """The outcome of an ingest; rates count source voxels, uncompressed.

    ``resumed_voxels`` were stored by an earlier run that did not finish; time and rate are of the
    rest.
    """

    path: str
    revision: str
    source_format: str
    dtype: str
    timepoints: int
    channels: int
    shape_zyx: Zyx
    levels: tuple[LevelReport, ...]
    warnings: tuple[str, ...]
    resumed_voxels: int
    elapsed_seconds: float
    megabytes_per_second: float
    peak_rss_nbytes: int

    def to_dict(self) -> dict[str, Any]:
        """The result as JSON-ready values."""
        levels = [
            {f.name: getattr(level, f.name) for f in fields(level)}
            | {"codec": codec_to_json(level.codec)}
            for level in self.levels
        ]
        return {f.name: getattr(self, f.name) for f in fields(self)} | {"levels": levels}
