"""The directions of a volume's gradients, as they are stored beside its levels."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import CorruptBrickError, InvalidInputError
from octobrick.store import frame as zstd_frame
from octobrick.store.assembled import fill_from_bricks
from octobrick.store.box import Box, Zyx, cells_touching
from octobrick.store.brick_encoder import NO_DIRECTION
from octobrick.store.gradient_pyramid import gradient_array
from octobrick.store.level import Level
from octobrick.store.shard import ShardCache

DirectionCodes = NDArray[np.uint8]


class StoredGradients(ABC):
    """The gradients of a volume, level by level. Safe to use from several threads.

    Bricks lie as those of the voxels do. `octobrick.codec.gradients.decode_directions` makes unit
    vectors of codes.

    Attributes:
        levels: which levels have gradients.
        brick_shape_zyx: voxels of a brick along each axis.
    """

    levels: tuple[int, ...]
    brick_shape_zyx: Zyx

    def __init__(
        self,
        name: str,
        volume_levels: Sequence[Level],
        levels: tuple[int, ...],
        brick_shape_zyx: Zyx,
    ) -> None:
        self.levels = levels
        self._name = name
        self._volume_levels = volume_levels
        self.brick_shape_zyx = brick_shape_zyx

    def __repr__(self) -> str:
        return f"<StoredGradients of levels {self.levels}>"

    @abstractmethod
    def close(self) -> None:
        """Let go of all files and connections."""

    @property
    def code_nbytes(self) -> int:
        """Bytes of a brick of codes."""
        return 3 * int(np.prod(self.brick_shape_zyx))

    @abstractmethod
    def stored_brick(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> bytes | None:
        """A brick's codes as stored, one zstd frame; None where no voxel has a direction.

        Raises:
            InvalidInputError, VolumeFormatError, CorruptBrickError: as `code`.
            ServerUnreachableError: of a volume on a server.
        """

    @abstractmethod
    def _where(self, level: int, zyx: Zyx, t: int, c: int) -> str:
        """The file, or the address, that a brick comes from."""

    def code(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> bytes | None:
        """A brick's codes without the entropy layer; None where no voxel has a direction.

        Raises:
            InvalidInputError: no such level or brick.
            VolumeFormatError: the shard is missing or its index is damaged.
            CorruptBrickError: naming the file and the brick.
        """
        stored = self.stored_brick(level, zyx, t, c)
        if stored is None:
            return None
        try:
            return self.decompressed(stored)
        except CorruptBrickError as error:
            path = self._where(level, zyx, t, c)
            at = [t, c, *zyx]
            raise CorruptBrickError(
                f"{path}: gradients of brick (t, c, z, y, x) = {tuple(at)} of level {level} are "
                f"damaged: {error.message}; restore the file or ingest the volume again",
                **error.facts | {"path": path, "level": level, "brick": at},
            ) from error

    def decompressed(self, stored: bytes) -> bytes:
        """A stored frame without the entropy layer.

        Raises:
            CorruptBrickError: the frame is damaged, or not of a brick's size.
        """
        return zstd_frame.decompress(stored, self.code_nbytes)

    def brick(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> DirectionCodes:
        """The codes of a brick, uint8 (z, y, x, 3), always of the full brick shape.

        Raises:
            InvalidInputError, VolumeFormatError, CorruptBrickError: as `code`.
        """
        return self._shaped(self.code(level, zyx, t, c))

    def read(self, level: int, box: Box | None = None, t: int = 0, c: int = 0) -> DirectionCodes:
        """The codes of a box of a level, uint8 (z, y, x, 3); by default of all of it.

        Raises:
            InvalidInputError: the box is empty or leaves the level, or there is no such level.
            VolumeFormatError, CorruptBrickError: as `code`.
        """
        self._require(level, (0, 0, 0))
        shape_zyx = self._volume_levels[level].shape_zyx
        box = box or Box.of_shape(shape_zyx)
        box.require_within(shape_zyx, f"gradients of level {level}")
        out = np.empty((*box.shape_zyx, 3), np.uint8)
        places = cells_touching(box, self.brick_shape_zyx)
        fill_from_bricks(out, box, self.brick_shape_zyx, self._bricks_at(level, places, t, c))
        return out

    def _bricks_at(
        self, level: int, places: Iterable[Zyx], t: int, c: int
    ) -> Iterator[tuple[Zyx, DirectionCodes]]:
        """What `brick` gives of many places, in any order."""
        for zyx in places:
            yield zyx, self.brick(level, zyx, t, c)

    def _shaped(self, code: bytes | None) -> DirectionCodes:
        shape = (*self.brick_shape_zyx, 3)
        if code is None:
            return np.full(shape, NO_DIRECTION, np.uint8)
        return np.frombuffer(code, np.uint8).reshape(shape)

    def _require(self, level: int, zyx: Zyx) -> None:
        if level not in self.levels:
            raise InvalidInputError(
                f"{self._name}: level {level} has no gradients, levels {list(self.levels)} do",
                level=level,
                levels=list(self.levels),
            )
        grid_zyx = self._volume_levels[level].grid_zyx
        (z, y, x), (nz, ny, nx) = zyx, grid_zyx
        if not (0 <= z < nz and 0 <= y < ny and 0 <= x < nx):
            raise InvalidInputError(
                f"{self._name}: level {level} has no brick (z, y, x) = {zyx}; it has {grid_zyx}",
                level=level,
                brick=list(zyx),
            )


class LocalGradients(StoredGradients):
    """The gradients of a volume on disk."""

    def __init__(
        self,
        path: Path,
        volume_levels: Sequence[Level],
        levels: tuple[int, ...],
        brick_shape_zyx: Zyx,
        shard_shape_zyx: Zyx,
        shard_nbytes: Mapping[str, int],
    ) -> None:
        super().__init__(path.name, volume_levels, levels, brick_shape_zyx)
        self._shards = {
            level: ShardCache(
                path / gradient_array(level),
                shard_shape_zyx,
                _below(f"{gradient_array(level)}/", shard_nbytes),
                key_suffix="/0",
            )
            for level in levels
        }

    def close(self) -> None:
        """Let go of all files."""
        for cache in self._shards.values():
            cache.close()

    def stored_brick(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> bytes | None:
        """A brick's codes as on disk, one zstd frame; None where no voxel has a direction.

        Raises:
            InvalidInputError, VolumeFormatError, CorruptBrickError: as `code`.
        """
        self._require(level, zyx)
        return self._shards[level].read(zyx, t, c)

    def stored_brick_now(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> bytearray | None:
        """The same from memory; BlockingIOError where `stored_brick` would have to wait or fail."""
        self._require(level, zyx)
        return self._shards[level].read_now(zyx, t, c)

    def _where(self, level: int, zyx: Zyx, t: int, c: int) -> str:
        return str(self._shards[level].path_of(zyx, t, c))


def _below(prefix: str, nbytes: Mapping[str, Any]) -> dict[str, int]:
    return {path.removeprefix(prefix): n for path, n in nbytes.items() if path.startswith(prefix)}
