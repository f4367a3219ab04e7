"""From any source to a volume of compressed bricks, in one pass, with memory bounded by a slab."""

from __future__ import annotations

import os
import threading
from collections.abc import Sequence
from pathlib import Path

from numpy.typing import DTypeLike

from octobrick.store.box import Box, Zyx
from octobrick.store.brick_codec import BrickCodec
from octobrick.store.camera_grid import CameraStep
from octobrick.store.destination import staged
from octobrick.store.ingest_options import DEFAULT_CODEC, IngestOptions
from octobrick.store.ingest_plan import IngestPlan
from octobrick.store.ingest_run import IngestRun
from octobrick.store.progress import ProgressCallback
from octobrick.store.report import IngestResult
from octobrick.store.sources import Source, open_source
from octobrick.store.sources.converted import converted
from octobrick.store.sources.region import RegionSource
from octobrick.store.surface import Mesh, Placement
from octobrick.store.surface.option import surface_option
from octobrick.store.surface.placement import UpAxis


def ingest(
    source: str | os.PathLike[str],
    dest: str | os.PathLike[str],
    *,
    codec: BrickCodec | Sequence[BrickCodec] = DEFAULT_CODEC,
    psnr: float | None = None,
    ratio: float | None = None,
    brick: int = 64,
    shard: int = 4,
    zstd_level: int | None = None,
    levels: int | None = None,
    reducer: str | None = None,
    gradients: bool = False,
    labels: bool | None = None,
    convert: str | None = None,
    window: tuple[float, float] | None = None,
    region: Box | None = None,
    replace_nonfinite: float | None = None,
    overwrite: bool = False,
    restart: bool = False,
    workers: int | None = None,
    memory: int | None = None,
    checkpoint_seconds: float = 5.0,
    progress: ProgressCallback | None = None,
    cancel: threading.Event | None = None,
    shape: Zyx | None = None,
    dtype: DTypeLike | None = None,
    spacing: tuple[float, float, float] | None = None,
    offset: int = 0,
    big_endian: bool = False,
    dataset: str | None = None,
    axes: str | None = None,
    cameras: CameraStep | None = None,
    surface: Mesh | str | os.PathLike[str] | None = None,
    surface_placement: Placement | None = None,
    surface_up: UpAxis = "z",
) -> IngestResult:
    """Read a source once and write a volume of all levels, visible only when complete.

    An ingest that was killed, cancelled, or stopped by a full disk or a lost source goes on from
    its last checkpoint when it is called again with the same source and options, and ends with the
    same bytes as if nothing had happened.

    Args:
        source: a file of a format that :mod:`octobrick.store.sources` reads.
        dest: the volume's folder, by custom ``NAME.zarr``.
        codec: what bricks are coded by, S3dc or Zerobit, or None to keep voxels exactly; labels
            are kept exactly unless told otherwise. Several are of the levels, finest first, the
            last of them of all coarser ones too.
        psnr: in dB, what each level is to have; its codec is found by coding bricks of the source
            before the ingest begins, so ``codec`` then is S3dc or Zerobit without a rate, by
            default S3dc with blocks of 4³. docs/cli.md tells how.
        ratio: bytes of the voxels over bytes on disk that each level is to have, likewise.
        brick: voxels per brick and axis, even, 8 to 256.
        shard: bricks per shard and axis.
        zstd_level: effort of the entropy layer, 1 to 19; by default 1 behind a code, and 3 where
            voxels are kept exactly.
        levels: how many; by default until one brick holds the coarsest.
        reducer: what makes a coarser voxel of 2×2×2: ``"mean"``, ``"max"``, ``"min"``, ``"mode"``
            or ``"nearest"``; by default mode for labels, else mean.
        gradients: also store the directions of gradients of all levels but the finest, in three
            bytes each, for shading.
        labels: whether voxels are names, not quantities; by default what the source says.
        convert: the sample type to store, where it is not the source's.
        window: the values that become the ends of the type that voxels are converted to.
        region: the box of voxels to store, of the source; by default all. A stop of −1 is the end.
        replace_nonfinite: what stands for NaN and ±Inf; by default they are refused.
        overwrite: replace a volume that is already there.
        restart: forget what an ingest left that did not finish, instead of going on.
        workers: encoding threads; by default one per processor. The bytes do not depend on it.
        memory: bytes that the process may take, about; by default half of the system's. Where a
            slab of the volume is more, part of it lies in scratch files beside the destination.
        checkpoint_seconds: how much work a kill may cost, more where checkpoints would take
            more than a twentieth of the time; 0 for a checkpoint after every layer.
        progress: called from the ingesting thread after each piece that was read.
        cancel: set it from another thread to stop at the next piece, after a checkpoint.
        shape: voxels (z, y, x) of a raw file.
        dtype: sample type of a raw file.
        spacing: world size of a voxel (z, y, x), where the source does not say it.
        offset: bytes before the first voxel of a raw file.
        big_endian: byte order of a raw file.
        dataset: which volume of a file that holds several.
        axes: the letters of the axes, slowest first, where a format does not name them.
        cameras: given, the pictures of a folder or pattern are the views of a light field, and the
            volume says so. It has one level, and by default zerobit bricks.
        surface: a mesh, or the file of one, of which the volume is to be the solid texture: only
            cells of 4³ voxels that it touches are stored, by Zerobit or exactly; all else is 0.
        surface_placement: where it lies; None fits it into the volume.
        surface_up: which of its axes then becomes the world's z: "x", "y" or "z".

    Raises:
        SourceError: the source is damaged, cut short, or of a kind that is not read.
        NotFiniteError: NaN or ±Inf, with the voxel's position.
        DestinationError: or its relatives, where the destination cannot be written.
        ResumeError: what is left of an unfinished ingest is of another source or other options.
        IngestCancelledError: ``cancel`` was set.
        InvalidInputError: an option; or a ``ratio`` that cannot be reached, saying which can.
    """
    options = IngestOptions(
        codec=codec,
        psnr=psnr,
        ratio=ratio,
        brick=brick,
        shard=shard,
        zstd_level=zstd_level,
        levels=levels,
        reducer=reducer,
        gradients=gradients,
        labels=labels,
        convert=convert,
        window=window,
        region=region,
        replace_nonfinite=replace_nonfinite,
        workers=workers,
        memory_nbytes=memory,
        checkpoint_seconds=checkpoint_seconds,
        surface=surface_option(surface, surface_placement, surface_up),
    )
    dest_path = Path(os.path.abspath(dest))  # noqa: PTH100  (resolve() would follow symlinks)
    with (
        open_source(
            source,
            shape_zyx=shape,
            dtype=dtype,
            spacing_zyx=spacing,
            offset_nbytes=offset,
            big_endian=big_endian,
            dataset=dataset,
            axes=axes,
            cameras=cameras,
        ) as opened,
        # Before the folder is touched: a slip of the pen must not cost what an earlier run has.
        _prepared(opened, options) as prepared,
    ):
        plan = IngestPlan.of(prepared, options)
        with staged(dest_path, overwrite=overwrite) as folder:
            return IngestRun(plan, dest_path, folder, progress, cancel).run(restart=restart)


def _prepared(source: Source, options: IngestOptions) -> Source:
    """The source with its voxels as they are stored."""
    part = source if options.region is None else RegionSource(source, options.region)
    return converted(part, options.convert, options.window)
