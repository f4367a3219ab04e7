"""Plots of what ways to draw cost and lose."""

from __future__ import annotations

import re
from collections.abc import Sequence

from octobrick.measure.measurement import Measurement, PictureRow
from octobrick.measure.report.svg import inline_svg, new_figure, readable_log
from octobrick.measure.report.theme import INK, MUTED, PAPER, Style, styles_of

_LEVEL = re.compile(r"^level (\d+), (.+)$")
_VOXELS = "voxels"


def path_styles(measurement: Measurement) -> dict[str, Style]:
    """The mark of each path."""
    return styles_of(row.path for row in measurement.pictures)


def setting_styles(measurement: Measurement) -> dict[str, Style]:
    """The colour of each setting that was drawn."""
    return styles_of(row.setting.label for row in measurement.pictures)


def quality_against_time(measurement: Measurement) -> str | None:
    """Pictures' PSNR by milliseconds of a frame; None where no picture lost anything."""
    rows = [row for row in measurement.pictures if row.psnr_db is not None]
    if not rows:
        return None
    figure, axes = new_figure("milliseconds a frame", "PSNR of pictures (dB)", height_inches=3.9)
    axes.set_xscale("log")
    readable_log(axes.xaxis)
    colors, marks = setting_styles(measurement), path_styles(measurement)
    titles: dict[str, str] = {}
    for number, row in enumerate(rows):
        assert row.psnr_db is not None
        milliseconds = 1e3 * row.frame_seconds
        low, high = (1e3 * quartile for quartile in row.frame_seconds_quartiles)
        color, gid = colors[row.setting.label].color, f"picture-{number}"
        titles[gid] = (
            f"{row.setting.label}, {row.path}: {row.psnr_db:.2f} dB, {milliseconds:.4g} ms "
            f"({low:.4g} to {high:.4g})"
        )
        axes.plot([low, high], [row.psnr_db] * 2, color=color, linewidth=1.2, alpha=0.6, zorder=2)
        axes.plot(
            milliseconds, row.psnr_db, marks[row.path].marker, color=color, ms=6.5, mec=PAPER,
            mew=0.6, gid=gid, zorder=3,
        )  # fmt: skip
    for row in measurement.pictures:
        if row.psnr_db is None:
            axes.axvline(1e3 * row.frame_seconds, color=MUTED, linewidth=1, linestyle="dotted")
    label = "PSNR of pictures against the time of a frame, a mark for each path"
    return inline_svg(figure, "quality-time", label, titles)


def error_against_level(measurement: Measurement) -> str | None:
    """PSNR of voxels and of lossless pictures by level; None where there is no coarser level."""
    curves = level_curves(measurement)
    if not curves:
        return None
    figure, axes = new_figure("level shown instead of level 0", "PSNR (dB)", height_inches=3.1)
    styles = styles_of(curves)
    titles: dict[str, str] = {}
    for name, points in curves.items():
        style = styles[name]
        xs, ys = zip(*points, strict=True)
        axes.plot(xs, ys, color=style.color, linewidth=1.4, alpha=0.75)
        for x, y in points:
            gid = f"level-{len(titles)}"
            titles[gid] = f"level {x}, {name}: {y:.2f} dB"
            axes.plot(x, y, style.marker, color=style.color, ms=6.5, mec=PAPER, mew=0.6, gid=gid)
    levels = sorted({x for points in curves.values() for x, _ in points})
    axes.set_xticks(levels, labels=[str(level) for level in levels], color=INK)
    axes.margins(x=0.15)
    label = "PSNR of voxels and of pictures by level of the pyramid"
    return inline_svg(figure, "levels", label, titles)


def level_curves(measurement: Measurement) -> dict[str, list[tuple[int, float]]]:
    """(level, dB) of voxels and of each way to light a lossless picture, where they are known."""
    curves: dict[str, list[tuple[int, float]]] = {}
    for level in measurement.levels:
        if level.psnr_db is not None:
            curves.setdefault(_VOXELS, []).append((level.level, level.psnr_db))
    for row in _lossless(measurement.pictures):
        found = _LEVEL.match(row.path)
        if found is not None and row.psnr_db is not None:
            name = f"pictures, lit by {found[2]}"
            curves.setdefault(name, []).append((int(found[1]), row.psnr_db))
    return {name: sorted(points) for name, points in curves.items()}


def _lossless(rows: Sequence[PictureRow]) -> list[PictureRow]:
    return [row for row in rows if row.setting.codec is None]
