"""Writes a procedural volume to a file, piece by piece, on all processors."""

from __future__ import annotations

import contextlib
import json
import os
import queue
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import DTypeLike, NDArray

from octobrick.codec.errors import InvalidInputError
from octobrick.store.in_order import in_order
from octobrick.store.progress import ProgressCallback, ProgressMeter, peak_rss_nbytes
from octobrick.store.staging import staged_file
from octobrick.store.synth.field import Field
from octobrick.store.synth.kinds import field_planes, make_field, require_sample_type
from octobrick.store.synth.result import SynthResult

_PIECE_NBYTES = 8 * 2**20


def synth(
    kind: str,
    shape_zyx: Sequence[int],
    dtype: DTypeLike,
    out_path: str | os.PathLike[str],
    seed: int = 0,
    progress: ProgressCallback | None = None,
    *,
    rgb: bool = False,
    overwrite: bool = False,
    workers: int | None = None,
) -> SynthResult:
    """Write a procedural volume, visible only when complete, in memory of a few planes.

    Args:
        kind: one of ``KINDS``.
        shape_zyx: voxels along z, y and x.
        dtype: one of ``SYNTH_DTYPES``.
        out_path: ``NAME.raw``, which gets a ``NAME.raw.json`` beside it, or ``NAME.npy``.
        seed: chooses among the volumes of a kind.
        progress: called after each piece that was written.
        rgb: colours (z, y, x, 3) instead of scalars, for marble and wood into ``.npy``.
        overwrite: replace a file that is already there.
        workers: threads; by default one per processor. The bytes do not depend on it.

    Raises:
        InvalidInputError: naming the argument, its value and what it may be.
        DestinationExistsError: the file is there and ``overwrite`` is not set.
        DestinationError: the system refuses to write.
    """
    out = Path(out_path)
    job = _Job(kind, shape_zyx, require_sample_type(dtype), seed, rgb, _require_workers(workers))
    meter = ProgressMeter(job.nvoxels, progress)
    with contextlib.ExitStack() as stack:
        if _require_suffix(out, rgb=rgb) == ".raw":
            sidecar = out.with_name(f"{out.name}.json")
            staged_sidecar = stack.enter_context(staged_file(sidecar, overwrite=overwrite))
            staged_sidecar.write_text(json.dumps(job.sidecar()) + "\n")
        with staged_file(out, overwrite=overwrite) as partial, partial.open("wb") as file:
            if out.suffix == ".npy":
                _write_npy_header(file, job)
            for piece in job.pieces():
                file.write(piece.data)
                meter.advance(piece.size // (3 if rgb else 1), "synth")
    elapsed = meter.elapsed_seconds
    return SynthResult(
        path=str(out),
        kind=kind,
        seed=seed,
        dtype=job.dtype.name,
        shape_zyx=job.shape_zyx,
        rgb=rgb,
        nbytes=out.stat().st_size,
        elapsed_seconds=elapsed,
        megavoxels_per_second=job.nvoxels / 1e6 / max(elapsed, 1e-9),
        peak_rss_nbytes=peak_rss_nbytes(),
    )


class _Job:
    """What is to be made, and the threads that make it."""

    def __init__(
        self,
        kind: str,
        shape: Sequence[int],
        dtype: np.dtype[Any],
        seed: int,
        rgb: bool,
        workers: int,
    ) -> None:
        self.dtype = dtype
        self._kind = kind
        self._seed = seed
        self._rgb = rgb
        self._workers = workers
        # Fields keep planes between calls: each is lent to one thread at a time.
        self._fields: queue.SimpleQueue[Field] = queue.SimpleQueue()
        field = make_field(kind, shape, seed, rgb=rgb)
        self._fields.put(field)
        self.shape_zyx = field.shape_zyx
        nz, ny, nx = self.shape_zyx
        self.nvoxels = nz * ny * nx

    @property
    def array_shape(self) -> tuple[int, ...]:
        return (*self.shape_zyx, 3) if self._rgb else self.shape_zyx

    def sidecar(self) -> dict[str, Any]:
        return {
            "shape": list(self.shape_zyx),
            "dtype": self.dtype.name,
            "spacing": [1.0, 1.0, 1.0],
            "kind": self._kind,
            "seed": self._seed,
        }

    def pieces(self) -> Iterator[NDArray[Any]]:
        """All planes in order; as many pieces are under way as there are threads."""
        nz, ny, nx = self.shape_zyx
        plane_nbytes = ny * nx * self.dtype.itemsize * (3 if self._rgb else 1)
        step = max(1, _PIECE_NBYTES // plane_nbytes)
        calls = (partial(self._make, z, min(z + step, nz)) for z in range(0, nz, step))
        with ThreadPoolExecutor(self._workers, thread_name_prefix="octobrick-synth") as executor:
            yield from in_order(executor, calls, self._workers)

    def _make(self, z0: int, z1: int) -> NDArray[Any]:
        try:
            field = self._fields.get_nowait()
        except queue.Empty:
            field = make_field(self._kind, self.shape_zyx, self._seed)
        try:
            made = field_planes(field, self.dtype, z0, z1, rgb=self._rgb)
            return made.astype(self.dtype.newbyteorder("<"), copy=False)
        finally:
            self._fields.put(field)


def _write_npy_header(file: BinaryIO, job: _Job) -> None:
    description = {
        "descr": job.dtype.newbyteorder("<").str,
        "fortran_order": False,
        "shape": job.array_shape,
    }
    np.lib.format.write_array_header_1_0(file, description)


def _require_suffix(out: Path, *, rgb: bool) -> str:
    if out.suffix not in (".raw", ".npy"):
        raise InvalidInputError(
            f"{out}: the name must end in .raw or .npy, which says the format", path=str(out)
        )
    if rgb and out.suffix == ".raw":
        raise InvalidInputError(
            f"{out}: colours are written to .npy, which says its axes; choose that suffix",
            path=str(out),
        )
    return out.suffix


def _require_workers(workers: int | None) -> int:
    if workers is None:
        return len(os.sched_getaffinity(0))
    if not 1 <= workers <= 1024:
        raise InvalidInputError(f"workers {workers}: must be 1 to 1024", workers=workers)
    return workers
