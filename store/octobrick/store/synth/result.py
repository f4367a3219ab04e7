"""What a synthesis did, for people and programs."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from octobrick.store.box import Zyx


@dataclass(frozen=True, slots=True)
class SynthResult:
    """The file that was written."""

    path: str
    kind: str
    seed: int
    dtype: str
    shape_zyx: Zyx
    rgb: bool
    nbytes: int
    elapsed_seconds: float
    megavoxels_per_second: float
    peak_rss_nbytes: int

    def to_dict(self) -> dict[str, Any]:
        """The result as JSON-ready values."""
        return asdict(self)
