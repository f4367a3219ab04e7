"""A volume in a folder of this machine: bricks straight from its shards."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import zarr
from numpy.typing import NDArray

from octobrick.store.attributes import VolumeAttributes
from octobrick.store.box import Box, Zyx, cell_box, cells_touching
from octobrick.store.errors import VolumeFormatError
from octobrick.store.layout import MANIFEST_NAME
from octobrick.store.shard import ShardCache, shard_key
from octobrick.store.stored_gradients import LocalGradients
from octobrick.store.volume import TableKind, Volume, Voxels
from octobrick.store.volume_files import read_json, shard_entries


class LocalVolume(Volume):
    """A volume on disk. Safe to use from several threads.

    An index is parsed once and kept, a brick is one read. The files are expected not to change.

    Attributes:
        path: the volume's folder.
        shard_entries: size and digest of every stored shard, by its path below the volume.

    Raises:
        VolumeNotFoundError, IncompleteVolumeError, VolumeFormatError: as `open_volume`.
    """

    path: Path
    gradients: LocalGradients | None
    shard_entries: Mapping[str, tuple[int, str]]

    def __init__(self, path: Path) -> None:
        self.path = path
        root = read_json(path / "zarr.json", path)
        where = str(path / "zarr.json")
        fields = root.get("attributes", {}).get("octobrick") if isinstance(root, dict) else None
        attributes = VolumeAttributes.from_json(fields, where)
        manifest = read_json(path / MANIFEST_NAME, path)
        expected = attributes.revision(manifest)
        revision = fields["revision"] if isinstance(fields, dict) else ""
        if revision != expected:
            raise VolumeFormatError(
                f"{where}: revision {revision!r:.60} does not match attributes and manifest, "
                f"which give {expected}; restore the files or ingest the volume again",
                path=str(path),
            )
        super().__init__(path.name.removesuffix(".zarr"), revision, attributes)
        self.shard_entries = shard_entries(manifest, path)
        self._shards = [self._make_cache(i) for i in range(len(self.levels))]
        self.gradients = self._make_gradients()

    def close(self) -> None:
        """Let go of all files."""
        for cache in self._shards:
            cache.close()
        if self.gradients is not None:
            self.gradients.close()

    def stored_brick(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> bytes | None:
        """A brick's bytes exactly as on disk, one zstd frame; None where the brick is absent.

        Raises:
            InvalidInputError: no such level or brick.
            VolumeFormatError: the shard is missing or its index is damaged.
            CorruptBrickError: the shard ends inside the brick.
        """
        self._require_brick(level, zyx, t, c)
        return self._shards[level].read(zyx, t, c)

    def stored_brick_now(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> bytearray | None:
        """The same from memory; BlockingIOError where `stored_brick` would have to wait or fail."""
        self._require_brick(level, zyx, t, c)
        return self._shards[level].read_now(zyx, t, c)

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

    def _small_array(self, kind: TableKind, level: int, t: int, c: int) -> Voxels:
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

    def _where(self, level: int, zyx: Zyx, t: int, c: int) -> str:
        return str(self._shards[level].path_of(zyx, t, c))

    def _make_cache(self, level: int) -> ShardCache:
        prefix = f"{level}/"
        shard_nbytes = {
            path.removeprefix(prefix): nbytes
            for path, (nbytes, _) in self.shard_entries.items()
            if path.startswith(prefix)
        }
        return ShardCache(self.path / str(level), self.shard_shape_zyx, shard_nbytes)

    def _make_gradients(self) -> LocalGradients | None:
        levels = self._gradient_levels()
        if not levels:
            return None
        return LocalGradients(
            self.path,
            self.levels,
            levels,
            self.brick_shape_zyx,
            self.shard_shape_zyx,
            {path: nbytes for path, (nbytes, _) in self.shard_entries.items()},
        )
