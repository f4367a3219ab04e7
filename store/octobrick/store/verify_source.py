"""Whether a volume holds what its source does: voxels, ranges and fidelity, brick by brick."""

from __future__ import annotations

import dataclasses
import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from octobrick.codec.errors import CorruptDataError
from octobrick.store.brick_encoder import EncodedBrick
from octobrick.store.level_writer import round_up
from octobrick.store.progress import ProgressCallback, ProgressMeter
from octobrick.store.rebuild import Address, Rebuild, source_of
from octobrick.store.sources import Source
from octobrick.store.verify import Problem, VerifyReport, verify
from octobrick.store.volume import Volume, open_volume


def verify_against(
    path: str | os.PathLike[str],
    source: Source,
    *,
    replace_nonfinite: float | None = None,
    workers: int | None = None,
    progress: ProgressCallback | None = None,
) -> VerifyReport:
    """All that `verify` checks, and every brick against the one that the source gives.

    Every brick is encoded again; its code, range, largest error and RMSE must be those stored.

    Args:
        path: the volume's folder.
        source: what the volume was made from, open.
        replace_nonfinite: as it was when the volume was made.
        workers: threads; by default one per processor.
        progress: called after each piece of the source.

    Raises:
        SourceMismatchError: the source has another shape or type than the volume.
        VolumeNotFoundError, VolumeFormatError: as `verify`.
    """
    report = verify(path, workers=workers)
    known = {(p.level, p.brick) for p in report.problems if p.brick}
    with (
        open_volume(path) as volume,
        ThreadPoolExecutor(workers or len(os.sched_getaffinity(0))) as executor,
    ):
        prepared = source_of(volume, source)
        nz, ny, nx = prepared.shape_zyx
        meter = ProgressMeter(prepared.nt * prepared.nc * nz * ny * nx, progress)
        comparison = _Comparison(volume)
        Rebuild(volume, prepared, lambda _: True, comparison.take, replace_nonfinite).run(
            executor, meter
        )
    found = [p for p in comparison.problems if (p.level, p.brick) not in known]
    return dataclasses.replace(
        report,
        against_source=True,
        problems=(*report.problems, *found),
        elapsed_seconds=report.elapsed_seconds + meter.elapsed_seconds,
    )


class _Comparison:
    """Bricks as they are stored against bricks as the source gives them."""

    def __init__(self, volume: Volume) -> None:
        self._volume = volume
        self._tables: dict[tuple[str, int, int, int], np.ndarray | None] = {}
        self.problems: list[Problem] = []

    def take(self, address: Address, encoded: EncodedBrick) -> None:
        level, t, c, brick_zyx = address
        try:
            stored = self._volume.brick_code(level, brick_zyx, t, c)
        except CorruptDataError:
            return  # verify has said so
        made = None if encoded.frame is None else self._volume.decompressed(encoded.frame, level)
        if stored != made:
            self._add("voxels", address, "does not hold the voxels of the source")
        ranges = self._table("ranges", level, t, c)
        if ranges is not None and tuple(ranges[brick_zyx]) != (encoded.low, encoded.high):
            low, high = ranges[brick_zyx]
            self._add(
                "range",
                address,
                f"has a range of {low} to {high}, the source gives {encoded.low} to {encoded.high}",
            )
        fidelity = self._table("fidelity", level, t, c)
        errors = (round_up(encoded.errors.max_abs), np.float32(encoded.errors.rmse))
        if fidelity is not None and tuple(fidelity[brick_zyx]) != errors:
            worst, rmse = fidelity[brick_zyx]
            self._add(
                "fidelity",
                address,
                f"is said to be off by {worst} at most and {rmse} RMS, measured against the source "
                f"it is {errors[0]} and {errors[1]}",
            )

    def _table(self, name: str, level: int, t: int, c: int) -> np.ndarray | None:
        key = (name, level, t, c)
        if key not in self._tables:
            try:
                self._tables[key] = getattr(self._volume, name)(level, t, c)
            except CorruptDataError:
                self._tables[key] = None
        return self._tables[key]

    def _add(self, kind: str, address: Address, what: str) -> None:
        level, t, c, brick_zyx = address
        at = (t, c, *brick_zyx)
        path = f"{level}/{self._volume.shard_key(brick_zyx, t, c)}"
        message = f"brick (t, c, z, y, x) = {at} of level {level} {what}"
        self.problems.append(Problem(kind, path, message, level, at))
