"""The end of an ingest: what is known of the bricks becomes metadata, and the volume complete."""

from __future__ import annotations

import dataclasses
import math
import shutil
from collections.abc import Sequence
from pathlib import Path

import zarr

from octobrick.codec import metrics
from octobrick.store import attributes as attrs
from octobrick.store.box import Box, Zyx
from octobrick.store.brick_codec import BrickCodec
from octobrick.store.gradient_pyramid import gradient_array
from octobrick.store.ingest_plan import IngestPlan
from octobrick.store.layout import (
    BrickLayout,
    directions_array,
    level_array,
    small_array,
    write_root,
)
from octobrick.store.level_codecs import LevelCodecs
from octobrick.store.progress import ProgressMeter, peak_rss_nbytes
from octobrick.store.report import IngestResult, LevelReport
from octobrick.store.volume_writer import LevelRecord, VolumeRecord

_WINDOW_HIGH_SHARE = 0.999  # a few hot voxels must not make everything else look dark


class IngestFinish:
    """Writes what a volume says of itself, when all of its bricks are stored.

    Args:
        plan: how they were made.
        codecs: of each level.
        dest: where the volume will be.
        folder: where its shards are.
    """

    def __init__(self, plan: IngestPlan, codecs: LevelCodecs, dest: Path, folder: Path) -> None:
        self._plan = plan
        self._source = plan.source
        self._options = plan.options
        self._codecs = codecs
        self._dest = dest
        self._folder = folder

    def run(self, record: VolumeRecord, meter: ProgressMeter) -> IngestResult:
        """Write all metadata, last the root's; going on from a checkpoint writes it anew."""
        for name in ("range", "fidelity"):
            shutil.rmtree(self._folder / name, ignore_errors=True)
        for path in ("", "gradient", *record.arrays):
            # Also what zarr-python was writing when an earlier run was killed.
            for file in (self._folder / path).glob("zarr.*"):
                file.unlink()
        root = zarr.create_group(self._folder)
        self._write_arrays(root, record)
        attributes = self._describe(record)
        manifest = {
            key: entry
            for path, array in record.arrays.items()
            for key, entry in array.manifest(path).items()
        }
        revision = write_root(root, self._dest.stem, attributes, {"shards": manifest})
        return self._report(attributes, revision, meter)

    def _write_arrays(self, root: zarr.Group, record: VolumeRecord) -> None:
        source, options = self._source, self._options
        ranges, fidelity = root.create_group("range"), root.create_group("fidelity")
        if record.gradients:
            root.create_group("gradient")
        for level, shape in enumerate(self._plan.shapes_zyx):
            shape_tczyx, codec = (source.nt, source.nc, *shape), self._codecs.codecs[level]
            layout = BrickLayout(options.brick, options.shard, options.zstd_level_of(codec))
            level_array(root, str(level), shape_tczyx, source.dtype, codec, layout)
            if level in record.gradients:
                layout = dataclasses.replace(layout, zstd_level=options.zstd_level_of_gradients)
                directions_array(root, gradient_array(level), shape_tczyx, layout)
            small_array(ranges, str(level), record.levels[level].ranges)
            small_array(fidelity, str(level), record.levels[level].fidelity)

    def _describe(self, record: VolumeRecord) -> attrs.VolumeAttributes:
        source, options = self._source, self._options
        value_range = _value_range(record.levels[0])
        levels = zip(self._plan.shapes_zyx, self._codecs.codecs, strict=True)
        return attrs.VolumeAttributes(
            dtype=source.dtype.name,
            brick=options.brick,
            shard_bricks=options.shard,
            nt=source.nt,
            nc=source.nc,
            spacing_zyx=source.spacing_zyx,
            unit=source.unit,
            reducer=options.reducer_of(source),
            levels=tuple(_level(record, i, *level) for i, level in enumerate(levels)),
            value_range=value_range,
            window=shown_window(record.histograms, value_range),
            histograms=tuple(record.histograms),
            source=source.describe(),
            light_field=source.light_field,
            surface=None if self._plan.selection is None else self._plan.selection.attributes(),
        )

    def _report(
        self, attributes: attrs.VolumeAttributes, revision: str, meter: ProgressMeter
    ) -> IngestResult:
        nvolumes, itemsize = attributes.nt * attributes.nc, self._source.dtype.itemsize
        levels = []
        for index, level in enumerate(attributes.levels):
            nbytes = Box.of_shape(level.shape_zyx).nvoxels * itemsize * nvolumes
            levels.append(
                LevelReport(
                    index=index,
                    shape_zyx=level.shape_zyx,
                    nbytes=nbytes,
                    stored_nbytes=level.stored_nbytes,
                    ratio=nbytes / level.stored_nbytes if level.stored_nbytes else None,
                    psnr_db=level.psnr_db,
                    max_error=level.max_error,
                    codec=level.codec,
                    gradient_nbytes=level.gradient_nbytes,
                )
            )
        elapsed = meter.elapsed_seconds
        return IngestResult(
            path=str(self._dest),
            revision=revision,
            source_format=self._source.format,
            dtype=attributes.dtype,
            timepoints=attributes.nt,
            channels=attributes.nc,
            shape_zyx=self._source.shape_zyx,
            levels=tuple(levels),
            warnings=(*self._source.warnings, *self._codecs.notes, *self._notes()),
            resumed_voxels=meter.begun_at_voxels,
            elapsed_seconds=elapsed,
            megabytes_per_second=meter.new_voxels * itemsize / 1e6 / elapsed,
            peak_rss_nbytes=peak_rss_nbytes(),
        )

    def _notes(self) -> list[str]:
        if self._options.gradients and len(self._plan.shapes_zyx) == 1:
            return ["no gradients are stored: those of level 0 never are, and there is no other"]
        selection = self._plan.selection
        if selection is not None and selection.outside_share > 0:
            return [
                f"{selection.outside_share:.1%} of the surface's vertices lie outside of the "
                "volume, and have no texture"
            ]
        return []


def _level(
    record: VolumeRecord, index: int, shape_zyx: Zyx, codec: BrickCodec
) -> attrs.LevelAttributes:
    level = record.levels[index]
    low, high = _value_range(level)
    lossless = level.errors.max_abs == 0
    gradient = record.gradients.get(index)
    return attrs.LevelAttributes(
        shape_zyx=shape_zyx,
        codec=codec,
        stored_nbytes=level.stored_nbytes,
        max_error=level.errors.max_abs,
        rmse=level.errors.rmse,
        psnr_db=None if lossless else level.errors.psnr(float(high) - float(low)),
        gradient_nbytes=None if gradient is None else gradient.stored_nbytes,
    )


def _value_range(level: LevelRecord) -> tuple[attrs.Number, attrs.Number]:
    low, high = level.ranges[..., 0].min(), level.ranges[..., 1].max()
    return attrs.python_number(low), attrs.python_number(high)


def shown_window(
    histograms: Sequence[metrics.Histogram], value_range: tuple[attrs.Number, attrs.Number]
) -> tuple[attrs.Number, attrs.Number]:
    """Values worth showing: from the lowest up to what all but one in a thousand stay below."""
    low, high = value_range
    bright: attrs.Number = metrics.Histogram.total_of(histograms).quantile(_WINDOW_HIGH_SHARE)
    if isinstance(high, int):
        bright = math.ceil(bright)
    bright = min(bright, high)
    return (low, bright if bright > low else high)
