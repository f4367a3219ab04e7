"""Writes the bricks of a volume into shards and remembers what each brick lost."""

from __future__ import annotations

from concurrent.futures import Executor
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import metrics
from octobrick.store.box import Zyx, grid_of
from octobrick.store.brick_encoder import EncodedBrick
from octobrick.store.gradient_pyramid import gradient_array
from octobrick.store.pyramid import Address
from octobrick.store.shard import ShardWriter, shard_key, slot_of

_OPEN_SHARDS_MAX = 64  # files; well under ulimit -n of 1024


class ArrayRecord:
    """What is known of the shards of one array, of all time steps and channels.

    Attributes:
        grid_zyx: bricks of each time step and channel.
        shards: size and digest of every finished shard, by its key.
    """

    def __init__(self, grid_zyx: Zyx) -> None:
        self.grid_zyx = grid_zyx
        self.shards: dict[str, tuple[int, str]] = {}

    @property
    def stored_nbytes(self) -> int:
        """Bytes of the array's finished shards."""
        return sum(nbytes for nbytes, _ in self.shards.values())

    def manifest(self, path: str) -> dict[str, dict[str, object]]:
        """The entries of the manifest for the shards of the array at this path."""
        return {
            f"{path}/{key}": {"nbytes": nbytes, "xxh3_128": digest}
            for key, (nbytes, digest) in sorted(self.shards.items())
        }


class LevelRecord(ArrayRecord):
    """What is known of the bricks of one level of voxels.

    Attributes:
        ranges: (t, c, nz, ny, nx, 2), least and greatest voxel around each brick.
        fidelity: (t, c, nz, ny, nx, 2), largest absolute error and RMSE.
        errors: over all voxels so far.
    """

    def __init__(self, nt: int, nc: int, grid_zyx: Zyx, dtype: np.dtype[np.generic]) -> None:
        super().__init__(grid_zyx)
        self.ranges: NDArray[np.generic] = np.zeros((nt, nc, *grid_zyx, 2), dtype)
        self.fidelity = np.zeros((nt, nc, *grid_zyx, 2), np.float32)
        self.errors = metrics.ErrorStats(0, 0.0, 0.0)

    def note(self, address: Address, encoded: EncodedBrick) -> None:
        """Remember what is known of a brick."""
        at = (address.t, address.c, *address.zyx)
        self.ranges[at] = (encoded.low, encoded.high)
        self.fidelity[at] = (round_up(encoded.errors.max_abs), encoded.errors.rmse)
        self.errors = self.errors + encoded.errors


class VolumeRecord:
    """What is known of a volume that is being written.

    Attributes:
        levels: of voxels.
        gradients: the same of each level of gradients, by its number.
        histograms: of each channel, over all time steps.
    """

    def __init__(
        self,
        nt: int,
        nc: int,
        shapes_zyx: tuple[Zyx, ...],
        brick: int,
        dtype: np.dtype[np.generic],
        *,
        has_gradients: bool,
    ) -> None:
        grids = [grid_of(shape, (brick,) * 3) for shape in shapes_zyx]
        self.levels = [LevelRecord(nt, nc, grid, dtype) for grid in grids]
        self.gradients = {
            level: ArrayRecord(grid) for level, grid in enumerate(grids) if level and has_gradients
        }
        self.histograms = [metrics.Histogram() for _ in range(nc)]

    @property
    def arrays(self) -> dict[str, ArrayRecord]:
        """All that have shards, by their paths."""
        levels: dict[str, ArrayRecord] = {str(i): level for i, level in enumerate(self.levels)}
        return levels | {gradient_array(i): record for i, record in self.gradients.items()}


class VolumeWriter:
    """Takes the bricks of a volume in order and appends them to their shards.

    Args:
        folder: the volume.
        record: takes what is known of each brick.
        shard_bricks: bricks per shard and axis.
        executor: finishes shards.
    """

    def __init__(
        self, folder: Path, record: VolumeRecord, shard_bricks: int, executor: Executor
    ) -> None:
        self._folder = folder
        self._record = record
        self._arrays = record.arrays
        self._shard_zyx: Zyx = (shard_bricks,) * 3
        self._executor = executor
        self._open: dict[ShardWriter, None] = {}  # the least recently written first
        self.shards_under_way: dict[tuple[str, int, int], dict[str, ShardWriter]] = {}

    def wants(self, _: Address) -> bool:
        """See `Sink.wants`: all of them."""
        return True

    def take(self, address: Address, encoded: EncodedBrick) -> None:
        """See `Sink.take`."""
        array = self._arrays[address.array]
        if isinstance(array, LevelRecord):
            array.note(address, encoded)
        if encoded.frame is None:
            return
        key = shard_key_of(address, self._shard_zyx)
        shards = self._under_way(address.array, address.t, address.c)
        writer = shards.get(key)
        if writer is None:
            nslots = int(np.prod(self._shard_zyx))
            writer = shards[key] = ShardWriter(self._folder / address.array / key, nslots)
        writer.append(slot_of(address.zyx, self._shard_zyx), encoded.frame)
        self._keep_open(writer)

    def count(self, t: int, c: int, histogram: metrics.Histogram) -> None:  # noqa: ARG002
        """See `Sink.count`."""
        self._record.histograms[c] += histogram

    def end_layer(self, array: str, t: int, c: int, index: int) -> None:
        """See `Sink.end_layer`: finish the shards that the layer completes."""
        nlayers, nshard = self._arrays[array].grid_zyx[0], self._shard_zyx[0]
        if index + 1 != nlayers and (index + 1) % nshard:
            return
        finished = self.shards_under_way.pop((array, t, c), {})
        for writer in finished.values():
            self._open.pop(writer, None)
        # Side by side: a disk writes many files at once sooner than one after the other.
        ended = self._executor.map(ShardWriter.finish, finished.values())
        self._arrays[array].shards.update(zip(finished, ended, strict=True))

    def resume_shard(
        self, array: str, t: int, c: int, key: str, index: NDArray[np.uint64], nbytes: int
    ) -> None:
        """Take up a shard that was under way at a checkpoint; raises `ShardWriter.resume`'s."""
        path = self._folder / array / key
        self._under_way(array, t, c)[key] = ShardWriter.resume(path, index, nbytes)

    def _keep_open(self, writer: ShardWriter) -> None:
        """Let go of the file that was written to longest ago, when too many are open."""
        self._open.pop(writer, None)
        self._open[writer] = None
        if len(self._open) > _OPEN_SHARDS_MAX:
            next(iter(self._open)).release()
            del self._open[next(iter(self._open))]

    def _under_way(self, array: str, t: int, c: int) -> dict[str, ShardWriter]:
        return self.shards_under_way.setdefault((array, t, c), {})


def shard_key_of(address: Address, shard_zyx: Zyx) -> str:
    """The path of a brick's shard below its array."""
    key = shard_key(address.zyx, shard_zyx, address.t, address.c)
    # The components of vectors are an axis more, which is never cut.
    return key if address.array.isdecimal() else f"{key}/0"


def round_up(value: float) -> np.float32:
    """The float32 at or above a value: a stated bound must not be below the true one."""
    rounded = np.float32(value)
    return rounded if rounded >= value else np.nextafter(rounded, np.float32(np.inf))
