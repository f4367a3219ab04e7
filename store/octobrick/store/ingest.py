"""From any source to a volume of compressed bricks, in one pass, with memory bounded by a slab."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import zarr
from numpy.typing import DTypeLike, NDArray

from octobrick.codec import S3dc
from octobrick.codec.errors import InvalidInputError, NotFiniteError
from octobrick.store import attributes as attrs
from octobrick.store.box import Box, Zyx
from octobrick.store.brick_encoder import BrickEncoder
from octobrick.store.destination import staged
from octobrick.store.layout import level_array, small_array, write_root
from octobrick.store.level_writer import LevelWriter, iter_manifest
from octobrick.store.progress import ProgressCallback, ProgressMeter, peak_rss_nbytes
from octobrick.store.pyramid import Layer, LevelStream, level_shapes
from octobrick.store.report import IngestResult, LevelReport
from octobrick.store.sources import Source, open_source
from octobrick.store.zarr_codec import require_volume_codec

Voxels = NDArray[np.generic]

DEFAULT_CODEC = S3dc(block=(8, 8, 8), bits=4)

# Planes are read in pieces of about this size: large enough that a disk streams, small enough
# that what is read ahead does not count beside the slab that is being encoded.
_READ_NBYTES = 16 * 2**20
_WINDOW_HIGH_PERCENTILE = 99.9  # a few hot voxels must not make everything else look dark


@dataclass(frozen=True, slots=True)
class IngestOptions:
    """How a volume is stored; checked when made.

    Raises:
        InvalidInputError: naming the option, its value and what it may be.
        UnsupportedError: a codec whose codes volumes cannot hold.
    """

    codec: S3dc | None
    brick: int
    shard: int
    zstd_level: int
    levels: int | None
    replace_nonfinite: float | None
    workers: int | None

    def __post_init__(self) -> None:
        if self.codec is not None:
            require_volume_codec(self.codec)
        _require("brick", self.brick, attrs.BRICK_MIN, attrs.BRICK_MAX)
        if self.brick % 2:
            raise InvalidInputError(f"brick {self.brick}: must be even", brick=self.brick)
        _require("shard", self.shard, 1, attrs.SHARD_BRICKS_MAX)
        _require("zstd_level", self.zstd_level, 1, 19)
        if self.levels is not None:
            _require("levels", self.levels, 1, attrs.LEVELS_MAX)
        if self.workers is not None:
            _require("workers", self.workers, 1, 1024)
        if self.replace_nonfinite is not None and not np.isfinite(self.replace_nonfinite):
            raise InvalidInputError(f"replace_nonfinite {self.replace_nonfinite}: must be finite")


def ingest(
    source: str | os.PathLike[str],
    dest: str | os.PathLike[str],
    *,
    codec: S3dc | None = DEFAULT_CODEC,
    brick: int = 64,
    shard: int = 4,
    zstd_level: int = 3,
    levels: int | None = None,
    replace_nonfinite: float | None = None,
    overwrite: bool = False,
    workers: int | None = None,
    progress: ProgressCallback | None = None,
    shape: Zyx | None = None,
    dtype: DTypeLike | None = None,
    spacing: tuple[float, float, float] | None = None,
    offset: int = 0,
    big_endian: bool = False,
) -> IngestResult:
    """Read a source once and write a volume of all levels, visible only when complete.

    Args:
        source: a file of a format that :mod:`octobrick.store.sources` reads.
        dest: the volume's folder, by custom ``NAME.zarr``.
        codec: the fixed-layout code of the bricks, or None to keep voxels exactly.
        brick: voxels per brick and axis, even, 8 to 256.
        shard: bricks per shard and axis.
        zstd_level: effort of the entropy layer, 1 to 19.
        levels: how many; by default until one brick holds the coarsest.
        replace_nonfinite: what stands for NaN and ±Inf; by default they are refused.
        overwrite: replace a volume that is already there.
        workers: encoding threads; by default one per processor. The bytes do not depend on it.
        progress: called from the ingesting thread after each piece that was read.
        shape: voxels (z, y, x) of a raw file.
        dtype: sample type of a raw file.
        spacing: world size of a voxel (z, y, x), where the source does not say it.
        offset: bytes before the first voxel of a raw file.
        big_endian: byte order of a raw file.

    Raises:
        SourceError: the source is damaged, cut short, or of a kind that is not read.
        NotFiniteError: NaN or ±Inf, with the voxel's position.
        DestinationError: or its relatives, where the destination cannot be written.
        InvalidInputError: an option.
    """
    options = IngestOptions(
        codec=codec,
        brick=brick,
        shard=shard,
        zstd_level=zstd_level,
        levels=levels,
        replace_nonfinite=replace_nonfinite,
        workers=workers,
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
        ) as opened,
        staged(dest_path, overwrite=overwrite) as folder,
    ):
        return _Ingest(opened, dest_path, folder, options, progress).run()


class _Ingest:
    """One ingest under way."""

    def __init__(
        self,
        source: Source,
        dest: Path,
        folder: Path,
        options: IngestOptions,
        progress: ProgressCallback | None,
    ) -> None:
        self._source = source
        self._dest = dest
        self._options = options
        self._shapes = level_shapes(source.shape_zyx, options.brick, options.levels)
        self._meter = ProgressMeter(Box.of_shape(source.shape_zyx).nvoxels, progress)
        self._folder = folder
        self._root = zarr.create_group(folder)

    def run(self) -> IngestResult:
        nworkers = self._options.workers or len(os.sched_getaffinity(0))
        with ThreadPoolExecutor(nworkers, thread_name_prefix="octobrick-encode") as executor:
            writers = [self._make_writer(level, executor) for level in range(len(self._shapes))]

            def emit(layer: Layer) -> None:
                writers[layer.level].write(layer)

            stream = LevelStream(0, self._shapes, self._source.dtype, self._options.brick, emit)
            for planes in self._read_pieces():
                stream.push(planes)
                self._meter.advance(planes.size, "encode")
        attributes = self._describe(writers)
        manifest = {
            path: entry
            for level, writer in enumerate(writers)
            for path, entry in iter_manifest(str(level), writer)
        }
        revision = write_root(self._root, self._dest.stem, attributes, {"shards": manifest})
        return self._report(attributes, revision)

    def _make_writer(self, level: int, executor: ThreadPoolExecutor) -> LevelWriter:
        options, dtype = self._options, self._source.dtype
        level_array(
            self._root,
            str(level),
            self._shapes[level],
            dtype,
            codec=options.codec,
            brick=options.brick,
            shard_bricks=options.shard,
            zstd_level=options.zstd_level,
        )
        encoder = BrickEncoder(options.codec, options.brick, options.zstd_level)
        return LevelWriter(
            self._folder / str(level), self._shapes[level], dtype, encoder, options.shard, executor
        )

    def _read_pieces(self) -> Iterator[Voxels]:
        """The source's planes from the first to the last, one piece read ahead of its use."""
        nz, ny, nx = self._source.shape_zyx
        step = max(1, _READ_NBYTES // (ny * nx * self._source.dtype.itemsize))
        boxes = [Box((z, 0, 0), (min(z + step, nz), ny, nx)) for z in range(0, nz, step)]
        with ThreadPoolExecutor(1, thread_name_prefix="octobrick-read") as reader:
            ahead = reader.submit(self._read, boxes[0])
            for following in [*boxes[1:], None]:
                planes = ahead.result()
                if following is not None:
                    ahead = reader.submit(self._read, following)
                yield planes

    def _read(self, box: Box) -> Voxels:
        planes = self._source.read(box)
        if planes.dtype.kind != "f":
            return planes
        finite = np.isfinite(planes)
        if finite.all():
            return planes
        if self._options.replace_nonfinite is None:
            z, y, x = (int(i) for i in np.argwhere(~finite)[0])
            voxel_zyx = [z + box.start_zyx[0], y, x]
            raise NotFiniteError(
                f"{self._source.path.name}: voxel (z, y, x) = {tuple(voxel_zyx)} is "
                f"{planes[z, y, x]}; S3Dc and the pyramid need finite values, so say what "
                "replaces NaN and ±Inf (--replace-nonfinite VALUE) or clean the data",
                source=self._source.path.name,
                voxel_zyx=voxel_zyx,
            )
        return np.where(finite, planes, planes.dtype.type(self._options.replace_nonfinite))

    def _describe(self, writers: list[LevelWriter]) -> attrs.VolumeAttributes:
        ranges, fidelity = self._root.create_group("range"), self._root.create_group("fidelity")
        levels = []
        for index, writer in enumerate(writers):
            small_array(ranges, str(index), writer.ranges)
            small_array(fidelity, str(index), writer.fidelity)
            low, high = writer.ranges[..., 0].min(), writer.ranges[..., 1].max()
            peak = float(high) - float(low)
            lossless = writer.errors.max_abs == 0
            levels.append(
                attrs.LevelAttributes(
                    shape_zyx=self._shapes[index],
                    stored_nbytes=writer.stored_nbytes,
                    max_error=writer.errors.max_abs,
                    rmse=writer.errors.rmse,
                    psnr_db=None if lossless else writer.errors.psnr(peak),
                )
            )
        first = writers[0].ranges
        low, high = (
            attrs.python_number(first[..., 0].min()),
            attrs.python_number(first[..., 1].max()),
        )
        return attrs.VolumeAttributes(
            dtype=self._source.dtype.name,
            brick=self._options.brick,
            shard_bricks=self._options.shard,
            codec=self._options.codec,
            nt=1,
            nc=1,
            spacing_zyx=self._source.spacing_zyx,
            unit=self._source.unit,
            levels=tuple(levels),
            value_range=(low, high),
            window=_window(writers, (low, high)),
            source=self._source.describe(),
        )

    def _report(self, attributes: attrs.VolumeAttributes, revision: str) -> IngestResult:
        itemsize = self._source.dtype.itemsize
        levels = []
        for index, level in enumerate(attributes.levels):
            nbytes = Box.of_shape(level.shape_zyx).nvoxels * itemsize
            levels.append(
                LevelReport(
                    index=index,
                    shape_zyx=level.shape_zyx,
                    nbytes=nbytes,
                    stored_nbytes=level.stored_nbytes,
                    ratio=nbytes / level.stored_nbytes if level.stored_nbytes else None,
                    psnr_db=level.psnr_db,
                    max_error=level.max_error,
                )
            )
        elapsed = self._meter.elapsed_seconds
        return IngestResult(
            path=str(self._dest),
            revision=revision,
            source_format=self._source.format,
            dtype=attributes.dtype,
            shape_zyx=self._source.shape_zyx,
            levels=tuple(levels),
            warnings=self._source.warnings,
            elapsed_seconds=elapsed,
            megabytes_per_second=levels[0].nbytes / 1e6 / elapsed,
            peak_rss_nbytes=peak_rss_nbytes(),
        )


def _window(
    writers: list[LevelWriter], value_range: tuple[attrs.Number, attrs.Number]
) -> tuple[attrs.Number, attrs.Number]:
    """Values worth showing: from the lowest up to what all but one in a thousand stay below.

    Taken from the finest level that is small enough to keep, whose voxels are means of originals,
    so that the window is the same however the bricks are coded.
    """
    preview = next((w.preview for w in writers if w.preview is not None), None)
    low, high = value_range
    if preview is not None:
        # In double: two float32 voxels can be farther apart than float32 reaches.
        voxels = np.concatenate([planes.ravel() for planes in preview], dtype=np.float64)
        high = float(np.percentile(voxels, _WINDOW_HIGH_PERCENTILE))
    return (low, high if high > low else value_range[1])


def _require(name: str, value: int, low: int, high: int) -> None:
    if not low <= value <= high:
        raise InvalidInputError(
            f"{name} {value}: must be {low} to {high}", option=name, value=value
        )
