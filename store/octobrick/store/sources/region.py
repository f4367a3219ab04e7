"""A part of a source as a source: only its voxels are read, and it knows where it lies."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from octobrick.codec.errors import InvalidInputError
from octobrick.store.box import Box, Zyx
from octobrick.store.sources.base import Source
from octobrick.store.sources.wrapped import WrappedSource


class RegionSource(WrappedSource):
    """The voxels of a box of another source, which it closes with itself.

    An end of −1 stands for the end of the source.

    Raises:
        InvalidInputError: the box is empty or leaves the source, or this is a light field.
    """

    def __init__(self, source: Source, box: Box) -> None:
        z, y, x = (
            n if stop == -1 else stop
            for n, stop in zip(source.shape_zyx, box.stop_zyx, strict=True)
        )
        box = Box(box.start_zyx, (z, y, x))
        box.require_within(source.shape_zyx, f"the region of {source.path}")
        if source.light_field is not None:
            raise InvalidInputError(
                f"{source.path}: a light field is stored whole, so leave the region out; choose "
                "fewer views by a pattern",
                path=str(source.path),
            )
        super().__init__(source)
        self._start_zyx = box.start_zyx
        self.shape_zyx: Zyx = box.shape_zyx
        step_xyz = np.multiply(box.start_zyx, source.spacing_zyx)[::-1]
        axes = np.eye(3) if source.direction is None else np.array(source.direction)
        x, y, z = (np.array(source.origin_xyz) + axes @ step_xyz).tolist()
        self.origin_xyz = (x, y, z)

    def describe(self) -> dict[str, Any]:
        """What the whole source says, and where the region begins in it."""
        return super().describe() | {"region_start_zyx": list(self._start_zyx)}

    def _read(self, box: Box, t: int, c: int) -> npt.NDArray[Any]:
        return self._source.read(box.shift(self._start_zyx), t, c)

    def _read_channels(self, box: Box, t: int) -> npt.NDArray[Any]:
        return self._source.read_channels(box.shift(self._start_zyx), t)

    def _constant(self, box: Box, t: int, c: int) -> float | None:
        return self._source.constant(box.shift(self._start_zyx), t, c)
