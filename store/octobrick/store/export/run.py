"""A region of a volume into a file of another format, streamed, visible only when complete."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from octobrick.codec.errors import InvalidInputError
from octobrick.store.box import Box
from octobrick.store.export.formats import ExportFormat, format_of
from octobrick.store.export.ome_zarr import levels_of
from octobrick.store.export.options import WriterOptions
from octobrick.store.export.region import Region
from octobrick.store.export.result import ExportResult
from octobrick.store.local_volume import LocalVolume
from octobrick.store.opening import open_volume
from octobrick.store.progress import ProgressCallback, ProgressMeter, peak_rss_nbytes
from octobrick.store.staging import staged_file, staged_folder
from octobrick.store.volume import Volume


def export(
    volume: Volume | str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    level: int = 0,
    box: Box | None = None,
    t: int = 0,
    c: int = 0,
    compress: bool = False,
    active: tuple[float, float] | None = None,
    overwrite: bool = False,
    workers: int | None = None,
    progress: ProgressCallback | None = None,
) -> ExportResult:
    """Write a region of a volume to a file whose name says the format.

    Memory holds one layer of bricks, at most 512 MiB, or one shard of an OME-Zarr. Spacing, unit,
    origin and direction go with the voxels where the format holds them; the result's warnings
    say where it does not.

    Args:
        volume: open, or its folder or address.
        out: ``NAME`` with one of ``EXPORT_SUFFIXES``. An ``.ome.zarr`` gets all coarser levels too.
        level: which level.
        box: in voxels of that level; by default all of it.
        t: time step.
        c: channel.
        compress: gzip data in ``.nrrd``, zlib in ``.tif``; ``.nii.gz`` and OME-Zarr always are.
        active: lowest and highest value of the voxels that a ``.vdb`` keeps; by default all. Its
            memory grows with them.
        overwrite: replace what is already there, if it is of the same kind.
        workers: decoding threads; by default one per processor.
        progress: called after each piece that was written.

    Raises:
        InvalidInputError: a name that says no format; no such level, box, time step or channel.
        UnsupportedError: a sample type that the format does not have.
        DestinationExistsError: there is something at ``out``.
        DestinationError: the system refuses to write.
        CorruptBrickError: a damaged brick, naming the file.
        ResourceError: a package is missing.
    """
    out = Path(out)
    if workers is not None and not 1 <= workers <= 1024:
        raise InvalidInputError(f"workers {workers}: must be 1 to 1024", workers=workers)
    options = WriterOptions(compress=compress, active=active)
    format_ = format_of(out, options)
    with contextlib.ExitStack() as stack:
        if not isinstance(volume, Volume):
            volume = stack.enter_context(open_volume(volume))
        if isinstance(volume, LocalVolume):
            _refuse_inside(out, volume)
        region = Region(volume, level, box, t, c, workers=workers)
        levels = list(levels_of(region)) if format_.is_folder else [region]
        meter = ProgressMeter(sum(each.box.nvoxels for each in levels), progress)
        region.meter = meter
        with _staged(out, format_, overwrite=overwrite) as partial:
            warnings = format_.write(region, partial, options)
        elapsed = meter.elapsed_seconds
        return ExportResult(
            path=str(out),
            format=format_.name,
            dtype=region.dtype.name,
            shape_zyx=region.shape_zyx,
            level=level,
            levels=len(levels),
            spacing_zyx=region.spacing_xyz[::-1],
            origin_xyz=region.origin_xyz,
            unit=region.unit,
            max_error=region.level.max_error,
            nbytes=_nbytes(out),
            warnings=tuple(warnings),
            elapsed_seconds=elapsed,
            megabytes_per_second=sum(each.nbytes for each in levels) / 1e6 / max(elapsed, 1e-9),
            peak_rss_nbytes=peak_rss_nbytes(),
        )


@contextlib.contextmanager
def _staged(out: Path, format_: ExportFormat, *, overwrite: bool) -> Iterator[Path]:
    if format_.is_folder:
        with staged_folder(out, overwrite=overwrite, marker="zarr.json") as partial:
            yield partial
    else:
        with staged_file(out, overwrite=overwrite) as partial:
            yield partial


def _refuse_inside(out: Path, volume: LocalVolume) -> None:
    """A volume is not to be replaced by, or to hold, what is read from it."""
    folder, target = volume.path.resolve(), out.resolve()
    if target == folder or folder in target.parents or target in folder.parents:
        raise InvalidInputError(
            f"{out}: is the volume that is exported, or lies inside it or around it; choose "
            "another name",
            path=str(out),
        )


def _nbytes(out: Path) -> int:
    if out.is_file():
        return out.stat().st_size
    return sum(path.stat().st_size for path in out.rglob("*") if path.is_file())
