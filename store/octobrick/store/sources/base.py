"""The contract of every source: a described volume from which any box can be read."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from octobrick.codec.errors import InvalidInputError
from octobrick.store.box import Box, Zyx

Vector = tuple[float, float, float]
Direction = tuple[Vector, Vector, Vector]


class Rescale(NamedTuple):
    """What turns a stored sample into the value that it stands for: ``slope * v + intercept``."""

    slope: float
    intercept: float


@dataclass(frozen=True, slots=True)
class Description:
    """What a source says of its volume, whatever the format.

    Attributes:
        format: name of the format, such as ``"nrrd"``.
        shape_zyx: voxels along each axis, all positive.
        dtype: native-endian sample type.
        spacing_zyx: distance of voxel centres, finite and positive.
        unit: UDUNITS name of the unit of the spacing, or None where the file does not say.
        direction: 3×3, column i the unit vector of voxel axis i of (x, y, z) in LPS world; or None.
        rescale: from stored samples to values, or None where they are the same.
        warnings: what was wrong in the header and has been put right, a sentence each.
    """

    format: str
    shape_zyx: Zyx
    dtype: np.dtype[Any]
    spacing_zyx: Vector = (1.0, 1.0, 1.0)
    unit: str | None = None
    direction: Direction | None = None
    rescale: Rescale | None = None
    warnings: tuple[str, ...] = ()

    @property
    def nbytes(self) -> int:
        """Bytes of all voxels, uncompressed."""
        nz, ny, nx = self.shape_zyx
        return nz * ny * nx * self.dtype.itemsize


class Source(ABC):
    """A volume in a file of someone else's format, open for reading.

    ``read`` gives any box inside the volume, in any order, with memory for that box and a small
    fixed buffer. Use it as a context manager, or call ``close``.

    Attributes are those of `Description`, ``path`` (the file that was opened) and ``ascending``.
    Reading is safe from several threads; closing while another thread reads is not.
    """

    def __init__(self, path: Path, description: Description) -> None:
        self.path = path
        self.format = description.format
        self.shape_zyx = description.shape_zyx
        self.dtype = description.dtype
        self.spacing_zyx = description.spacing_zyx
        self.unit = description.unit
        self.direction = description.direction
        self.rescale = description.rescale
        self.warnings = description.warnings
        self._closed = False

    @property
    def ascending(self) -> bool:
        """Whether reads should go up in z; if so, going down costs decoding some data again."""
        return False

    def read(self, box: Box) -> npt.NDArray[Any]:
        """The voxels of a box: C-contiguous, native-endian, as stored (``rescale`` not applied).

        Raises:
            InvalidInputError: the box is empty or leaves the volume, or the source is closed.
            SourceError: the bytes are damaged; `TruncatedSourceError` if they end too early.
        """
        if self._closed:
            raise InvalidInputError(
                f"{self.path}: the source is closed; open it again to read", path=str(self.path)
            )
        box.require_within(self.shape_zyx, f"reading {self.path}")
        return self._read(box)

    def describe(self) -> dict[str, Any]:
        """What is known of the volume, JSON-ready; the file by name only, without its folder."""
        return {
            "format": self.format,
            "file": self.path.name,
            "shape_zyx": list(self.shape_zyx),
            "dtype": self.dtype.name,
            "spacing_zyx": list(self.spacing_zyx),
            "unit": self.unit,
            "rescale": self.rescale and self.rescale._asdict(),
            "direction": self.direction and [list(row) for row in self.direction],
        }

    def close(self) -> None:
        """Let go of the file; calling it again does nothing."""
        if not self._closed:
            self._closed = True
            self._close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    @abstractmethod
    def _read(self, box: Box) -> npt.NDArray[Any]:
        """The voxels of a box that is known to be inside the volume."""

    @abstractmethod
    def _close(self) -> None:
        """Let go of what is held; called once."""
