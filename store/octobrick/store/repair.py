"""Writes damaged shards of a volume anew from its source; all others are left alone."""

from __future__ import annotations

import os
import shutil
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from octobrick.codec import metrics
from octobrick.store.brick_encoder import EncodedBrick
from octobrick.store.durable import sync
from octobrick.store.errors import SourceMismatchError
from octobrick.store.local_volume import LocalVolume
from octobrick.store.opening import open_local
from octobrick.store.progress import ProgressCallback, ProgressMeter
from octobrick.store.pyramid import Address
from octobrick.store.rebuild import Rebuild, source_of
from octobrick.store.shard import ShardWriter, slot_of
from octobrick.store.sources import Source
from octobrick.store.verify import Problem, verify
from octobrick.store.volume_writer import shard_key_of

_FOLDER = ".repair"  # inside the volume: on the same file system, so that a rename is enough


@dataclass(frozen=True, slots=True)
class RepairResult:
    """What a repair did.

    Attributes:
        repaired: paths of the shards that were written anew.
        removed: paths of stray files that are gone.
        left: problems that only a new ingest can mend.
    """

    repaired: tuple[str, ...]
    removed: tuple[str, ...]
    left: tuple[Problem, ...]

    def to_dict(self) -> dict[str, Any]:
        """The result as JSON-ready values."""
        return asdict(self)


def repair(
    path: str | os.PathLike[str],
    source: Source,
    *,
    replace_nonfinite: float | None = None,
    workers: int | None = None,
    progress: ProgressCallback | None = None,
) -> RepairResult:
    """Find what is damaged and write it anew, byte for byte as it was.

    A shard takes its place only when its digest is the one in the manifest, so a wrong source
    changes nothing.

    Args:
        path: the volume's folder.
        source: what the volume was made from, open.
        replace_nonfinite: as it was when the volume was made.
        workers: threads; by default one per processor.
        progress: called after each piece of the source.

    Raises:
        SourceMismatchError: the source does not give the voxels that the volume was made from.
        VolumeFormatError: metadata or manifest are damaged.
    """
    found = verify(path, workers=workers).problems
    with open_local(path) as volume:
        damaged = {p.path for p in found if p.kind in ("shard", "brick")}
        damaged &= set(volume.shard_entries)
        strays = [p.path for p in found if p.kind == "stray"]
        if damaged:
            made = _Repair(volume, source_of(volume, source), damaged, replace_nonfinite)
            made.run(workers or len(os.sched_getaffinity(0)), progress)
        for name in strays:
            (volume.path / name).unlink(missing_ok=True)
    left = verify(path, workers=workers).problems if found else ()
    return RepairResult(tuple(sorted(damaged)), tuple(strays), left)


class _Repair:
    """Takes the bricks of damaged shards; a `Sink`."""

    def __init__(
        self,
        volume: LocalVolume,
        source: Source,
        damaged: set[str],
        replace_nonfinite: float | None,
    ) -> None:
        self._volume = volume
        self._source = source
        self._damaged = damaged
        self._replace_nonfinite = replace_nonfinite
        self._folder = volume.path / _FOLDER
        self._shard_zyx = volume.shard_shape_zyx
        self._writers: dict[str, ShardWriter] = {}

    def run(self, nworkers: int, progress: ProgressCallback | None) -> None:
        source = self._source
        nz, ny, nx = source.shape_zyx
        meter = ProgressMeter(source.nt * source.nc * nz * ny * nx, progress)
        shutil.rmtree(self._folder, ignore_errors=True)
        try:
            Rebuild(self._volume, source, self, self._replace_nonfinite, nworkers).run(meter)
            self._put_in_place()
        finally:
            shutil.rmtree(self._folder, ignore_errors=True)

    def _path_of(self, address: Address) -> str:
        return f"{address.array}/{shard_key_of(address, self._shard_zyx)}"

    def wants(self, address: Address) -> bool:
        return self._path_of(address) in self._damaged

    def take(self, address: Address, encoded: EncodedBrick) -> None:
        if encoded.frame is None:
            return
        path = self._path_of(address)
        writer = self._writers.get(path)
        if writer is None:
            nslots = int(np.prod(self._shard_zyx))
            writer = self._writers[path] = ShardWriter(self._folder / path, nslots)
        writer.append(slot_of(address.zyx, self._shard_zyx), encoded.frame)

    def count(self, t: int, c: int, histogram: metrics.Histogram) -> None:
        pass  # what is in the metadata is not mended

    def end_layer(self, array: str, t: int, c: int, index: int) -> None:
        pass  # shards are finished together, or none of them

    def _put_in_place(self) -> None:
        """Rename all shards, or, if one is not as it was, none."""
        for path in sorted(self._damaged):
            writer = self._writers.get(path)
            made = writer.finish() if writer else (0, "of no brick")
            wanted = self._volume.shard_entries[path]
            if made != wanted:
                raise SourceMismatchError(
                    f"{self._source.path}: gives shard {path} of {self._volume.path} with "
                    f"{made[0]} bytes and digest {made[1]}, it had {wanted[0]} and {wanted[1]}; "
                    "give the source and options that the volume was made from, or ingest again",
                    path=str(self._source.path),
                    shard=path,
                )
        for path in sorted(self._damaged):
            _replace(self._folder / path, self._volume.path / path)


def _replace(made: Path, place: Path) -> None:
    place.parent.mkdir(parents=True, exist_ok=True)
    made.replace(place)
    sync(place.parent)
