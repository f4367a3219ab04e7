"""Whether a volume is what ingest wrote: every shard, index, brick and range.

Nothing is believed that can be checked: size and digest of a shard against the manifest, the
index against its checksum, every frame against its own, every code by decoding it, and decoded
voxels against the brick's range.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import Zerobit
from octobrick.codec.errors import CorruptDataError
from octobrick.store.box import Box, Zyx, cell_box
from octobrick.store.gradient_pyramid import gradient_array
from octobrick.store.local_volume import LocalVolume
from octobrick.store.opening import open_local
from octobrick.store.progress import ProgressCallback, ProgressMeter
from octobrick.store.shard import new_digest

_READ_NBYTES = 1 << 20


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is not as it was written.

    ``kind`` is ``"shard"`` (missing, or of other size or content), ``"brick"``, ``"range"``,
    ``"fidelity"``, ``"voxels"``, ``"gradients"`` or ``"histogram"`` (not those of the source), or
    ``"stray"`` (a file of nobody). The path is below the volume; the brick is (t, c, z, y, x),
    where it is about one.
    """

    kind: str
    path: str
    message: str
    level: int | None = None
    brick: tuple[int, int, int, int, int] | None = None


@dataclass(frozen=True, slots=True)
class VerifyReport:
    """What was looked at, and what was found."""

    path: str
    revision: str
    shards: int
    bricks: int
    nbytes: int
    against_source: bool
    problems: tuple[Problem, ...]
    elapsed_seconds: float

    @property
    def sound(self) -> bool:
        """Whether all is as it was written."""
        return not self.problems

    def to_dict(self) -> dict[str, Any]:
        """The report as JSON-ready values."""
        return asdict(self) | {"sound": self.sound}


def verify(
    path: str | os.PathLike[str],
    *,
    workers: int | None = None,
    progress: ProgressCallback | None = None,
) -> VerifyReport:
    """Check all of a volume that can be checked without its source.

    Args:
        path: the volume's folder.
        workers: threads; by default one per processor.
        progress: called after each shard, counting voxels of all levels.

    Raises:
        VolumeNotFoundError: there is nothing at the path.
        VolumeFormatError: metadata or manifest are damaged, so that nothing else can be told.
    """
    with (
        open_local(path) as volume,
        ThreadPoolExecutor(workers or len(os.sched_getaffinity(0))) as executor,
    ):
        voxels = [Box.of_shape(level.shape_zyx).nvoxels for level in volume.levels]
        meter = ProgressMeter(volume.nt * volume.nc * sum(voxels), progress)
        problems = list(_strays(volume))
        nbricks = 0
        for level, t, c in itertools.product(
            range(len(volume.levels)), range(volume.nt), range(volume.nc)
        ):
            checker = _Checker(volume, level, t, c)
            problems += checker.problems
            for key, bricks in volume.shard_bricks(level, t, c):
                problems += checker.shard(key)
                for found in executor.map(checker.brick, bricks):
                    problems += found
                nbricks += len(bricks)
                if checker.has_gradients:
                    problems += checker.shard(f"{key}/0", is_gradient=True)
                    for found in executor.map(checker.gradients, bricks):
                        problems += found
                    nbricks += len(bricks)
                meter.advance(sum(checker.box(b).nvoxels for b in bricks), "verify")
        return VerifyReport(
            path=str(volume.path),
            revision=volume.revision,
            shards=len(volume.shard_entries),
            bricks=nbricks,
            nbytes=sum(nbytes for nbytes, _ in volume.shard_entries.values()),
            against_source=False,
            problems=tuple(problems),
            elapsed_seconds=meter.elapsed_seconds,
        )


class _Checker:
    """Checks the shards and bricks of one level of one channel of one time step."""

    def __init__(self, volume: LocalVolume, level: int, t: int, c: int) -> None:
        self._volume, self._level, self._t, self._c = volume, level, t, c
        self._level_box = Box.of_shape(volume.levels[level].shape_zyx)
        self._ranges: NDArray[np.generic] | None = None
        self._fidelity: NDArray[np.float32] | None = None
        self.problems: list[Problem] = []
        try:
            self._ranges = volume.ranges(level, t, c)
        except CorruptDataError as error:
            self.problems.append(Problem("range", f"range/{level}", error.message, level))
        try:
            self._fidelity = volume.fidelity(level, t, c)
        except CorruptDataError as error:
            self.problems.append(Problem("fidelity", f"fidelity/{level}", error.message, level))

    @property
    def has_gradients(self) -> bool:
        """Whether gradients of this level are stored."""
        return self._volume.gradients is not None and self._level in self._volume.gradients.levels

    def shard(self, key: str, *, is_gradient: bool = False) -> list[Problem]:
        """Compare a shard with the manifest."""
        path = f"{gradient_array(self._level) if is_gradient else self._level}/{key}"
        entry = self._volume.shard_entries.get(path)
        if entry is None:
            return []  # all of its bricks are absent
        message = _difference(self._volume.path / path, *entry)
        return [] if message is None else [Problem("shard", path, message, self._level)]

    def brick(self, brick_zyx: Zyx) -> list[Problem]:
        """Decode a brick and compare it with its range."""
        at = (self._t, self._c, *brick_zyx)
        path = f"{self._level}/{self._volume.shard_key(brick_zyx, self._t, self._c)}"
        try:
            voxels = self._volume.brick(self._level, brick_zyx, self._t, self._c)
        except CorruptDataError as error:
            return [Problem("brick", path, error.message, self._level, at)]
        if self._ranges is None:
            return []
        low, high = self._ranges[brick_zyx]
        own = voxels[Box.of_shape(self.box(brick_zyx).shape_zyx).slices]
        slack = self._slack(brick_zyx)
        if float(low) - slack <= float(own.min()) and float(own.max()) <= float(high) + slack:
            return []
        message = (
            f"brick (t, c, z, y, x) = {at} of level {self._level} decodes to {own.min()} to "
            f"{own.max()}, outside its range of {low} to {high}"
        )
        return [Problem("range", path, message, self._level, at)]

    def gradients(self, brick_zyx: Zyx) -> list[Problem]:
        """Read a brick of gradients; any bytes are a direction, so there is no more to check."""
        assert self._volume.gradients is not None
        try:
            self._volume.gradients.code(self._level, brick_zyx, self._t, self._c)
        except CorruptDataError as error:
            at = (self._t, self._c, *brick_zyx)
            key = self._volume.shard_key(brick_zyx, self._t, self._c)
            path = f"{gradient_array(self._level)}/{key}/0"
            return [Problem("brick", path, error.message, self._level, at)]
        return []

    def _slack(self, brick_zyx: Zyx) -> float:
        """How far decoded voxels may leave the range: zerobit's background can be any value."""
        if self._fidelity is None or not isinstance(self._volume.level_codec(self._level), Zerobit):
            return 0.0
        return float(self._fidelity[brick_zyx][0])

    def box(self, brick_zyx: Zyx) -> Box:
        """The voxels of a brick that the level has."""
        return cell_box(brick_zyx, self._volume.brick_shape_zyx).intersect(self._level_box)


def _difference(path: Path, nbytes: int, digest: str) -> str | None:
    """What is wrong with a shard as a file; None if nothing."""
    try:
        actual_nbytes = path.stat().st_size
        if actual_nbytes != nbytes:
            return f"the shard has {actual_nbytes} bytes, the manifest says {nbytes}"
        computed = new_digest()
        with path.open("rb") as file:
            while piece := file.read(_READ_NBYTES):
                computed.update(piece)
    except OSError as error:
        return f"the shard cannot be read: {error.strerror}"
    if computed.hexdigest() != digest:
        return f"the shard's digest is {computed.hexdigest()}, the manifest says {digest}"
    return None


def _strays(volume: LocalVolume) -> Iterator[Problem]:
    """Files among the shards that the manifest does not know."""
    arrays = [(str(level.index), level.index) for level in volume.levels]
    if volume.gradients is not None:
        arrays += [(gradient_array(level), level) for level in volume.gradients.levels]
    for array, level in arrays:
        for path in sorted((volume.path / array / "c").rglob("*")):
            name = str(path.relative_to(volume.path))
            if path.is_file() and name not in volume.shard_entries:
                yield Problem("stray", name, "the manifest does not list this file", level)
