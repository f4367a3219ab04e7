"""A volume, opened for reading, wherever its bytes come from: metadata, single bricks, regions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from functools import cached_property
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import metrics
from octobrick.codec.errors import CorruptBrickError, InvalidInputError
from octobrick.store import brick_codec
from octobrick.store import frame as zstd_frame
from octobrick.store.assembled import fill_from_bricks
from octobrick.store.attributes import Number, VolumeAttributes
from octobrick.store.box import Box, Zyx, cells_touching, grid_of
from octobrick.store.brick_codec import BrickCodec, codec_text
from octobrick.store.camera_grid import CameraGrid
from octobrick.store.level import Level, Xyz
from octobrick.store.stored_gradients import StoredGradients
from octobrick.store.surface.attributes import SurfaceAttributes

Voxels = NDArray[np.generic]
TableKind = Literal["range", "fidelity"]


class Volume(ABC):
    """A volume, its levels and bricks. Safe to use from several threads.

    What is read must not change; a volume that is replaced must be opened anew. `open_volume`
    makes one, of a folder or of an octobrick server.

    Attributes:
        name: the folder's name without ``.zarr``, or the server's id.
        revision: digest of the content; a brick's bytes never change under one revision.
        levels: the pyramid, finest first.
        gradients: of the coarser levels; None where none are stored.
    """

    name: str
    revision: str
    levels: tuple[Level, ...]
    gradients: StoredGradients | None

    def __init__(self, name: str, revision: str, attributes: VolumeAttributes) -> None:
        self.name = name
        self.revision = revision
        self._attributes = attributes
        self.levels = tuple(self._make_level(i) for i in range(len(attributes.levels)))
        self.gradients = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return (
            f"<Volume {self.name!r}: {self.dtype} {self.levels[0].shape_zyx} (z, y, x), "
            f"{len(self.levels)} levels, {codec_text(self.codec)}>"
        )

    @abstractmethod
    def close(self) -> None:
        """Let go of all files and connections."""

    # What the volume is

    @cached_property
    def dtype(self) -> np.dtype[np.generic]:
        """Sample type."""
        return np.dtype(self._attributes.dtype)

    @property
    def codec(self) -> BrickCodec:
        """What the bricks of level 0 are coded by; None where voxels are stored as they are."""
        return self._attributes.codec

    def level_codec(self, level: int) -> BrickCodec:
        """What the bricks of a level are coded by; None where voxels are stored as they are.

        Raises:
            InvalidInputError: there is no such level.
        """
        return self._attributes.levels[self.level(level).index].codec

    @property
    def brick_shape_zyx(self) -> Zyx:
        """Voxels per brick."""
        return (self._attributes.brick,) * 3

    @property
    def shard_shape_zyx(self) -> Zyx:
        """Bricks per shard."""
        return (self._attributes.shard_bricks,) * 3

    @property
    def nt(self) -> int:
        """Time steps."""
        return self._attributes.nt

    @property
    def nc(self) -> int:
        """Channels."""
        return self._attributes.nc

    @property
    def unit(self) -> str | None:
        """World unit by its UDUNITS name, such as millimeter; None where unknown."""
        return self._attributes.unit

    @property
    def value_range(self) -> tuple[Number, Number]:
        """Smallest and largest voxel of the original."""
        return self._attributes.value_range

    @property
    def window(self) -> tuple[Number, Number]:
        """The values worth showing by default."""
        return self._attributes.window

    @property
    def histograms(self) -> tuple[metrics.Histogram, ...]:
        """How often values occur in each channel of the original, over all time steps."""
        return self._attributes.histograms

    @property
    def light_field(self) -> CameraGrid | None:
        """The cameras whose views the slices are; None of a volume that is no light field."""
        return self._attributes.light_field

    @property
    def surface(self) -> SurfaceAttributes | None:
        """The surface whose cells alone are stored; None where all voxels are."""
        return self._attributes.surface

    @property
    def fill_value(self) -> int:
        """The value of every voxel of an absent brick."""
        return 0

    def level(self, index: int) -> Level:
        """One level.

        Raises:
            InvalidInputError: there is no such level.
        """
        if not 0 <= index < len(self.levels):
            raise InvalidInputError(
                f"{self.name}: level {index} does not exist, there are 0 to {len(self.levels) - 1}",
                level=index,
                levels=len(self.levels),
            )
        return self.levels[index]

    def metadata(self) -> dict[str, Any]:
        """All that the volume says of itself, as JSON-ready values."""
        fields = self._attributes.to_json()
        for key, level in zip(fields["levels"], self.levels, strict=True):
            key |= {
                "grid": list(level.grid_zyx),
                "spacing": list(reversed(level.spacing_xyz)),
                "translation": list(reversed(level.origin_xyz)),
                "nbytes": level.nbytes,
            }
        return {"name": self.name, "revision": self.revision, **fields}

    def attributes(self) -> dict[str, Any]:
        """The ``octobrick`` attributes as they stand in the volume's zarr.json."""
        return {"revision": self.revision, **self._attributes.to_json()}

    # Bricks

    @abstractmethod
    def stored_brick(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> bytes | None:
        """A brick's bytes exactly as stored, one zstd frame; None where the brick is absent.

        Raises:
            InvalidInputError: no such level or brick.
            VolumeFormatError: the shard is missing or its index is damaged.
            CorruptBrickError: the brick is cut short, or came damaged.
            ServerUnreachableError: of a volume on a server.
        """

    def brick_code(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> bytes | None:
        """A brick without the entropy layer, as a GPU takes it; None where the brick is absent.

        The codec's code, or raw little-endian voxels where there is none; the checksum is checked.

        Raises:
            CorruptBrickError: naming the file or address, the brick and both checksums.
            InvalidInputError: no such level or brick.
        """
        stored = self.stored_brick(level, zyx, t, c)
        if stored is None:
            return None
        try:
            return self.decompressed(stored, level)
        except CorruptBrickError as error:
            raise self._located(error, level, zyx, t, c) from error

    def brick(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> Voxels:
        """The decoded voxels of a brick, always of the full brick shape.

        Where the brick reaches beyond the level, the last voxels are repeated, as stored.

        Raises:
            CorruptBrickError: naming the file or address and the brick.
            InvalidInputError: no such level or brick.
        """
        return self._decoded(self.brick_code(level, zyx, t, c), level, zyx, t, c)

    def read(self, level: int, box: Box | None = None, t: int = 0, c: int = 0) -> Voxels:
        """The decoded voxels of a box of a level, by default of all of it.

        Raises:
            InvalidInputError: the box is empty or leaves the level.
            CorruptBrickError: naming the file or address and the brick.
        """
        shape_zyx = self.level(level).shape_zyx
        box = box or Box.of_shape(shape_zyx)
        box.require_within(shape_zyx, f"{self.name} level {level}")
        out = np.empty(box.shape_zyx, self.dtype)
        places = cells_touching(box, self.brick_shape_zyx)
        fill_from_bricks(out, box, self.brick_shape_zyx, self._bricks_at(level, places, t, c))
        return out

    def decompressed(self, stored: bytes, level: int) -> bytes:
        """What `stored_brick` gave for a level, without the entropy layer.

        Raises:
            CorruptBrickError: the frame is damaged, or holds more or less than a brick of this
                level can take.
        """
        is_variable = not brick_codec.has_one_size(self.level_codec(level))
        return zstd_frame.decompress(stored, self.code_nbytes_max(level), at_most=is_variable)

    def code_nbytes_max(self, level: int) -> int:
        """The most bytes that a code takes at a level; what each takes, but for variable rate."""
        return brick_codec.code_nbytes_max(
            self.level_codec(level), self.brick_shape_zyx, self.dtype
        )

    # What is known per brick

    def ranges(self, level: int, t: int = 0, c: int = 0) -> Voxels:
        """Minimum and maximum of each brick of originals, one voxel wider than the brick.

        Returns:
            (nz, ny, nx, 2) in the sample type.
        """
        return self._small_array("range", level, t, c)

    def fidelity(self, level: int, t: int = 0, c: int = 0) -> NDArray[np.float32]:
        """Largest absolute error and RMSE of each brick, decoded against that level.

        Returns:
            (nz, ny, nx, 2) float32; the largest error is rounded up, never down.
        """
        return self._small_array("fidelity", level, t, c).astype(np.float32, copy=False)

    # Inside

    def _bricks_at(
        self, level: int, places: Iterable[Zyx], t: int, c: int
    ) -> Iterator[tuple[Zyx, Voxels]]:
        """What `brick` gives of many places, in any order."""
        for zyx in places:
            yield zyx, self.brick(level, zyx, t, c)

    def _decoded(self, code: bytes | None, level: int, zyx: Zyx, t: int, c: int) -> Voxels:
        if code is None:
            return np.full(self.brick_shape_zyx, self.fill_value, self.dtype)
        codec = self.level_codec(level)
        try:
            return brick_codec.decode(codec, code, self.brick_shape_zyx, self.dtype)
        except CorruptBrickError as error:
            raise self._located(error, level, zyx, t, c) from error

    @abstractmethod
    def _small_array(self, kind: TableKind, level: int, t: int, c: int) -> Voxels:
        """A table of one value pair for each brick: (nz, ny, nx, 2)."""

    @abstractmethod
    def _where(self, level: int, zyx: Zyx, t: int, c: int) -> str:
        """The file, or the address, that a brick comes from."""

    def _gradient_levels(self) -> tuple[int, ...]:
        """Those that store directions."""
        levels = enumerate(self._attributes.levels)
        return tuple(i for i, level in levels if level.gradient_nbytes is not None)

    def _make_level(self, index: int) -> Level:
        attributes, stored = self._attributes, self._attributes.levels[index]
        factor = 2**index
        z, y, x = attributes.spacing_zyx
        spacing_xyz: Xyz = (x * factor, y * factor, z * factor)
        nz, ny, nx = stored.shape_zyx
        return Level(
            index=index,
            shape_zyx=stored.shape_zyx,
            grid_zyx=grid_of(stored.shape_zyx, self.brick_shape_zyx),
            spacing_xyz=spacing_xyz,
            origin_xyz=(x * (factor - 1) / 2, y * (factor - 1) / 2, z * (factor - 1) / 2),
            nbytes=nz * ny * nx * self.dtype.itemsize * self.nt * self.nc,
            stored_nbytes=stored.stored_nbytes,
            max_error=stored.max_error,
            rmse=stored.rmse,
            psnr_db=stored.psnr_db,
        )

    def _require_brick(self, level: int, zyx: Zyx, t: int, c: int) -> None:
        grid_zyx = self.level(level).grid_zyx
        (z, y, x), (nz, ny, nx) = zyx, grid_zyx
        inside = 0 <= z < nz and 0 <= y < ny and 0 <= x < nx
        if not (inside and 0 <= t < self.nt and 0 <= c < self.nc):
            raise InvalidInputError(
                f"{self.name}: level {level} has no brick (t, c, z, y, x) = {(t, c, *zyx)}; it has "
                f"{self.nt} time steps, {self.nc} channels and {grid_zyx} bricks (z, y, x)",
                level=level,
                brick=[t, c, *zyx],
                grid=[self.nt, self.nc, *grid_zyx],
            )

    def _located(
        self, error: CorruptBrickError, level: int, zyx: Zyx, t: int, c: int
    ) -> CorruptBrickError:
        path = self._where(level, zyx, t, c)
        facts = error.facts | {"path": path, "level": level, "brick": [t, c, *zyx]}
        return CorruptBrickError(
            f"{path}: brick (t, c, z, y, x) = {(t, c, *zyx)} of level {level} is damaged: "
            f"{error.message}; restore the file or ingest the volume again",
            **facts,
        )
