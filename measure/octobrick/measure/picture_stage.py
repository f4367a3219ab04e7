"""Hands the part that is drawn, and the settings that are worth it, to the picture sweep."""

from __future__ import annotations

import importlib
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import S3dc
from octobrick.codec.errors import ResourceError
from octobrick.measure.drawn_part import drawn_box
from octobrick.measure.measurement import CodeRow, PictureRow, Setting
from octobrick.measure.options import MeasureOptions
from octobrick.measure.reference import Reference
from octobrick.measure.scan import Scan
from octobrick.measure.settings import LOSSLESS
from octobrick.store.box import Box

_SETTINGS_MAX = 6  # each takes seconds to ingest and to draw
_TOLD_DB = 75.0  # a setting above is hardly told from the original


class Drawn(Protocol):
    """What a picture sweep finds; see `octobrick.measure.pictures.sweep`."""

    @property
    def rows(self) -> tuple[PictureRow, ...]:
        """One for each setting and path."""

    @property
    def images(self) -> dict[str, bytes]:
        """PNG bytes."""

    @property
    def skipped(self) -> tuple[str, ...]:
        """What was left out, for people."""

    @property
    def gl_renderer(self) -> str:
        """The driver's name of the device that drew."""


PictureSweep = Callable[..., Drawn]
"""Of the arguments of `swept_pictures`."""


def swept_pictures(
    part: NDArray[Any],
    spacing_xyz: tuple[float, float, float],
    window: tuple[float, float],
    settings: Sequence[Setting],
    options: MeasureOptions,
    folder: Path,
    deadline: Callable[[], bool],
    report: Callable[[str, float], None],
) -> Drawn:
    """Pictures by the renderer, which is imported here, as it takes OpenGL.

    Raises:
        ResourceError: there is no OpenGL, or a package is missing.
    """
    sweep = importlib.import_module("octobrick.measure.pictures.sweep")
    views = importlib.import_module("octobrick.measure.pictures.views")
    chosen = tuple(views.ViewChoice(*view) for view in options.views) or views.DEFAULT_VIEWS
    picture_options = sweep.PictureOptions(views=chosen, size=options.size, preset=options.preset)
    drawn: Drawn = sweep.sweep_pictures(
        part, spacing_xyz, window, settings, picture_options, folder, deadline, report
    )
    return drawn


def draw(
    reference: Reference,
    scan: Scan,
    settings: Sequence[Setting],
    options: MeasureOptions,
    *,
    sweep: PictureSweep,
    deadline: Callable[[], bool],
    report: Callable[[str, float], None],
) -> tuple[Drawn | None, Box, tuple[str, ...]]:
    """Pictures of the part, which part, and what is to be said where there are none.

    Args:
        reference: of whose first time step and channel a part is read.
        scan: of it.
        settings: to draw, the most important first.
        options: views and size.
        sweep: draws.
        deadline: whether time is over.
        report: told what is done, and what share.
    """
    source = reference.source
    box = drawn_box(scan, source.shape_zyx)
    report("pictures: reading the part that is drawn", 0.0)
    part = source.read(box)
    if part.dtype.kind == "f" and reference.options.replace_nonfinite is not None:
        value = part.dtype.type(reference.options.replace_nonfinite)
        part = np.where(np.isfinite(part), part, value)
    z, y, x = source.spacing_zyx
    with tempfile.TemporaryDirectory(prefix="octobrick-measure-") as folder:
        try:
            drawn = sweep(
                part, (x, y, z), scan.window, settings, options, Path(folder), deadline, report
            )
        except ResourceError as error:  # codes are worth having without pictures
            return None, box, (f"pictures: {error.message}",)
    return drawn, box, drawn.skipped


def worth_drawing(
    rows: Sequence[CodeRow], front: Sequence[str], recommended: Sequence[Setting]
) -> list[Setting]:
    """Lossless, what is recommended, fixed rates that can be drawn directly, and of the front.

    Args:
        rows: of codes.
        front: labels of those that none beats.
        recommended: for the targets.
    """
    known = {row.setting.label: row for row in rows}
    chosen = {LOSSLESS.label: LOSSLESS}
    chosen |= {setting.label: setting for setting in recommended}
    fixed = S3dc((8, 8, 8), bits=4), S3dc((8, 8, 8), bits=2)
    chosen |= {row.setting.label: row.setting for row in rows if row.setting.codec in fixed}
    told = [label for label in front if (known[label].psnr_db or np.inf) < _TOLD_DB]
    room = max(_SETTINGS_MAX - len(chosen), 0)
    if told and room:
        spread = np.linspace(0, len(told) - 1, min(room, len(told))).round().astype(int)
        chosen |= {told[i]: known[told[i]].setting for i in spread}
    return list(chosen.values())
