"""A volume on disk, opened for reading: metadata, single bricks, regions."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
import zarr
from numpy.typing import NDArray

from octobrick.codec import metrics
from octobrick.codec.errors import CorruptBrickError, InvalidInputError
from octobrick.store import brick_codec
from octobrick.store import frame as zstd_frame
from octobrick.store.assembled import fill_from_bricks
from octobrick.store.attributes import Number, VolumeAttributes
from octobrick.store.box import Box, Zyx, cell_box, cells_touching, grid_of
from octobrick.store.brick_codec import BrickCodec, codec_text
from octobrick.store.errors import VolumeFormatError
from octobrick.store.layout import MANIFEST_NAME
from octobrick.store.level import Level, Xyz
from octobrick.store.shard import ShardCache, shard_key
from octobrick.store.stored_gradients import StoredGradients
from octobrick.store.volume_files import read_json, shard_entries

Voxels = NDArray[np.generic]


def open_volume(path: str | os.PathLike[str]) -> Volume:
    """Open a volume that ``ingest`` wrote.

    Raises:
        VolumeNotFoundError: there is nothing at the path.
        IncompleteVolumeError: an ingest into the path did not finish, or still runs.
        VolumeFormatError: what is there is no volume, or its metadata is damaged.
    """
    return Volume(Path(path))


class Volume:
    """A volume, its levels and bricks. Safe to use from several threads.

    An index is parsed once and kept, a brick is one read. The files are expected not to change; a
    volume that is replaced on disk must be opened anew.

    Attributes:
        path: the volume's folder.
        name: the folder's name without ``.zarr``.
        revision: digest of the content; a brick's bytes never change under one revision.
        levels: the pyramid, finest first.
        gradients: of the coarser levels; None where none are stored.
        shard_entries: size and digest of every stored shard, by its path below the volume.
    """

    path: Path
    name: str
    revision: str
    levels: tuple[Level, ...]
    gradients: StoredGradients | None
    shard_entries: Mapping[str, tuple[int, str]]

    def __init__(self, path: Path) -> None:
        self.path = path
        self.name = path.name.removesuffix(".zarr")
        root = read_json(path / "zarr.json", path)
        where = str(path / "zarr.json")
        fields = root.get("attributes", {}).get("octobrick") if isinstance(root, dict) else None
        self._attributes = VolumeAttributes.from_json(fields, where)
        manifest = read_json(path / MANIFEST_NAME, path)
        expected = self._attributes.revision(manifest)
        self.revision = fields["revision"] if isinstance(fields, dict) else ""
        if self.revision != expected:
            raise VolumeFormatError(
                f"{where}: revision {self.revision!r:.60} does not match attributes and manifest, "
                f"which give {expected}; restore the files or ingest the volume again",
                path=str(path),
            )
        self.shard_entries = shard_entries(manifest, path)
        self.levels = tuple(self._make_level(i) for i in range(len(self._attributes.levels)))
        self._shards = [self._make_cache(i) for i in range(len(self.levels))]
        self.gradients = self._make_gradients()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return (
            f"<Volume {self.name!r}: {self.dtype} {self.levels[0].shape_zyx} (z, y, x), "
            f"{len(self.levels)} levels, {codec_text(self.codec)}>"
        )

    def close(self) -> None:
        """Let go of all files."""
        for cache in self._shards:
            cache.close()
        if self.gradients is not None:
            self.gradients.close()

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

    def stored_brick(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> bytes | None:
        """A brick's bytes exactly as on disk, one zstd frame; None where the brick is absent.

        Raises:
            InvalidInputError: no such level or brick.
            VolumeFormatError: the shard is missing or its index is damaged.
            CorruptBrickError: the shard ends inside the brick.
        """
        self._require_brick(level, zyx, t, c)
        return self._shards[level].read(zyx, t, c)

    def stored_nbytes(
        self, level: int, bricks_zyx: NDArray[np.intp], t: int = 0, c: int = 0
    ) -> NDArray[np.int64]:
        """Sizes (n,) of the stored bricks (n, 3), from the indexes alone; 0 where one is absent.

        Raises:
            InvalidInputError: no such level or brick.
            VolumeFormatError: a shard is missing or its index is damaged.
        """
        for zyx in (bricks_zyx.min(axis=0), bricks_zyx.max(axis=0)) if len(bricks_zyx) else ():
            z, y, x = zyx.tolist()
            self._require_brick(level, (z, y, x), t, c)
        return self._shards[level].nbytes_of(bricks_zyx, t, c)

    def stored_brick_now(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> bytearray | None:
        """The same from memory; BlockingIOError where `stored_brick` would have to wait or fail."""
        self._require_brick(level, zyx, t, c)
        return self._shards[level].read_now(zyx, t, c)

    def brick_code(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> bytes | None:
        """A brick without the entropy layer, as a GPU takes it; None where the brick is absent.

        The codec's code, or raw little-endian voxels where there is none; the checksum is checked.

        Raises:
            CorruptBrickError: naming the file, the brick and both checksums.
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
            CorruptBrickError: naming the file and the brick.
            InvalidInputError: no such level or brick.
        """
        code = self.brick_code(level, zyx, t, c)
        if code is None:
            return np.full(self.brick_shape_zyx, self.fill_value, self.dtype)
        codec = self.level_codec(level)
        try:
            return brick_codec.decode(codec, code, self.brick_shape_zyx, self.dtype)
        except CorruptBrickError as error:
            raise self._located(error, level, zyx, t, c) from error

    def read(self, level: int, box: Box | None = None, t: int = 0, c: int = 0) -> Voxels:
        """The decoded voxels of a box of a level, by default of all of it.

        Raises:
            InvalidInputError: the box is empty or leaves the level.
            CorruptBrickError: naming the file and the brick.
        """
        shape_zyx = self.level(level).shape_zyx
        box = box or Box.of_shape(shape_zyx)
        box.require_within(shape_zyx, f"{self.name} level {level}")
        out = np.empty(box.shape_zyx, self.dtype)
        fill_from_bricks(out, box, self.brick_shape_zyx, lambda zyx: self.brick(level, zyx, t, c))
        return out

    def shard_key(self, brick_zyx: Zyx, t: int = 0, c: int = 0) -> str:
        """The path of the shard that holds, or would hold, a brick, below its level."""
        return shard_key(brick_zyx, self.shard_shape_zyx, t, c)

    def shard_bricks(self, level: int, t: int = 0, c: int = 0) -> Iterator[tuple[str, list[Zyx]]]:
        """The keys of all shards of a level, stored or not, each with its bricks.

        Raises:
            InvalidInputError: there is no such level.
        """
        grid = Box.of_shape(self.level(level).grid_zyx)
        for shard in cells_touching(grid, self.shard_shape_zyx):
            bricks = cell_box(shard, self.shard_shape_zyx).intersect(grid)
            whole = list(cells_touching(bricks, (1, 1, 1)))
            yield self.shard_key(whole[0], t, c), whole

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

    def _small_array(self, kind: str, level: int, t: int, c: int) -> Voxels:
        expected = (self.nt, self.nc, *self.level(level).grid_zyx, 2)
        path = self.path / kind / str(level)
        try:
            array = zarr.open_array(path, mode="r")
            if array.shape != expected:
                raise VolumeFormatError(
                    f"{path}: shape {array.shape} should be {expected}; ingest the volume again"
                )
            return np.asarray(array[t, c])
        except VolumeFormatError:
            raise
        except Exception as error:  # zarr and numcodecs raise what they please on damaged files
            raise VolumeFormatError(
                f"{path}: cannot be read ({error}); restore the files or ingest the volume again",
                path=str(path),
            ) from error

    # Inside

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
            nbytes=nz * ny * nx * self.dtype.itemsize,
            stored_nbytes=stored.stored_nbytes,
            max_error=stored.max_error,
            rmse=stored.rmse,
            psnr_db=stored.psnr_db,
        )

    def _make_cache(self, level: int) -> ShardCache:
        prefix = f"{level}/"
        shard_nbytes = {
            path.removeprefix(prefix): nbytes
            for path, (nbytes, _) in self.shard_entries.items()
            if path.startswith(prefix)
        }
        return ShardCache(self.path / str(level), self.shard_shape_zyx, shard_nbytes)

    def _make_gradients(self) -> StoredGradients | None:
        attributes = self._attributes
        levels = [
            i for i, level in enumerate(attributes.levels) if level.gradient_nbytes is not None
        ]
        if not levels:
            return None
        return StoredGradients(
            self.path,
            self.levels,
            tuple(levels),
            self.brick_shape_zyx,
            self.shard_shape_zyx,
            {path: nbytes for path, (nbytes, _) in self.shard_entries.items()},
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
        path = self._shards[level].path_of(zyx, t, c)
        facts = error.facts | {"path": str(path), "level": level, "brick": [t, c, *zyx]}
        return CorruptBrickError(
            f"{path}: brick (t, c, z, y, x) = {(t, c, *zyx)} of level {level} is damaged: "
            f"{error.message}; restore the file or ingest the volume again",
            **facts,
        )
