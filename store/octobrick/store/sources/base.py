"""The contract of every source: a described volume from which any box can be read."""

from __future__ import annotations

import hashlib
import json
import os
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from octobrick.codec.errors import InvalidInputError
from octobrick.store.box import Box, Zyx
from octobrick.store.camera_grid import CameraGrid
from octobrick.store.errors import SourceNotFoundError
from octobrick.store.sources.location import Location

Vector = tuple[float, float, float]
Direction = tuple[Vector, Vector, Vector]


class Rescale(NamedTuple):
    """What turns a stored sample into the value that it stands for: ``slope * v + intercept``."""

    slope: float
    intercept: float


class Channel(NamedTuple):
    """One channel, as far as a source names it; the colour as ``"rrggbb"``."""

    name: str | None = None
    color: str | None = None


RGB = (Channel("red", "ff0000"), Channel("green", "00ff00"), Channel("blue", "0000ff"))
RGBA = (*RGB, Channel("alpha"))


class Pick(NamedTuple):
    """What a caller says of a file that holds more than one volume.

    Attributes:
        dataset: which of them: a path inside an HDF5 file or a Zarr group, the name of a grid or
            of an array.
        axes: what its axes are, slowest first, of the letters t, c, z, y, x and s (samples of one
            colour), such as ``"tczyx"``; needed where a format does not say it.
    """

    dataset: str | None = None
    axes: str | None = None

    def given(self) -> list[str]:
        """The options that are set, as the command line names them."""
        return [f"--{name}" for name, value in self._asdict().items() if value is not None]


@dataclass(frozen=True, slots=True)
class Description:
    """What a source says of its volume, whatever the format.

    Attributes:
        format: name of the format, such as ``"nrrd"``.
        shape_zyx: voxels along each axis, all positive.
        dtype: native-endian sample type: bool, an integer of up to 64 bits or a float of 16 to 64.
        spacing_zyx: distance of voxel centres, finite and positive.
        unit: UDUNITS name of the unit of the spacing, or None where the file does not say.
        direction: 3×3, column i the unit vector of voxel axis i of (x, y, z) in LPS world; or None.
        rescale: from stored samples to values, or None where they are the same.
        warnings: what was wrong in the header and has been put right, a sentence each.
        origin_xyz: where the centre of voxel (0, 0, 0) lies in the world of ``direction``.
        nt: time steps.
        nc: channels.
        channels: what is known of each channel, ``nc`` of them, or none; `RGB` and `RGBA` tell
            that the channels are one colour.
        labels: whether a sample is a name, not a quantity, so that a mean of two means nothing.
        background: what fills space that a sparse source does not store.
        chunk_zyx: the box of voxels that costs as much to read as one voxel of it (a compressed
            chunk, tile or plane); None where any box is read alone.
        light_field: the cameras whose views the slices are; None of all other volumes.
    """

    format: str
    shape_zyx: Zyx
    dtype: np.dtype[Any]
    spacing_zyx: Vector = (1.0, 1.0, 1.0)
    unit: str | None = None
    direction: Direction | None = None
    rescale: Rescale | None = None
    warnings: tuple[str, ...] = ()
    origin_xyz: Vector = (0.0, 0.0, 0.0)
    nt: int = 1
    nc: int = 1
    channels: tuple[Channel, ...] = ()
    labels: bool = False
    background: float = 0
    chunk_zyx: Zyx | None = None
    light_field: CameraGrid | None = None

    @property
    def nbytes(self) -> int:
        """Bytes of all voxels of one time step and channel, uncompressed."""
        nz, ny, nx = self.shape_zyx
        return nz * ny * nx * self.dtype.itemsize


class Source(ABC):
    """A volume in files of someone else's format, open for reading.

    ``read`` gives any box inside the volume, in any order, with memory for that box and a small
    fixed buffer. Use it as a context manager, or call ``close``.

    Attributes are those of `Description`, ``path`` (the file, folder or address that was opened)
    and ``ascending``. Reading is safe from several threads; closing while another thread reads is
    not.
    """

    def __init__(self, path: Location, description: Description) -> None:
        self.path = path
        self.format = description.format
        self.shape_zyx = description.shape_zyx
        self.dtype = description.dtype
        self.spacing_zyx = description.spacing_zyx
        self.unit = description.unit
        self.direction = description.direction
        self.origin_xyz = description.origin_xyz
        self.rescale = description.rescale
        self.nt = description.nt
        self.nc = description.nc
        self.channels = description.channels
        self.labels = description.labels
        self.background = description.background
        self.chunk_zyx = description.chunk_zyx
        self.light_field = description.light_field
        self.warnings = description.warnings
        self._closed = False

    @property
    def ascending(self) -> bool:
        """Whether reads should go up in z; if so, going down costs decoding some data again."""
        return False

    @property
    def is_rgb(self) -> bool:
        """Whether the channels are red, green and blue (and alpha) of one colour."""
        return self.channels in (RGB, RGBA)

    @property
    def files(self) -> tuple[Path, ...]:
        """The files that hold the volume: what a fingerprint is taken of."""
        return (self.path,) if isinstance(self.path, Path) else ()

    def fingerprint(self) -> dict[str, Any]:
        """What tells that a source is still the one it was, JSON-ready.

        The description, and size and time of change of every file. A source without files, such
        as one on a server, says what it has instead (an entity tag).
        """
        stamps = [(path.name, status.st_size, status.st_mtime_ns) for path, status in self._stat()]
        newest = datetime.fromtimestamp(max(ns for _, _, ns in stamps) / 1e9, tz=UTC)
        digest = hashlib.blake2b(json.dumps(stamps).encode(), digest_size=16).hexdigest()
        return {
            **self.describe(),
            "nfiles": len(stamps),
            "nbytes": sum(nbytes for _, nbytes, _ in stamps),
            "modified": newest.isoformat(timespec="seconds"),
            "digest": digest,
        }

    def _stat(self) -> Iterator[tuple[Path, os.stat_result]]:
        for path in self.files:
            try:
                yield path, path.stat()
            except OSError as error:
                raise SourceNotFoundError(
                    f"{path}: cannot be looked at any more ({error.strerror}); put it back",
                    path=str(path),
                ) from error

    def read(self, box: Box, t: int = 0, c: int = 0) -> npt.NDArray[Any]:
        """The voxels of a box: C-contiguous, native-endian, as stored (``rescale`` not applied).

        Raises:
            InvalidInputError: the box is empty or leaves the volume, there is no such time step
                or channel, or the source is closed.
            SourceError: the bytes are damaged; `TruncatedSourceError` if they end too early.
        """
        self._require(box, t, c)
        return self._read(box, t, c)

    def read_channels(self, box: Box, t: int = 0) -> npt.NDArray[Any]:
        """The voxels of a box in all channels, (c, z, y, x): what is interleaved is read once.

        Raises:
            What `read` raises.
        """
        self._require(box, t, 0)
        return self._read_channels(box, t)

    def constant(self, box: Box, t: int = 0, c: int = 0) -> float | None:
        """The value of all voxels of a box, where that is known without reading; None if not."""
        self._require(box, t, c)
        return self._constant(box, t, c)

    def _require(self, box: Box, t: int, c: int) -> None:
        if self._closed:
            raise InvalidInputError(
                f"{self.path}: the source is closed; open it again to read", path=str(self.path)
            )
        box.require_within(self.shape_zyx, f"reading {self.path}")
        if not (0 <= t < self.nt and 0 <= c < self.nc):
            raise InvalidInputError(
                f"{self.path}: no time step {t} with channel {c}; there are {self.nt} time steps "
                f"and {self.nc} channels, counted from 0",
                path=str(self.path),
                t=t,
                c=c,
            )

    def describe(self) -> dict[str, Any]:
        """What is known of the volume, JSON-ready; the file by name only, without its folder."""
        return {
            "format": self.format,
            "file": self.path.name,
            "shape_zyx": list(self.shape_zyx),
            "dtype": self.dtype.name,
            "timepoints": self.nt,
            "channels": self.nc,
            "channel_names": [channel.name for channel in self.channels],
            "channel_colors": [channel.color for channel in self.channels],
            "labels": self.labels,
            "spacing_zyx": list(self.spacing_zyx),
            "unit": self.unit,
            "rescale": self.rescale and self.rescale._asdict(),
            "direction": self.direction and [list(row) for row in self.direction],
            "origin_xyz": list(self.origin_xyz),
        }

    def abandon(self) -> None:  # noqa: B027
        """End reads under way in other threads, where they may take long; they raise something."""

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
    def _read(self, box: Box, t: int, c: int) -> npt.NDArray[Any]:
        """The voxels of a box that is known to be inside the volume."""

    def _read_channels(self, box: Box, t: int) -> npt.NDArray[Any]:
        """All channels of such a box; interleaved formats override it."""
        if self.nc == 1:
            return self._read(box, t, 0)[np.newaxis]
        return np.stack([self._read(box, t, c) for c in range(self.nc)])

    def _constant(self, box: Box, t: int, c: int) -> float | None:  # noqa: ARG002
        """The value of such a box, where sparse formats know it."""
        return None

    @abstractmethod
    def _close(self) -> None:
        """Let go of what is held; called once."""
