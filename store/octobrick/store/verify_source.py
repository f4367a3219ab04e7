"""Whether a volume holds what its source does: voxels, ranges and fidelity, brick by brick."""

from __future__ import annotations

import dataclasses
import os

import numpy as np

from octobrick.codec import metrics
from octobrick.codec.errors import CorruptDataError
from octobrick.store.brick_encoder import EncodedBrick
from octobrick.store.local_volume import LocalVolume
from octobrick.store.opening import open_local
from octobrick.store.progress import ProgressCallback, ProgressMeter
from octobrick.store.pyramid import Address
from octobrick.store.rebuild import Rebuild, source_of
from octobrick.store.sources import Source
from octobrick.store.verify import Problem, VerifyReport, verify
from octobrick.store.volume_writer import round_up, shard_key_of


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
    known = {(p.path, p.brick) for p in report.problems if p.brick}
    with open_local(path) as volume:
        prepared = source_of(volume, source)
        nz, ny, nx = prepared.shape_zyx
        meter = ProgressMeter(prepared.nt * prepared.nc * nz * ny * nx, progress)
        comparison = _Comparison(volume)
        nworkers = workers or len(os.sched_getaffinity(0))
        Rebuild(volume, prepared, comparison, replace_nonfinite, nworkers).run(meter)
        comparison.end()
    found = [p for p in comparison.problems if (p.path, p.brick) not in known]
    return dataclasses.replace(
        report,
        against_source=True,
        problems=(*report.problems, *found),
        elapsed_seconds=report.elapsed_seconds + meter.elapsed_seconds,
    )


class _Comparison:
    """Bricks as they are stored against bricks as the source gives them; a `Sink`."""

    def __init__(self, volume: LocalVolume) -> None:
        self._volume = volume
        self._tables: dict[tuple[str, int, int, int], np.ndarray | None] = {}
        self._histograms = [metrics.Histogram() for _ in range(volume.nc)]
        self.problems: list[Problem] = []

    def wants(self, _: Address) -> bool:
        return True

    def take(self, address: Address, encoded: EncodedBrick) -> None:
        volume, (array, t, c, brick_zyx) = self._volume, address
        level, is_gradient = int(array.rpartition("/")[2]), not array.isdecimal()
        code = volume.brick_code
        if is_gradient and volume.gradients is not None:
            code = volume.gradients.code
        try:
            stored = code(level, brick_zyx, t, c)
        except CorruptDataError:
            return  # verify has said so
        made = None
        if encoded.frame is not None and is_gradient and volume.gradients is not None:
            made = volume.gradients.decompressed(encoded.frame)
        elif encoded.frame is not None:
            made = volume.decompressed(encoded.frame, level)
        if stored != made:
            what = "gradients" if is_gradient else "voxels"
            self._add(what, address, level, f"does not hold the {what} of the source")
        if not is_gradient:
            self._compare_tables(address, level, encoded)

    def count(self, t: int, c: int, histogram: metrics.Histogram) -> None:  # noqa: ARG002
        self._histograms[c] += histogram

    def end_layer(self, array: str, t: int, c: int, index: int) -> None:
        pass

    def end(self) -> None:
        """Compare what is known of all bricks together."""
        for c, (found, stored) in enumerate(
            zip(self._histograms, self._volume.histograms, strict=True)
        ):
            same = (found.exponent, found.first) == (stored.exponent, stored.first)
            if not (same and np.array_equal(found.counts, stored.counts)):
                message = f"the histogram of channel {c} is not that of the source's voxels"
                self.problems.append(Problem("histogram", "zarr.json", message))

    def _compare_tables(self, address: Address, level: int, encoded: EncodedBrick) -> None:
        _, t, c, brick_zyx = address
        ranges = self._table("ranges", level, t, c)
        if ranges is not None and tuple(ranges[brick_zyx]) != (encoded.low, encoded.high):
            low, high = ranges[brick_zyx]
            self._add(
                "range",
                address,
                level,
                f"has a range of {low} to {high}, the source gives {encoded.low} to {encoded.high}",
            )
        fidelity = self._table("fidelity", level, t, c)
        errors = (round_up(encoded.errors.max_abs), np.float32(encoded.errors.rmse))
        if fidelity is not None and tuple(fidelity[brick_zyx]) != errors:
            worst, rmse = fidelity[brick_zyx]
            self._add(
                "fidelity",
                address,
                level,
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

    def _add(self, kind: str, address: Address, level: int, what: str) -> None:
        at = (address.t, address.c, *address.zyx)
        path = f"{address.array}/{shard_key_of(address, self._volume.shard_shape_zyx)}"
        message = f"brick (t, c, z, y, x) = {at} of level {level} {what}"
        self.problems.append(Problem(kind, path, message, level, at))
