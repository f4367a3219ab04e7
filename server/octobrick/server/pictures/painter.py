"""Makes pictures: a renderer that stays warm, the volumes that it shows, and the encoders.

For one thread, in whatever process. Nothing here knows of sockets or queues.
"""

from __future__ import annotations

import logging
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from octobrick.codec.errors import CorruptDataError, NotFoundError, OctobrickError, ResourceError
from octobrick.server.catalog import OpenVolume
from octobrick.server.errors import VolumeReplacedError
from octobrick.server.pictures.picture_request import PictureBody
from octobrick.server.pictures.render_task import CONTENT_TYPES, PicturePart, RenderTask
from octobrick.server.views.view import View
from octobrick.store import LocalVolume, Volume, open_volume

if TYPE_CHECKING:
    from octobrick.renderer import RenderedImage, Renderer

logger = logging.getLogger(__name__)

VOLUMES_KEPT: Final = 16
"""Open volumes: each holds descriptors and tables of ranges."""
COARSE_SIDE: Final = 128
"""Longest side in pixels of a first, coarse picture before it is enlarged: some 20 ms."""


class Painter:
    """Renders and encodes what tasks ask for.

    The renderer is made when the first picture needs it, and made anew after an error that nobody
    foresaw, since its context may be in any state then.

    Args:
        make_renderer: makes the renderer.
        opener: opens a volume.
    """

    def __init__(
        self,
        make_renderer: Callable[[], Renderer],
        opener: Callable[[Path], LocalVolume] = open_volume,
    ) -> None:
        self._make_renderer = make_renderer
        self._opener = opener
        self._renderer: Renderer | None = None
        self._volumes: OrderedDict[str, OpenVolume] = OrderedDict()

    def paint(self, task: RenderTask, is_stopped: Callable[[], bool]) -> Iterator[PicturePart]:
        """The parts of a picture: one, or a coarse one before it if it is progressive.

        Args:
            task: what to render.
            is_stopped: whether nobody waits any more; asked between rendering and encoding, and
                between parts. What OpenGL has begun it finishes.

        Raises:
            VolumeReplacedError: the volume is not, or not any more, what the task says.
            OctobrickError: of the view, the store or the renderer.
        """
        picture = PictureBody.model_validate(task.picture)
        view = picture.to_view()
        started = time.monotonic()
        lent = self._volume(task)
        opened = {"open": time.monotonic() - started}
        try:
            if picture.progressive:
                yield from self._part(_coarse_view(view, lent.volume), lent, picture, opened, False)
            if not is_stopped():
                yield from self._part(view, lent, picture, opened, True, is_stopped)
        except CorruptDataError:
            if lent.is_current():
                raise
            raise _replaced() from None
        except OctobrickError:
            raise
        except Exception:
            self._release()
            raise

    def close(self) -> None:
        """Release the renderer and close all volumes. Idempotent."""
        self._release()
        while self._volumes:
            self._volumes.popitem()[1].volume.close()

    def _part(
        self,
        view: View,
        lent: OpenVolume,
        picture: PictureBody,
        seconds: dict[str, float],
        final: bool,
        is_stopped: Callable[[], bool] = lambda: False,
    ) -> Iterator[PicturePart]:
        started = time.monotonic()
        if self._renderer is None:
            self._renderer = self._make_renderer()
        if final:
            view = _within_budget(view, lent.volume, picture.budget_nbytes)
        image = view.render(self._renderer, lent.volume)
        rendered = time.monotonic()
        if not lent.is_current():  # what was read may be of two revisions
            raise _replaced()
        if is_stopped():
            return
        if not final:
            image = _enlarged(image, (picture.width, picture.height))
        body = _encoded(image, picture)
        stats, fidelity = image.stats, image.fidelity
        taken = {"render": rendered - started, "encode": time.monotonic() - rendered}
        passes = {
            f"render-{name.replace(' ', '-')}": ms / 1e3
            for name, ms in stats.milliseconds.items()
            if name != "total"
        }
        yield PicturePart(
            body,
            CONTENT_TYPES[picture.format],
            final,
            fidelity.level,
            fidelity.max_error,
            fidelity.converged and final,
            seconds | taken | passes,
            {"bricks": stats.resident_nbytes, "slab": stats.slab_nbytes},
        )

    def _volume(self, task: RenderTask) -> OpenVolume:
        kept = self._volumes.pop(task.path, None)
        if kept is not None and kept.stamp != task.stamp:
            kept.volume.close()
            kept = None
        lent = kept or self._open(task)
        if lent.volume.revision != task.revision or not lent.is_current():
            lent.volume.close()
            raise _replaced()
        self._volumes[task.path] = lent
        while len(self._volumes) > VOLUMES_KEPT:
            self._volumes.popitem(last=False)[1].volume.close()
        return lent

    def _open(self, task: RenderTask) -> OpenVolume:
        path = Path(task.path)
        try:
            return OpenVolume(self._opener(path), task.stamp, path)
        except NotFoundError:  # it was there when the task was written
            raise _replaced() from None
        except OSError as error:
            raise ResourceError(
                f"{path}: cannot be read ({error.strerror}); check its permissions",
                path=task.path,
            ) from error

    def _release(self) -> None:
        renderer, self._renderer = self._renderer, None
        if renderer is None:
            return
        try:
            renderer.close()
        except Exception:
            logger.exception("the renderer could not be closed")


def _replaced() -> VolumeReplacedError:
    return VolumeReplacedError("The volume was replaced while it was rendered; ask again")


def _coarse_view(view: View, volume: Volume) -> View:
    """The same view in the coarsest level that there is, with few pixels and nothing drawn on."""
    factor = COARSE_SIDE / max(*view.size, COARSE_SIDE)
    width, height = (max(1, round(side * factor)) for side in view.size)
    return replace(
        view,
        size=(width, height),
        level=max(view.level or 0, len(volume.levels) - 1),
        deblocking=False,
        scale_bar=False,
        legend=False,
    )


def _within_budget(view: View, volume: Volume, budget_nbytes: int | None) -> View:
    """The same view, at a coarser level where its bricks would take more than the budget."""
    if budget_nbytes is None:
        return view
    return replace(view, level=view.level_within(volume, budget_nbytes))


def _enlarged(image: RenderedImage, size: tuple[int, int]) -> RenderedImage:
    """A picture with more pixels, interpolated between those that there are."""
    from octobrick.renderer.picture_files import pillow

    module = pillow()
    small = module.fromarray(np.ascontiguousarray(image.rgba))
    # Pillow multiplies by alpha meanwhile, so what is transparent does not bleed into the rest.
    return replace(image, rgba=np.asarray(small.resize(size, module.Resampling.BILINEAR)))


def _encoded(image: RenderedImage, picture: PictureBody) -> bytes:
    from octobrick.renderer.picture_files import encoded

    return encoded(image, f".{picture.format}", picture.quality)
