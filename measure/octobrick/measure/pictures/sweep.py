"""Draws one part of a volume in every way, and says what each took and what it lost."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import InvalidInputError, UnsupportedError
from octobrick.measure.measurement import PictureRow, Setting
from octobrick.measure.pictures.difference_picture import Pixels, difference_png, pixel_errors
from octobrick.measure.pictures.likeness import Likeness
from octobrick.measure.pictures.paths import DEBLOCKED, DIRECT, SLAB, RenderPath, coarser_paths
from octobrick.measure.pictures.scene import Scene
from octobrick.measure.pictures.shelf import Shelf
from octobrick.measure.pictures.views import DEFAULT_VIEWS, ViewChoice
from octobrick.renderer import PictureTooLargeError, RenderedImage, Renderer
from octobrick.store import Volume

MEMORY_BUDGET = "1GiB"
"""Of the renderer: bricks of some volumes of 256³ at once, so that timed frames read none."""
_WARMING_SIZE = (32, 32)
_SIDE_MIN = 16  # pixels: SSIM has windows of 11


@dataclass(frozen=True, slots=True)
class PictureOptions:
    """How pictures are made.

    Attributes:
        views: where from.
        size: (width, height) in pixels, at least 16 each.
        preset: of the transfer function; None takes the first that shows something.
        repeats: timed frames of each view, at least 1.
        row_seconds: of timed frames of a row, after which none is repeated: where a frame takes
            long, one of each view tells enough.
        step_voxels: distance of samples, in voxels of the level that is drawn.

    Raises:
        InvalidInputError: naming what is out of its range.
    """

    views: tuple[ViewChoice, ...] = DEFAULT_VIEWS
    size: tuple[int, int] = (384, 384)
    preset: str | None = None
    repeats: int = 3
    row_seconds: float = 2.0
    step_voxels: float = 0.5

    def __post_init__(self) -> None:
        if min(self.size) < _SIDE_MIN:
            raise InvalidInputError(
                f"pictures of {self.size[0]}x{self.size[1]} are too small to be compared; give "
                f"at least {_SIDE_MIN} pixels on each side"
            )
        if self.repeats < 1:
            raise InvalidInputError(f"repeats {self.repeats}: at least one frame must be timed")


@dataclass(frozen=True, slots=True)
class PictureResult:
    """What a sweep found.

    Attributes:
        rows: one for each setting and path that was drawn, in the order of the sweep.
        images: PNG bytes by key. "view-0" is the reference; "0-SETTING-PATH-view-0" the same view
            of a setting, for the slab path and the first view; "0-SETTING-PATH-view-0-difference"
            what differs, for the slab path of each setting and for each path of one.
        skipped: what time or memory left out, for people.
        gl_renderer: the driver's name of the device that drew.
    """

    rows: tuple[PictureRow, ...]
    images: dict[str, bytes]
    skipped: tuple[str, ...]
    gl_renderer: str = ""


def sweep_pictures(
    part: NDArray[Any],
    spacing_xyz: tuple[float, float, float],
    window: tuple[float, float] | None,
    settings: Sequence[Setting],
    options: PictureOptions,
    folder: Path,
    deadline: Callable[[], bool],
    report: Callable[[str, float], None],
) -> PictureResult:
    """Pictures of a part by each setting and path, beside those of its own voxels by slabs.

    The most important come first: the slab path of all settings, coarser levels of the first one,
    deblocking, direct rendering, which is slow, and coarser levels of the others.

    Args:
        part: (z, y, x) original voxels, finite.
        spacing_xyz: world size of a voxel.
        window: values at the ends of the transfer function; None takes the part's own.
        settings: how bricks are stored; the one that is lossless first, if there is one.
        options: views, size, how often.
        folder: empty; volumes are put there, and left to the caller.
        deadline: true when time is over; what is left is then skipped and named.
        report: told what is being done, and which share is done, 0 to 1.

    Raises:
        InvalidInputError: two settings of one label, or a part without voxels.
        GraphicsContextError: there is no OpenGL.
        OctobrickError: the part cannot be ingested.
    """
    _require_labels(settings)
    with Shelf(part, spacing_xyz, folder) as shelf, Renderer(MEMORY_BUDGET) as renderer:
        jobs = tuple(_jobs(settings, shelf.nlevels))
        if deadline():
            return PictureResult((), {}, _named(jobs, "no time was left"), renderer.gl_renderer)
        report("pictures: reference", 0.0)
        sweep = _Sweep(renderer, shelf, window, options, deadline, shown=_shown(settings))
        for done, job in enumerate(jobs):
            report(f"pictures: {job.name}", done / len(jobs))
            sweep.do(job)
        report("pictures", 1.0)
        return sweep.result()


@dataclass(frozen=True, slots=True)
class _Job:
    """One row that is to be made, of the setting of that number."""

    number: int
    setting: Setting
    path: RenderPath

    @property
    def name(self) -> str:
        return f"{self.setting.label}: {self.path.name}"

    def key(self, view: int) -> str:
        names = _slug(self.setting.label), _slug(self.path.name)
        return f"{self.number}-{'-'.join(names)}-view-{view}"


class _TimeIsOverError(Exception):
    """Between two frames of a row."""


class _Sweep:
    """The reference pictures, and the rows so far."""

    def __init__(
        self,
        renderer: Renderer,
        shelf: Shelf,
        window: tuple[float, float] | None,
        options: PictureOptions,
        deadline: Callable[[], bool],
        shown: Setting | None,
    ) -> None:
        self._renderer, self._shelf, self._options = renderer, shelf, options
        self._deadline, self._shown = deadline, shown
        volume = shelf.lossless()
        self._scene = Scene.of(
            renderer,
            volume,
            options.views,
            preset=options.preset,
            window=window,
            size=options.size,
            step_voxels=options.step_voxels,
        )
        self._wanted: list[Pixels] = []
        self._images: dict[str, bytes] = {}
        for view in range(len(options.views)):
            image = self._scene.draw(renderer, volume, SLAB, view)
            self._wanted.append(image.rgba[..., :3])
            self._images[f"view-{view}"] = image.png()
        self._rows: list[PictureRow] = []
        self._late: list[_Job] = []
        self._skipped: list[str] = []

    def do(self, job: _Job) -> None:
        """Add a row, or say why there is none."""
        if self._deadline():
            self._late.append(job)
            return
        images = dict(self._images)
        try:
            self._rows.append(self._row(job, images))
            self._images = images
        except _TimeIsOverError:
            self._late.append(job)
        except (PictureTooLargeError, UnsupportedError) as error:
            self._skipped.append(f"pictures of {job.name}: {error}")

    def result(self) -> PictureResult:
        late = _named(self._late, "time was over")
        skipped = (*self._skipped, *late)
        gl_renderer = self._renderer.gl_renderer
        return PictureResult(tuple(self._rows), self._images, skipped, gl_renderer)

    def _row(self, job: _Job, images: dict[str, bytes]) -> PictureRow:
        volume = self._shelf.volume(job.setting, job.path.level)
        frames = self._frames(volume, job.path)
        alike, differences = [], []
        for view, (wanted, image) in enumerate(zip(self._wanted, frames, strict=False)):
            found = image.rgba[..., :3]
            alike.append(Likeness.of(wanted, found))
            if self._is_shown(job):
                key = f"{job.key(view)}-difference"
                images[key] = difference_png(pixel_errors(wanted, found))
                differences.append(key)
            if job.path is SLAB and job.setting.codec is not None and view == 0:
                images[job.key(view)] = image.png()
        seconds = _warm_seconds(frames, job.path)
        low, middle, high = (float(q) for q in np.quantile(seconds, (0.25, 0.5, 0.75)))
        whole = sum(alike, Likeness())
        return PictureRow(
            setting=job.setting,
            path=job.path.name,
            render_flags=(*self._scene.flags, *job.path.flags),
            frame_seconds=middle,
            frame_seconds_quartiles=(low, high),
            psnr_db=whole.psnr_db,
            ssim=whole.ssim,
            psnr_db_by_view=tuple(one.psnr_db for one in alike),
            differences=tuple(differences),
        )

    def _frames(self, volume: Volume, path: RenderPath) -> list[RenderedImage]:
        """Rounds of all views in turn, so that no frame finds a slab as it left it.

        Before them small ones, for which bricks are read and shaders compiled.
        """
        views = range(len(self._wanted))
        for view in views:
            self._require_time()
            self._scene.draw(self._renderer, volume, path, view, size=_WARMING_SIZE)
        frames: list[RenderedImage] = []
        for _ in range(self._options.repeats):
            spent = sum(image.stats.milliseconds["total"] for image in frames) / 1000
            if frames and (spent > self._options.row_seconds or self._deadline()):
                break  # fewer frames are timed, but the row is whole
            for view in views:
                if len(frames) < len(views):
                    self._require_time()
                frames.append(self._scene.draw(self._renderer, volume, path, view))
        return frames

    def _require_time(self) -> None:
        if self._deadline():
            raise _TimeIsOverError

    def _is_shown(self, job: _Job) -> bool:
        """The differences of the path that people use, and of all paths of one setting."""
        lossless = job.setting.codec is None
        return (
            (job.path is SLAB and not lossless)
            or job.setting is self._shown
            or (lossless and job.path.level > 0)
        )


def _require_labels(settings: Sequence[Setting]) -> None:
    labels = [setting.label for setting in settings]
    if len(set(labels)) != len(labels):
        raise InvalidInputError(f"settings {labels}: two have one label; give each its own")


def _jobs(settings: Sequence[Setting], nlevels: int) -> Iterator[_Job]:
    """The rows, the most important first, each once."""
    coarser = tuple(coarser_paths(nlevels))
    shown = [setting for setting in settings if setting is _shown(settings)]
    others = [setting for setting in settings if setting is not _shown(settings)]
    for paths, some in (
        ((SLAB,), settings),
        ((DEBLOCKED,), shown),
        (coarser, settings[:1]),
        ((DEBLOCKED,), others),
        (DIRECT, shown),
        (DIRECT, others),
        (coarser, settings[1:]),
    ):
        for setting in some:
            for path in paths:
                if path.applies_to(setting.codec):
                    yield _Job(settings.index(setting), setting, path)


def _shown(settings: Sequence[Setting]) -> Setting | None:
    """The setting of which all paths are shown: the first that has them all."""
    lossy = [setting for setting in settings if setting.codec is not None]
    direct = [setting for setting in lossy if DIRECT[0].applies_to(setting.codec)]
    return next(iter(direct or lossy), None)


def _named(jobs: Sequence[_Job], why: str) -> tuple[str, ...]:
    """What was left out, one line for a setting."""
    names: dict[str, list[str]] = {}
    for job in jobs:
        names.setdefault(job.setting.label, []).append(job.path.name)
    return tuple(
        f"pictures of {label} by {'; '.join(paths)}: {why}" for label, paths in names.items()
    )


def _warm_seconds(frames: Sequence[RenderedImage], path: RenderPath) -> list[float]:
    """Of frames that had all bricks in memory; of all frames where memory has no room for them.

    Direct rendering puts a view's bricks together anew for each view; that is taken off.
    """
    if "direct" in path.arguments:
        passes = [image.stats.milliseconds for image in frames]
        return [(times["total"] - times.get("load", 0.0)) / 1000 for times in passes]
    warm = [image.stats for image in frames if not image.stats.uploaded_nbytes]
    return [stats.milliseconds["total"] / 1000 for stats in warm or [i.stats for i in frames]]


def _slug(text: str) -> str:
    return re.sub("[^a-z0-9]+", "-", text.lower().replace("³", "")).strip("-")
