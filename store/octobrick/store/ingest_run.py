"""One ingest under way: reads pieces, feeds the pyramids, leaves checkpoints, writes a volume."""

from __future__ import annotations

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from zipfile import BadZipFile

from octobrick.codec.errors import OctobrickError
from octobrick.store.destination import clear
from octobrick.store.errors import IngestCancelledError, SourceUnreachableError
from octobrick.store.ingest_finish import IngestFinish
from octobrick.store.ingest_plan import IngestPlan
from octobrick.store.ingest_state import IngestState
from octobrick.store.journal import Journal
from octobrick.store.level_codecs import LevelCodecs
from octobrick.store.progress import ProgressCallback, ProgressMeter
from octobrick.store.pyramid import Pyramid, feed
from octobrick.store.report import IngestResult
from octobrick.store.volume_writer import VolumeRecord, VolumeWriter
from octobrick.store.window import SCRATCH_PREFIX

_CHECKPOINT_SHARE = 0.05  # of the time that may go into checkpoints, where a disk is slow


# What reading a checkpoint raises that this program did not write, or not whole.
_DAMAGED = (KeyError, ValueError, TypeError, IndexError, OSError, BadZipFile, OctobrickError)


class IngestRun:
    """One ingest under way.

    Args:
        plan: how it is to work.
        dest: where the volume will be.
        folder: where it grows, locked; what is left there of an earlier run is taken up.
        progress: called after each piece.
        cancel: looked at after each piece.
    """

    def __init__(
        self,
        plan: IngestPlan,
        dest: Path,
        folder: Path,
        progress: ProgressCallback | None,
        cancel: threading.Event | None,
    ) -> None:
        source, options = plan.source, plan.options
        self._plan = plan
        self._source = source
        self._options = options
        self._dest = dest
        self._folder = folder
        self._cancel = cancel
        self._voxels_per_plane = source.nc * source.shape_zyx[1] * source.shape_zyx[2]
        self._voxels_per_step = self._voxels_per_plane * source.shape_zyx[0]
        self._meter = ProgressMeter(source.nt * self._voxels_per_step, progress)
        self._journal = Journal(
            folder, {"source": source.fingerprint(), "options": options.to_json()}
        )
        self._codecs = LevelCodecs(())  # until the run begins
        self._last_seconds = time.monotonic()
        self._checkpoint_cost_seconds = 0.0

    def run(self, *, restart: bool) -> IngestResult:
        """Do all that remains to be done."""
        nworkers = self._plan.nworkers
        with ThreadPoolExecutor(nworkers, thread_name_prefix="octobrick-encode") as executor:
            self._executor = executor
            self._state = self._fresh_state()
            self._take_up(restart=restart)
            while self._state.t < self._source.nt:
                self._ingest_step()
                self._state.t, self._state.z, self._state.pyramids = self._state.t + 1, 0, []
        finish = IngestFinish(self._plan, self._codecs, self._dest, self._folder)
        return finish.run(self._state.record, self._meter)

    # Going on where an earlier run was

    def _take_up(self, *, restart: bool) -> None:
        for leftover in self._folder.glob(f"{SCRATCH_PREFIX}*"):
            leftover.unlink()
        checkpoint = None if restart else self._journal.read()
        if checkpoint is not None:
            try:
                with checkpoint:
                    self._codecs = LevelCodecs.from_facts(
                        checkpoint.facts, len(self._plan.shapes_zyx)
                    )
                    self._state.restore(checkpoint, self._begin_step)
            except _DAMAGED:
                # Not what this program left: begin again rather than build on it.
                self._state = self._fresh_state()
                checkpoint = None
        if checkpoint is None:
            clear(self._folder)
            self._codecs = LevelCodecs.find(
                self._source,
                self._options,
                self._plan.shapes_zyx,
                self._executor,
                self._note_measurement,
            )
        done = self._state.t * self._voxels_per_step + self._state.z * self._voxels_per_plane
        self._meter.begin_at(done)

    def _fresh_state(self) -> IngestState:
        source, options = self._source, self._options
        record = VolumeRecord(
            source.nt,
            source.nc,
            self._plan.shapes_zyx,
            options.brick,
            source.dtype,
            has_gradients=options.gradients,
        )
        return IngestState(
            record, VolumeWriter(self._folder, record, options.shard, self._executor)
        )

    def _is_checkpoint_due(self) -> bool:
        interval = self._options.checkpoint_seconds
        if interval > 0:
            interval = max(interval, self._checkpoint_cost_seconds / _CHECKPOINT_SHARE)
        return time.monotonic() - self._last_seconds >= interval

    def _checkpoint(self) -> None:
        started = time.monotonic()
        facts, arrays = self._state.pack()
        self._journal.write(facts | self._codecs.to_facts(), arrays)
        self._last_seconds = time.monotonic()
        self._checkpoint_cost_seconds = self._last_seconds - started

    def _note_measurement(self) -> None:
        self._meter.advance(0, "measure")
        if self._cancel is not None and self._cancel.is_set():
            raise self._cancelled()

    def _cancelled(self) -> IngestCancelledError:
        return IngestCancelledError(
            f"{self._dest}: the ingest was cancelled; run it again to go on where it is",
            path=str(self._dest),
            done_voxels=self._meter.done_voxels,
        )

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
        if not state.pyramids:
            state.pyramids = self._begin_step(state.t)
        self._last_seconds, last_layer = time.monotonic(), -1
        for piece in self._plan.reader.pieces(state.t, state.z):
            feed(state.pyramids, piece)
            self._meter.advance(piece.voxels.size, "encode")
            if piece.stop_z == piece.z:
                continue  # more rows of these planes are to come
            state.z = piece.stop_z
            if self._cancel is not None and self._cancel.is_set():
                self._checkpoint()
                raise self._cancelled()
            # Right behind a layer there is least to remember.
            layer = state.pyramids[0].nlayers_done
            if layer != last_layer and self._is_checkpoint_due():
                self._checkpoint()
                last_layer = layer

    def _begin_step(self, t: int) -> list[Pyramid]:
        plan = self._plan.pyramid(self._codecs.codecs, self._folder)
        writer = self._state.writer
        return [Pyramid(plan, t, c, self._executor, writer) for c in range(self._source.nc)]
