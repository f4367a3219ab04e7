"""Writes the bricks of one level into shards and remembers what each brick lost."""

from __future__ import annotations

from concurrent.futures import Executor
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import metrics
from octobrick.store.box import Box, Zyx, cell_box, grid_of
from octobrick.store.brick_encoder import BrickEncoder, EncodedBrick
from octobrick.store.pyramid import Layer
from octobrick.store.shard import ShardWriter, shard_key, slot_of

PREVIEW_SIDE_MAX = 128  # voxels; up to 2 Mi samples are kept of the level that statistics use


class LevelRecord:
    """What is known of the bricks and shards of one level, of all time steps and channels.

    Attributes:
        ranges: (t, c, nz, ny, nx, 2), least and greatest voxel around each brick.
        fidelity: (t, c, nz, ny, nx, 2), largest absolute error and RMSE.
        errors: over all voxels so far.
        shards: size and digest of every finished shard, by its key.
        preview: planes of a level small enough for statistics, of the first time step; None where
            the level is larger.
    """

    def __init__(
        self, nt: int, nc: int, shape_zyx: Zyx, grid_zyx: Zyx, dtype: np.dtype[np.generic]
    ) -> None:
        self.ranges: NDArray[np.generic] = np.zeros((nt, nc, *grid_zyx, 2), dtype)
        self.fidelity = np.zeros((nt, nc, *grid_zyx, 2), np.float32)
        self.errors = metrics.ErrorStats(0, 0.0, 0.0)
        self.shards: dict[str, tuple[int, str]] = {}
        self.preview: list[NDArray[np.generic]] | None = (
            [] if max(shape_zyx) <= PREVIEW_SIDE_MAX else None
        )

    @property
    def stored_nbytes(self) -> int:
        """Bytes of the level's finished shards."""
        return sum(nbytes for nbytes, _ in self.shards.values())

    def manifest(self, path: str) -> dict[str, dict[str, object]]:
        """The entries of the manifest for the shards of the level at this path."""
        return {
            f"{path}/{key}": {"nbytes": nbytes, "blake2b": digest}
            for key, (nbytes, digest) in sorted(self.shards.items())
        }


class LevelWriter:
    """Takes the layers of one level of one channel in order; encodes in parallel, writes in order.

    Neither the number of workers nor their timing changes a byte.

    Args:
        folder: the level's Zarr array.
        shape_zyx: voxels of the level.
        record: takes what is known of each brick.
        encoder: how bricks are encoded.
        shard_bricks: bricks per shard and axis.
        executor: runs the encoders.
        t: the time step.
        c: the channel.
    """

    def __init__(
        self,
        folder: Path,
        shape_zyx: Zyx,
        record: LevelRecord,
        encoder: BrickEncoder,
        shard_bricks: int,
        executor: Executor,
        t: int,
        c: int,
    ) -> None:
        self._folder = folder
        self._level_box = Box.of_shape(shape_zyx)
        self._record = record
        self._encoder = encoder
        self._executor = executor
        self._tc = (t, c)
        self._brick_zyx: Zyx = (encoder.brick,) * 3
        self._shard_zyx: Zyx = (shard_bricks,) * 3
        self._grid_zyx = grid_of(shape_zyx, self._brick_zyx)
        self.shards_under_way: dict[str, ShardWriter] = {}

    def write(self, layer: Layer) -> None:
        """Encode and append all bricks of a layer; finishes shards that it completes."""
        _, ny, nx = self._grid_zyx
        bricks: list[Zyx] = [(layer.index, y, x) for y in range(ny) for x in range(nx)]
        encode = partial(self._encode, layer)
        for brick_zyx, encoded in zip(bricks, self._executor.map(encode, bricks), strict=True):
            self._note(brick_zyx, encoded)
        if self._record.preview is not None and self._tc[0] == 0:
            self._record.preview.append(self._core(layer).copy())
        last = layer.index + 1 == self._grid_zyx[0]
        if last or (layer.index + 1) % self._shard_zyx[0] == 0:
            self._finish_shards()

    def resume_shard(self, key: str, index: NDArray[np.uint64], nbytes: int) -> None:
        """Take up a shard that was under way at a checkpoint; raises `ShardWriter.resume`'s."""
        self.shards_under_way[key] = ShardWriter.resume(self._folder / key, index, nbytes)

    def _encode(self, layer: Layer, brick_zyx: Zyx) -> EncodedBrick:
        nz, (_, ny, nx) = len(layer.planes), self._level_box.shape_zyx
        window_box = Box((layer.first_z, 0, 0), (layer.first_z + nz, ny, nx))
        brick_box = cell_box(brick_zyx, self._brick_zyx)
        return self._encoder.encode(layer.planes, window_box, brick_box, self._level_box)

    def _note(self, brick_zyx: Zyx, encoded: EncodedBrick) -> None:
        record, at = self._record, (*self._tc, *brick_zyx)
        record.ranges[at] = (encoded.low, encoded.high)
        record.fidelity[at] = (round_up(encoded.errors.max_abs), encoded.errors.rmse)
        record.errors = record.errors + encoded.errors
        if encoded.frame is None:
            return
        t, c = self._tc
        key = shard_key(brick_zyx, self._shard_zyx, t, c)
        writer = self.shards_under_way.get(key)
        if writer is None:
            nslots = int(np.prod(self._shard_zyx))
            writer = self.shards_under_way[key] = ShardWriter(self._folder / key, nslots)
        writer.append(slot_of(brick_zyx, self._shard_zyx), encoded.frame)

    def _core(self, layer: Layer) -> NDArray[np.generic]:
        start = layer.index * self._encoder.brick - layer.first_z
        return layer.planes[start : start + self._encoder.brick]

    def _finish_shards(self) -> None:
        for key, writer in self.shards_under_way.items():
            self._record.shards[key] = writer.finish()
        self.shards_under_way.clear()


def round_up(value: float) -> np.float32:
    """The float32 at or above a value: a stated bound must not be below the true one."""
    rounded = np.float32(value)
    return rounded if rounded >= value else np.nextafter(rounded, np.float32(np.inf))
