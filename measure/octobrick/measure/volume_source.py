"""A volume of ours as a source: what it stores is what is measured against."""

from __future__ import annotations

from typing import Any

import numpy.typing as npt

from octobrick.store import Box, Volume
from octobrick.store.sources.base import Description, Source
from octobrick.store.sources.location import Location


class VolumeSource(Source):
    """Level 0 of a volume, in a folder or on a server; closes it with itself.

    Args:
        path: where it is.
        volume: open.
    """

    def __init__(self, path: Location, volume: Volume) -> None:
        spacing_x, spacing_y, spacing_z = volume.levels[0].spacing_xyz
        super().__init__(
            path,
            Description(
                format="octobrick",
                shape_zyx=volume.levels[0].shape_zyx,
                dtype=volume.dtype,
                spacing_zyx=(spacing_z, spacing_y, spacing_x),
                unit=volume.unit,
                nt=volume.nt,
                nc=volume.nc,
                labels=bool(volume.metadata()["source"].get("labels", False)),
                chunk_zyx=volume.brick_shape_zyx,
            ),
        )
        self.volume = volume

    def _read(self, box: Box, t: int, c: int) -> npt.NDArray[Any]:
        return self.volume.read(0, box, t, c)

    def _close(self) -> None:
        self.volume.close()
