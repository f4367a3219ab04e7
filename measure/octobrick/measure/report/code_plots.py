"""Plots of what settings cost and lose, on the sampled bricks."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.metrics import Histogram
from octobrick.measure.measurement import CodeRow, Measurement
from octobrick.measure.report.svg import inline_svg, new_figure, plain, readable_log
from octobrick.measure.report.theme import INK, MUTED, PAPER, Style, styles_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Bits = Literal["disk_bits", "resident_bits"]

_MARK_POINTS: Final = 5.5
_RING_POINTS: Final = 11.0
_ROWS_MAX: Final = 40
"""Of the plot of rates: more lines are not looked at; the table has them all."""
_WORDS: Final = {"disk_bits": "on disk", "resident_bits": "in memory"}


def family_styles(measurement: Measurement) -> dict[str, Style]:
    """How each family of settings that lose something is drawn, in all plots."""
    lossy = (row for row in measurement.codes if row.psnr_db is not None)
    return styles_of(row.setting.family for row in lossy)


def recommended_labels(measurement: Measurement) -> tuple[str, ...]:
    """Of settings, each once."""
    labels = (one.setting.label for one in measurement.recommendations)
    return tuple(dict.fromkeys(labels))


def by_family(measurement: Measurement) -> list[CodeRow]:
    """All settings, families together, fewer bits on disk first."""
    families = list(dict.fromkeys(row.setting.family for row in measurement.codes))
    return sorted(
        measurement.codes, key=lambda row: (families.index(row.setting.family), row.disk_bits)
    )


def rate_distortion(measurement: Measurement, bits: Bits) -> str | None:
    """PSNR by bits of a voxel, a curve for each family; None where every setting is lossless."""
    rows = [row for row in measurement.codes if row.psnr_db is not None]
    if not rows:
        return None
    figure, axes = new_figure(f"bits per voxel {_WORDS[bits]}", "PSNR (dB)")
    titles = _curves(axes, measurement, rows, bits, "psnr_db")
    _log2_axis(axes, [getattr(row, bits) for row in measurement.codes])
    _lossless(axes, measurement, bits)
    if bits == "disk_bits":
        _front(axes, measurement, rows)
    _recommended(axes, measurement, rows, bits, "psnr_db")
    label = f"PSNR against bits per voxel {_WORDS[bits]}, one curve for each family of settings"
    return inline_svg(figure, f"rate-{bits.replace('_', '-')}", label, titles)


def error_against_bits(measurement: Measurement) -> str | None:
    """Greatest error by bits of a voxel on disk; None where every setting is lossless."""
    rows = [r for r in measurement.codes if r.max_error > 0 and r.psnr_db is not None]
    if not rows:
        return None
    figure, axes = new_figure("bits per voxel on disk", "greatest error (values)")
    axes.set_yscale("log")
    readable_log(axes.yaxis)
    titles = _curves(axes, measurement, rows, "disk_bits", "max_error")
    _log2_axis(axes, [row.disk_bits for row in rows])
    _recommended(axes, measurement, rows, "disk_bits", "max_error")
    label = "Greatest error against bits per voxel on disk, one curve for each family of settings"
    return inline_svg(figure, "max-error", label, titles)


def error_distribution(chosen: Sequence[CodeRow], styles: dict[str, Style]) -> str | None:
    """Which share of voxels errs by so much or more; None where none errs."""
    rows = [row for row in chosen if row.max_error > 0]
    if not rows:
        return None
    figure, axes = new_figure("error (values)", "share of voxels that err by so much")
    axes.set_yscale("log")
    floor = 1.0
    for row in rows:
        values, shares = _exceeding(row.errors)
        if not values.size:  # all errors are in the bin that begins at 0
            continue
        floor, style = min(floor, float(shares[shares > 0].min(initial=1.0))), styles[_label(row)]
        axes.step(values, np.where(shares > 0, shares, np.nan), where="post", color=style.color)
        axes.plot(values[0], shares[0], marker=style.marker, color=style.color, ms=_MARK_POINTS)
    axes.set_xscale("log")
    readable_log(axes.xaxis)
    axes.set_ylim(max(floor / 2, 1e-8), 1.3)
    axes.yaxis.set_major_formatter(lambda share, _: f"{100 * share:g} %")
    label = "Share of voxels whose error reaches a value, for some settings"
    return inline_svg(figure, "error-distribution", label, {})


def coding_rates(chosen: Sequence[CodeRow]) -> str | None:
    """Voxels encoded and decoded in a second, a line for each setting; None of no settings."""
    rows = chosen[:_ROWS_MAX]
    if not rows:
        return None
    figure, axes = new_figure(
        "million voxels per second, one thread", "", height_inches=0.9 + 0.235 * len(rows), grid="x"
    )
    axes.set_xscale("log")
    titles: dict[str, str] = {}
    for place, row in enumerate(reversed(rows)):
        encode, decode = row.encode_voxels_per_second / 1e6, row.decode_voxels_per_second / 1e6
        axes.plot([encode, decode], [place, place], color=MUTED, linewidth=1, zorder=1)
        for what, rate, face in (("encode", encode, PAPER), ("decode", decode, INK)):
            gid = f"{what}-{place}"
            titles[gid] = f"{row.setting.label}: {what} {rate:.4g} million voxels per second"
            axes.plot(rate, place, "o", color=INK, mfc=face, ms=_MARK_POINTS, gid=gid, zorder=2)
    labels = [plain(row.setting.label) for row in reversed(rows)]
    axes.set_yticks(range(len(rows)), labels=labels, color=INK)
    axes.set_ylim(-0.7, len(rows) - 0.3)
    readable_log(axes.xaxis)
    return inline_svg(figure, "rates", "Voxels encoded and decoded per second by setting", titles)


def _curves(
    axes: Axes, measurement: Measurement, rows: Sequence[CodeRow], x: str, y: str
) -> dict[str, str]:
    """Curves of families; what is shown when a point is pointed at, by gid."""
    titles: dict[str, str] = {}
    by_family = itertools.groupby(
        sorted(rows, key=lambda row: (row.setting.family, getattr(row, x))),
        key=lambda row: row.setting.family,
    )
    styles = family_styles(measurement)
    for family, some in by_family:
        style, points = styles[family], list(some)
        xs, ys = ([getattr(row, which) for row in points] for which in (x, y))
        axes.plot(xs, ys, color=style.color, linewidth=1.4, alpha=0.75, zorder=2)
        for row, at_x, at_y in zip(points, xs, ys, strict=True):
            gid = f"point-{len(titles)}"
            titles[gid] = f"{row.setting.label}: {at_x:.3g} bits, {at_y:.4g}"
            axes.plot(
                at_x, at_y, style.marker, color=style.color, ms=_MARK_POINTS, mec=PAPER, mew=0.6,
                gid=gid, zorder=3,
            )  # fmt: skip
    return titles


def _front(axes: Axes, measurement: Measurement, rows: Sequence[CodeRow]) -> None:
    """A dashed line through the settings that no other beats."""
    front = sorted((r for r in rows if r.setting.label in measurement.front), key=_disk_bits)
    xs, ys = ([getattr(row, which) for row in front] for which in ("disk_bits", "psnr_db"))
    axes.plot(xs, ys, color=INK, linewidth=0.9, linestyle="dashed", zorder=4)
    axes.plot(xs, ys, "o", ms=_RING_POINTS, mfc="none", mec=INK, mew=0.8, zorder=4)


def _recommended(
    axes: Axes, measurement: Measurement, rows: Sequence[CodeRow], x: str, y: str
) -> None:
    """Beside each setting that is recommended, the targets that it is recommended for."""
    targets: dict[str, list[str]] = {}
    for one in measurement.recommendations:
        targets.setdefault(one.setting.label, []).append(one.target)
    chosen = [row for row in rows if row.setting.label in targets]
    for place, row in enumerate(sorted(chosen, key=lambda row: float(getattr(row, x)))):
        at = getattr(row, x), getattr(row, y)
        axes.plot(*at, "o", ms=_RING_POINTS, mfc="none", mec=INK, mew=2, zorder=5)
        low, high = axes.get_xlim()
        left = at[0] ** 2 > low * high  # in the right half of a logarithmic axis
        # Neighbours have their names one above the other.
        offset = (-9, 7 + 11 * place) if left else (9, -12 - 11 * place)
        name = axes.annotate(
            plain(", ".join(targets[row.setting.label])),
            at, xytext=offset, textcoords="offset points",
            ha="right" if left else "left", color=INK, fontsize=8.5, fontweight="bold", zorder=6,
        )  # fmt: skip
        name.set_in_layout(False)


def _lossless(axes: Axes, measurement: Measurement, bits: Bits) -> None:
    """Lines for settings that lose nothing, the smallest with its name."""
    rows = [row for row in measurement.codes if row.psnr_db is None]
    rows.sort(key=lambda row: float(getattr(row, bits)))
    for row in rows:
        axes.axvline(getattr(row, bits), color=MUTED, linewidth=1, linestyle="dotted")
    for row in rows[:1]:
        axes.annotate(
            f"{plain(row.setting.label)}: nothing is lost", (getattr(row, bits), 0.03),
            xycoords=("data", "axes fraction"), xytext=(-3, 0), textcoords="offset points",
            rotation=90, color=MUTED, fontsize=8.5, ha="right",
        )  # fmt: skip


def _log2_axis(axes: Axes, bits: Sequence[float]) -> None:
    axes.set_xscale("log", base=2)
    low, high = max(min(bits), 2**-10), max(bits)
    axes.set_xlim(low / 1.25, high * 1.25)
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")


def _exceeding(errors: Histogram) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where bins begin, from above 0, and the share of voxels in them and the following."""
    counts = errors.counts.astype(np.float64)
    values = errors.low + errors.width * np.arange(counts.size, dtype=np.float64)
    above: NDArray[np.float64] = np.cumsum(counts[::-1])[::-1] / max(counts.sum(), 1)
    some = values > 0
    return values[some], above[some]


def _label(row: CodeRow) -> str:
    return row.setting.label


def _disk_bits(row: CodeRow) -> float:
    return row.disk_bits
