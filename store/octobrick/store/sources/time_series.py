"""A pattern of files that are one time step each, such as ``run1/t*.nrrd``."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from octobrick.store.box import Box
from octobrick.store.errors import SourceError, UnsupportedSourceError
from octobrick.store.sources.base import Description, Source

# Files that are held open; ingest reads one step after the other, and a viewer goes back and forth.
_OPEN_STEPS = 4
_SAME_SPACING = 1e-5

OpenFile = Callable[[Path], Source]


def open_time_series(path: Path, files: Sequence[Path], open_file: OpenFile) -> Source:
    """The volume whose time step t is the t-th file.

    Args:
        path: the pattern, as the name of the whole.
        files: those of the steps, from t = 0 on.
        open_file: opens one of them.

    Raises:
        SourceError: a file differs from the first in shape, sample type, channels or spacing.
        UnsupportedSourceError: a file holds time steps of its own.
        Whatever opening one file raises.
    """
    with open_file(files[0]) as first:
        described = _description(first, len(files))
        _require_one_step(first)
        for file in files[1:]:
            with open_file(file) as step:
                _require_alike(step, first)
    return TimeSeriesSource(path, described, files, open_file)


class TimeSeriesSource(Source):
    """Files of one shape and type, a few of them open at a time."""

    def __init__(
        self, path: Path, description: Description, files: Sequence[Path], open_file: OpenFile
    ) -> None:
        super().__init__(path, description)
        self._steps = tuple(files)
        self._open_file = open_file
        # Steps that are open and not in use, with their t, the one idle for longest first. A step
        # in use by a thread is in nobody else's hands.
        self._idle: list[tuple[int, Source]] = []
        self._lock = threading.Lock()
        self._files: tuple[Path, ...] | None = None

    @property
    def ascending(self) -> bool:
        """Whether the files are compressed as a whole."""
        with self._step(0) as step:
            return step.ascending

    @property
    def files(self) -> tuple[Path, ...]:
        """All files of all steps, in the order of t."""
        if self._files is None:
            found: list[Path] = []
            for t in range(self.nt):
                with self._step(t) as step:
                    found.extend(step.files)
            self._files = tuple(found)
        return self._files

    def _read(self, box: Box, t: int, c: int) -> npt.NDArray[Any]:
        with self._step(t) as step:
            return step.read(box, 0, c)

    def _read_channels(self, box: Box, t: int) -> npt.NDArray[Any]:
        with self._step(t) as step:
            return step.read_channels(box, 0)

    def _constant(self, box: Box, t: int, c: int) -> float | None:
        with self._step(t) as step:
            return step.constant(box, 0, c)

    @contextmanager
    def _step(self, t: int) -> Iterator[Source]:
        """A step, open, for one thread; it is kept open until others have been used since."""
        with self._lock:
            at = next((at for at, (idle, _) in enumerate(self._idle) if idle == t), None)
            step = None if at is None else self._idle.pop(at)[1]
        if step is None:
            step = self._open_file(self._steps[t])
            try:
                self._require_unchanged(step)
            except SourceError:
                step.close()
                raise
        try:
            yield step
        finally:
            with self._lock:
                self._idle.append((t, step))
                surplus = self._idle[:-_OPEN_STEPS]
                del self._idle[:-_OPEN_STEPS]
            for _, other in surplus:
                other.close()

    def _require_unchanged(self, step: Source) -> None:
        if (step.shape_zyx, step.dtype, step.nc) != (self.shape_zyx, self.dtype, self.nc):
            raise SourceError(
                f"{step.path}: has {_what(step)} now, but {_what(self)} when the time series was "
                "opened; open it again",
                path=str(step.path),
            )

    def _close(self) -> None:
        for _, step in self._idle:
            step.close()
        self._idle.clear()


def _description(first: Source, nt: int) -> Description:
    """What the first step says, of all."""
    return Description(
        f"{first.format} time series",
        first.shape_zyx,
        first.dtype,
        first.spacing_zyx,
        first.unit,
        first.direction,
        first.rescale,
        first.warnings,
        first.origin_xyz,
        nt,
        first.nc,
        first.channels,
        first.labels,
        first.background,
        first.chunk_zyx,
    )


def _require_one_step(step: Source) -> None:
    if step.nt != 1:
        raise UnsupportedSourceError(
            f"{step.path}: holds {step.nt} time steps of its own; a pattern is for files of one "
            "step each: open the file on its own",
            path=str(step.path),
            timepoints=step.nt,
        )


def _require_alike(step: Source, first: Source) -> None:
    """Refuse a step that is not as the first."""
    _require_one_step(step)
    same = (
        (step.shape_zyx, step.dtype, step.nc) == (first.shape_zyx, first.dtype, first.nc)
        and np.allclose(step.spacing_zyx, first.spacing_zyx, rtol=_SAME_SPACING, atol=0)
        and step.rescale == first.rescale
        and step.unit == first.unit
    )
    if not same:
        raise SourceError(
            f"{step.path}: has {_what(step)}, but the first time step {first.path.name} has "
            f"{_what(first)}; all steps must be alike: convert or leave out the file",
            path=str(step.path),
            first=first.path.name,
        )


def _what(source: Source) -> str:
    spacing = ", ".join(f"{size:g}" for size in source.spacing_zyx)
    rescale = "" if source.rescale is None else f" rescaled by {tuple(source.rescale)}"
    return (
        f"{source.shape_zyx} voxels (z, y, x) of {source.nc} {source.dtype}{rescale}, "
        f"{spacing} {source.unit or ''}".rstrip()
        + " apart"
    )
