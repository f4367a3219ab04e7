"""What an export did, for people and programs."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from octobrick.store.attributes import Number
from octobrick.store.box import Zyx


@dataclass(frozen=True, slots=True)
class ExportResult:
    """The file or folder that was written.

    Attributes:
        path: where it is.
        format: its name, such as ``"nrrd"``.
        dtype: sample type.
        shape_zyx: voxels; of the finest level where several were written.
        level: the level that was exported; of several, the finest.
        levels: how many were written.
        spacing_zyx: world size of a voxel.
        origin_xyz: world position of the centre of the first voxel.
        unit: of both, or None.
        max_error: how far a voxel can be from that level's original, as measured by the ingest.
        nbytes: on disk.
        warnings: what the format cannot hold and has therefore been left out, a sentence each.
        elapsed_seconds: wall time.
        megabytes_per_second: uncompressed voxels.
        peak_rss_nbytes: most memory that the process has had.
    """

    path: str
    format: str
    dtype: str
    shape_zyx: Zyx
    level: int
    levels: int
    spacing_zyx: tuple[float, float, float]
    origin_xyz: tuple[float, float, float]
    unit: str | None
    max_error: Number
    nbytes: int
    warnings: tuple[str, ...]
    elapsed_seconds: float
    megabytes_per_second: float
    peak_rss_nbytes: int

    def to_dict(self) -> dict[str, Any]:
        """The result as JSON-ready values."""
        return asdict(self)
