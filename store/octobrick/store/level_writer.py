"""Writes the bricks of one level into shards and remembers what each brick lost."""

from __future__ import annotations

from collections.abc import Iterator
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


class LevelWriter:
    """Takes the layers of one level in order; encodes in parallel, writes in a fixed order.

    Neither the number of workers nor their timing changes a byte.

    Args:
        folder: the level's Zarr array.
        shape_zyx: voxels of the level.
        dtype: sample type.
        encoder: how bricks are encoded.
        shard_bricks: bricks per shard and axis.
        executor: runs the encoders.
    """

    def __init__(
        self,
        folder: Path,
        shape_zyx: Zyx,
        dtype: np.dtype[np.generic],
        encoder: BrickEncoder,
        shard_bricks: int,
        executor: Executor,
    ) -> None:
        self._folder = folder
        self._level_box = Box.of_shape(shape_zyx)
        self._encoder = encoder
        self._executor = executor
        self._brick_zyx: Zyx = (encoder.brick,) * 3
        self._shard_zyx: Zyx = (shard_bricks,) * 3
        self._writers: dict[str, ShardWriter] = {}
        self.grid_zyx = grid_of(shape_zyx, self._brick_zyx)
        self.ranges: NDArray[np.generic] = np.empty((*self.grid_zyx, 2), dtype)
        self.fidelity = np.zeros((*self.grid_zyx, 2), np.float32)
        self.errors = metrics.ErrorStats(0, 0.0, 0.0)
        self.shards: dict[str, tuple[int, str]] = {}  # key: (nbytes, digest) of finished shards
        self.preview: list[NDArray[np.generic]] | None = (
            [] if max(shape_zyx) <= PREVIEW_SIDE_MAX else None
        )

    def write(self, layer: Layer) -> None:
        """Encode and append all bricks of a layer; finishes shards that it completes."""
        _, ny, nx = self.grid_zyx
        bricks: list[Zyx] = [(layer.index, y, x) for y in range(ny) for x in range(nx)]
        encode = partial(self._encode, layer)
        for brick_zyx, encoded in zip(bricks, self._executor.map(encode, bricks), strict=True):
            self._record(brick_zyx, encoded)
        if self.preview is not None:
            self.preview.append(self._core(layer).copy())
        last = layer.index + 1 == self.grid_zyx[0]
        if last or (layer.index + 1) % self._shard_zyx[0] == 0:
            self._finish_shards()

    @property
    def stored_nbytes(self) -> int:
        """Bytes of the level's finished shards."""
        return sum(nbytes for nbytes, _ in self.shards.values())

    def _encode(self, layer: Layer, brick_zyx: Zyx) -> EncodedBrick:
        nz, (_, ny, nx) = len(layer.planes), self._level_box.shape_zyx
        window_box = Box((layer.first_z, 0, 0), (layer.first_z + nz, ny, nx))
        brick_box = cell_box(brick_zyx, self._brick_zyx)
        return self._encoder.encode(layer.planes, window_box, brick_box, self._level_box)

    def _record(self, brick_zyx: Zyx, encoded: EncodedBrick) -> None:
        self.ranges[brick_zyx] = (encoded.low, encoded.high)
        self.fidelity[brick_zyx] = (_round_up(encoded.errors.max_abs), encoded.errors.rmse)
        self.errors = self.errors + encoded.errors
        if encoded.frame is None:
            return
        key = shard_key(brick_zyx, self._shard_zyx, t=0, c=0)
        writer = self._writers.get(key)
        if writer is None:
            nslots = int(np.prod(self._shard_zyx))
            writer = self._writers[key] = ShardWriter(self._folder / key, nslots)
        writer.append(slot_of(brick_zyx, self._shard_zyx), encoded.frame)

    def _core(self, layer: Layer) -> NDArray[np.generic]:
        start = layer.index * self._encoder.brick - layer.first_z
        return layer.planes[start : start + self._encoder.brick]

    def _finish_shards(self) -> None:
        for key, writer in self._writers.items():
            self.shards[key] = writer.finish()
        self._writers.clear()


def _round_up(value: float) -> np.float32:
    """The float32 at or above a value: a stated bound must not be below the true one."""
    rounded = np.float32(value)
    return rounded if rounded >= value else np.nextafter(rounded, np.float32(np.inf))


def iter_manifest(path: str, writer: LevelWriter) -> Iterator[tuple[str, dict[str, object]]]:
    """The manifest's entries for the shards of one level."""
    for key, (nbytes, digest) in sorted(writer.shards.items()):
        yield f"{path}/{key}", {"nbytes": nbytes, "blake2b": digest}
