"""One ingest under way: reads pieces, feeds the pyramids, leaves checkpoints, writes a volume."""

from __future__ import annotations

import os
import shutil
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import zarr

from octobrick.store import attributes as attrs
from octobrick.store.box import Box, grid_of
from octobrick.store.brick_encoder import BrickEncoder
from octobrick.store.destination import clear
from octobrick.store.errors import IngestCancelledError, SourceUnreachableError
from octobrick.store.ingest_options import IngestOptions
from octobrick.store.ingest_state import ChannelState, IngestState
from octobrick.store.journal import Journal
from octobrick.store.layout import level_array, small_array, write_root
from octobrick.store.level_writer import LevelRecord, LevelWriter
from octobrick.store.piece_reader import PieceReader
from octobrick.store.progress import ProgressCallback, ProgressMeter, peak_rss_nbytes
from octobrick.store.pyramid import REDUCERS, Layer, LevelStream, level_shapes
from octobrick.store.report import IngestResult, LevelReport
from octobrick.store.sources import Source

_CHECKPOINT_SHARE = 0.05  # of the time that may go into checkpoints, where a disk is slow
_WINDOW_HIGH_PERCENTILE = 99.9  # a few hot voxels must not make everything else look dark


class IngestRun:
    """One ingest under way.

    Args:
        source: whose voxels are stored as they are read.
        dest: where the volume will be.
        folder: where it grows, locked; what is left there of an earlier run is taken up.
        options: checked.
        progress: called after each piece.
        cancel: looked at after each piece.
    """

    def __init__(
        self,
        source: Source,
        dest: Path,
        folder: Path,
        options: IngestOptions,
        progress: ProgressCallback | None,
        cancel: threading.Event | None,
    ) -> None:
        self._source = source
        self._dest = dest
        self._folder = folder
        self._options = options
        self._codec = options.codec_of(source)
        self._reducer = options.reducer_of(source)
        self._cancel = cancel
        self._shapes = level_shapes(source.shape_zyx, options.brick, options.levels)
        self._encoder = BrickEncoder(self._codec, options.brick, options.zstd_level)
        self._voxels_per_plane = source.nc * source.shape_zyx[1] * source.shape_zyx[2]
        self._voxels_per_step = self._voxels_per_plane * source.shape_zyx[0]
        self._meter = ProgressMeter(source.nt * self._voxels_per_step, progress)
        self._journal = Journal(
            folder, {"source": source.fingerprint(), "options": options.to_json()}
        )
        self._state = self._fresh_state()
        self._last_seconds = time.monotonic()
        self._checkpoint_cost_seconds = 0.0

    def run(self, *, restart: bool) -> IngestResult:
        """Do all that remains to be done."""
        nworkers = self._options.workers or len(os.sched_getaffinity(0))
        with ThreadPoolExecutor(nworkers, thread_name_prefix="octobrick-encode") as executor:
            self._executor = executor
            self._take_up(restart=restart)
            while self._state.t < self._source.nt:
                self._ingest_step()
                self._state.t, self._state.z, self._state.channels = self._state.t + 1, 0, []
        return self._finish()

    # Going on where an earlier run was

    def _take_up(self, *, restart: bool) -> None:
        checkpoint = None if restart else self._journal.read()
        if checkpoint is not None:
            try:
                self._state.restore(*checkpoint, self._begin_step)
            except (KeyError, ValueError, TypeError, IndexError, OSError):
                # Not what this program left: begin again rather than build on it.
                self._state = self._fresh_state()
                checkpoint = None
        if checkpoint is None:
            clear(self._folder)
        done = self._state.t * self._voxels_per_step + self._state.z * self._voxels_per_plane
        self._meter.begin_at(done)

    def _fresh_state(self) -> IngestState:
        source, brick_zyx = self._source, (self._options.brick,) * 3
        return IngestState(
            [
                LevelRecord(source.nt, source.nc, shape, grid_of(shape, brick_zyx), source.dtype)
                for shape in self._shapes
            ]
        )

    def _is_checkpoint_due(self) -> bool:
        interval = self._options.checkpoint_seconds
        if interval > 0:
            interval = max(interval, self._checkpoint_cost_seconds / _CHECKPOINT_SHARE)
        return time.monotonic() - self._last_seconds >= interval

    def _checkpoint(self) -> None:
        started = time.monotonic()
        self._journal.write(*self._state.pack())
        self._last_seconds = time.monotonic()
        self._checkpoint_cost_seconds = self._last_seconds - started

    # Reading and writing

    def _ingest_step(self) -> None:
        """All planes of the time step under way; a lost server costs none that have come."""
        try:
            self._ingest_planes()
        except SourceUnreachableError:
            if self._state.t or self._state.z:
                self._checkpoint()
            raise

    def _ingest_planes(self) -> None:
        state = self._state
        if not state.channels:
            state.channels = self._begin_step(state.t)
        reader = PieceReader(self._source, self._options.replace_nonfinite)
        self._last_seconds, last_layer = time.monotonic(), -1
        for planes in reader.pieces(state.t, state.z):
            for channel, own in zip(state.channels, planes, strict=True):
                channel.stream.push(own)
            state.z += planes.shape[1]
            self._meter.advance(planes.size, "encode")
            if self._cancel is not None and self._cancel.is_set():
                self._checkpoint()
                raise IngestCancelledError(
                    f"{self._dest}: the ingest was cancelled; run it again to go on where it is",
                    path=str(self._dest),
                    done_voxels=self._meter.done_voxels,
                )
            # Right behind a layer there is least to remember.
            layer = state.channels[0].stream.nlayers_emitted
            if layer != last_layer and self._is_checkpoint_due():
                self._checkpoint()
                last_layer = layer

    def _begin_step(self, t: int) -> list[ChannelState]:
        return [self._begin_channel(t, c) for c in range(self._source.nc)]

    def _begin_channel(self, t: int, c: int) -> ChannelState:
        options = self._options
        writers = [
            LevelWriter(
                self._folder / str(level),
                shape,
                self._state.records[level],
                self._encoder,
                options.shard,
                self._executor,
                t,
                c,
            )
            for level, shape in enumerate(self._shapes)
        ]

        def emit(layer: Layer) -> None:
            writers[layer.level].write(layer)

        reducer = REDUCERS[self._reducer]
        dtype = self._source.dtype
        return ChannelState(
            LevelStream(0, self._shapes, dtype, options.brick, reducer, emit), writers
        )

    # The end

    def _finish(self) -> IngestResult:
        """Write all metadata, last the root's; going on from a checkpoint writes it anew."""
        for name in ("range", "fidelity"):
            shutil.rmtree(self._folder / name, ignore_errors=True)
        for metadata in (
            "zarr.json",
            *(f"{level}/zarr.json" for level in range(len(self._shapes))),
        ):
            (self._folder / metadata).unlink(missing_ok=True)
        root = zarr.create_group(self._folder)
        source, options = self._source, self._options
        for level, shape in enumerate(self._shapes):
            level_array(
                root,
                str(level),
                (source.nt, source.nc, *shape),
                source.dtype,
                codec=self._codec,
                brick=options.brick,
                shard_bricks=options.shard,
                zstd_level=options.zstd_level,
            )
        attributes = self._describe(root)
        manifest = {
            path: entry
            for level, record in enumerate(self._state.records)
            for path, entry in record.manifest(str(level)).items()
        }
        revision = write_root(root, self._dest.stem, attributes, {"shards": manifest})
        return self._report(attributes, revision)

    def _describe(self, root: zarr.Group) -> attrs.VolumeAttributes:
        ranges, fidelity = root.create_group("range"), root.create_group("fidelity")
        levels = []
        for index, record in enumerate(self._state.records):
            small_array(ranges, str(index), record.ranges)
            small_array(fidelity, str(index), record.fidelity)
            low, high = record.ranges[..., 0].min(), record.ranges[..., 1].max()
            peak = float(high) - float(low)
            lossless = record.errors.max_abs == 0
            levels.append(
                attrs.LevelAttributes(
                    shape_zyx=self._shapes[index],
                    stored_nbytes=record.stored_nbytes,
                    max_error=record.errors.max_abs,
                    rmse=record.errors.rmse,
                    psnr_db=None if lossless else record.errors.psnr(peak),
                )
            )
        first = self._state.records[0].ranges
        low, high = (
            attrs.python_number(first[..., 0].min()),
            attrs.python_number(first[..., 1].max()),
        )
        return attrs.VolumeAttributes(
            dtype=self._source.dtype.name,
            brick=self._options.brick,
            shard_bricks=self._options.shard,
            codec=self._codec,
            nt=self._source.nt,
            nc=self._source.nc,
            spacing_zyx=self._source.spacing_zyx,
            unit=self._source.unit,
            reducer=self._reducer,
            levels=tuple(levels),
            value_range=(low, high),
            window=_window(self._state.records, (low, high)),
            source=self._source.describe(),
        )

    def _report(self, attributes: attrs.VolumeAttributes, revision: str) -> IngestResult:
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
                )
            )
        elapsed = self._meter.elapsed_seconds
        return IngestResult(
            path=str(self._dest),
            revision=revision,
            source_format=self._source.format,
            dtype=attributes.dtype,
            timepoints=attributes.nt,
            channels=attributes.nc,
            shape_zyx=self._source.shape_zyx,
            levels=tuple(levels),
            warnings=self._source.warnings,
            resumed_voxels=self._meter.begun_at_voxels,
            elapsed_seconds=elapsed,
            megabytes_per_second=self._meter.new_voxels * itemsize / 1e6 / elapsed,
            peak_rss_nbytes=peak_rss_nbytes(),
        )


def _window(
    records: list[LevelRecord], value_range: tuple[attrs.Number, attrs.Number]
) -> tuple[attrs.Number, attrs.Number]:
    """Values worth showing: from the lowest up to what all but one in a thousand stay below.

    Taken from the finest level that is small enough to keep, whose voxels are made of originals,
    so that the window is the same however the bricks are coded.
    """
    preview = next((r.preview for r in records if r.preview is not None), None)
    low, high = value_range
    if preview:
        # In double: two float32 voxels can be farther apart than float32 reaches.
        voxels = np.concatenate([planes.ravel() for planes in preview], dtype=np.float64)
        high = float(np.percentile(voxels, _WINDOW_HIGH_PERCENTILE))
    return (low, high if high > low else value_range[1])
