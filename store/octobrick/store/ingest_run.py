"""One ingest under way: reads pieces, feeds the pyramids, leaves checkpoints, writes a volume."""

from __future__ import annotations

import os
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from zipfile import BadZipFile

from octobrick.store.brick_encoder import BrickEncoder, DirectionEncoder
from octobrick.store.destination import clear
from octobrick.store.errors import IngestCancelledError
from octobrick.store.ingest_finish import IngestFinish
from octobrick.store.ingest_options import IngestOptions
from octobrick.store.ingest_state import IngestState
from octobrick.store.journal import Journal
from octobrick.store.memory_plan import plan_memory
from octobrick.store.piece_reader import PieceReader
from octobrick.store.progress import ProgressCallback, ProgressMeter
from octobrick.store.pyramid import Pyramid, PyramidPlan
from octobrick.store.reducers import level_shapes
from octobrick.store.report import IngestResult
from octobrick.store.sources import Source
from octobrick.store.volume_writer import VolumeRecord, VolumeWriter
from octobrick.store.window import SCRATCH_PREFIX, Window, WindowShape

_CHECKPOINT_SHARE = 0.05  # of the time that may go into checkpoints, where a disk is slow


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
        self._nworkers = options.workers or len(os.sched_getaffinity(0))
        self._shapes = level_shapes(source.shape_zyx, options.brick, options.levels)
        self._reader = PieceReader(source, options.replace_nonfinite, options.brick)
        self._voxels_per_plane = source.nc * source.shape_zyx[1] * source.shape_zyx[2]
        self._voxels_per_step = self._voxels_per_plane * source.shape_zyx[0]
        self._meter = ProgressMeter(source.nt * self._voxels_per_step, progress)
        self._journal = Journal(
            folder, {"source": source.fingerprint(), "options": options.to_json()}
        )
        self._state = self._fresh_state()
        self._plan = self._make_plan()
        self._memory = plan_memory(
            self._plan,
            nc=source.nc,
            nworkers=self._nworkers,
            piece_nbytes=self._reader.piece_nbytes,
            limit_nbytes=options.memory_nbytes,
        )
        self._last_seconds = time.monotonic()
        self._checkpoint_cost_seconds = 0.0

    def run(self, *, restart: bool) -> IngestResult:
        """Do all that remains to be done."""
        with ThreadPoolExecutor(self._nworkers, thread_name_prefix="octobrick-encode") as executor:
            self._executor = executor
            self._take_up(restart=restart)
            while self._state.t < self._source.nt:
                self._ingest_step()
                self._state.t, self._state.z, self._state.pyramids = self._state.t + 1, 0, []
        finish = IngestFinish(self._source, self._dest, self._folder, self._options)
        return finish.run(self._state.record, self._shapes, self._meter)

    # Going on where an earlier run was

    def _take_up(self, *, restart: bool) -> None:
        for leftover in self._folder.glob(f"{SCRATCH_PREFIX}*"):
            leftover.unlink()
        checkpoint = None if restart else self._journal.read()
        if checkpoint is not None:
            try:
                with checkpoint:
                    self._state.restore(checkpoint, self._begin_step)
            except (KeyError, ValueError, TypeError, IndexError, OSError, BadZipFile):
                # Not what this program left: begin again rather than build on it.
                self._state = self._fresh_state()
                checkpoint = None
        if checkpoint is None:
            clear(self._folder)
        done = self._state.t * self._voxels_per_step + self._state.z * self._voxels_per_plane
        self._meter.begin_at(done)

    def _fresh_state(self) -> IngestState:
        source, options = self._source, self._options
        record = VolumeRecord(
            source.nt,
            source.nc,
            self._shapes,
            options.brick,
            source.dtype,
            has_gradients=options.gradients,
        )
        return IngestState(record, VolumeWriter(self._folder, record, options.shard))

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
        """All planes of the time step under way."""
        state = self._state
        if not state.pyramids:
            state.pyramids = self._begin_step(state.t)
        self._last_seconds, last_layer = time.monotonic(), -1
        for piece in self._reader.pieces(state.t, state.z):
            for pyramid, own in zip(state.pyramids, piece.voxels, strict=True):
                pyramid.put(piece.z, piece.y, own)
                pyramid.complete_to(piece.stop_z)
            self._meter.advance(piece.voxels.size, "encode")
            if piece.stop_z == piece.z:
                continue  # more rows of these planes are to come
            state.z = piece.stop_z
            if self._cancel is not None and self._cancel.is_set():
                self._checkpoint()
                raise IngestCancelledError(
                    f"{self._dest}: the ingest was cancelled; run it again to go on where it is",
                    path=str(self._dest),
                    done_voxels=self._meter.done_voxels,
                )
            # Right behind a layer there is least to remember.
            layer = state.pyramids[0].nlayers_done
            if layer != last_layer and self._is_checkpoint_due():
                self._checkpoint()
                last_layer = layer

    def _begin_step(self, t: int) -> list[Pyramid]:
        writer = self._state.writer
        return [Pyramid(self._plan, t, c, self._executor, writer) for c in range(self._source.nc)]

    def _make_window(self, array: str, shape: WindowShape) -> Window:
        return self._memory.window(self._folder, array, shape)

    def _make_plan(self) -> PyramidPlan:
        options = self._options
        return PyramidPlan(
            shapes_zyx=self._shapes,
            dtype=self._source.dtype,
            encoders=[BrickEncoder(self._codec, options.brick, options.zstd_level)]
            * len(self._shapes),
            reducer=self._reducer,
            spacing_zyx=self._source.spacing_zyx,
            directions=(
                DirectionEncoder(options.brick, options.zstd_level) if options.gradients else None
            ),
            source_nplanes=self._reader.nplanes,
            make_window=self._make_window,
            nahead=4 * self._nworkers,
        )
