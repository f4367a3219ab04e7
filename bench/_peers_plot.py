"""PSNR over bits of every method, a small picture for each volume."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from _peers_verdicts import Rows

STYLES = {
    "S3Dc fixed": ("#9ecae1", "s"),
    "S3Dc widths": ("#08519c", "o"),
    "S3Dc bound": ("#3182bd", "D"),
    "zerobit": ("#2ca25f", "^"),
    "zfp rate": ("#d94801", "o"),
    "zfp accuracy": ("#fd8d3c", "D"),
    "NanoVDB Fp": ("#756bb1", "s"),
    "NanoVDB FpN": ("#54278f", "D"),
    "blosc2 truncated": ("#636363", "v"),
}
"""Colour and mark of each family; ours are blue and green."""

COLUMNS = 6
_TICKS = (0.5, 1, 2, 4, 8, 16)
_CEILING_DB, _FLOOR_DB = 85, 15
"""What is drawn; codes above, and those without loss, have their mark at the upper edge."""


def draw(volumes: dict[str, Any], path: Path) -> None:
    """Writes the picture: above, bits that are resident; below, bits on disk."""
    import matplotlib as mpl

    mpl.use("agg")
    from matplotlib import pyplot as plt
    from matplotlib.lines import Line2D

    names = list(volumes)
    columns = min(COLUMNS, len(names))
    lines = -(-len(names) // columns)
    figure, axes = plt.subplots(
        2 * lines, columns, figsize=(2.6 * columns, 4.6 * lines + 0.7), squeeze=False, sharey=True
    )
    for part, key in enumerate(("resident_bits", "disk_bits")):
        for k, name in enumerate(names):
            axis = axes[part * lines + k // columns][k % columns]
            _panel(axis, volumes[name]["rows"], key)
            axis.set_title(name, fontsize=9)
            if k % columns == 0:
                axis.set_ylabel("PSNR, dB", fontsize=8)
            axis.set_xlabel(f"{key.partition('_')[0]} bits per voxel", fontsize=8)
        for k in range(len(names), lines * columns):
            axes[part * lines + k // columns][k % columns].set_visible(False)
    handles = [
        Line2D([], [], color=color, marker=mark, markersize=4, label=family)
        for family, (color, mark) in STYLES.items()
    ]
    figure.legend(handles=handles, loc="lower center", ncols=len(STYLES), fontsize=8, frameon=False)
    figure.tight_layout(rect=(0, 0.03, 1, 1))
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _panel(axis: Any, rows: Rows, key: str) -> None:
    for family, (color, mark) in STYLES.items():
        points = sorted(
            (row[key], _CEILING_DB if row["is_lossless"] else min(row["psnr_db"], _CEILING_DB))
            for row in rows.values()
            if row["family"] == family
            and "failed" not in row
            and (row["is_sampled"] or key == "disk_bits")
        )
        if points:
            axis.plot(*zip(*points, strict=True), color=color, marker=mark, markersize=4, lw=1.2)
    axis.set_xscale("log", base=2)
    axis.set_xlim(0.25, 34)
    axis.set_xticks(_TICKS, [f"{tick:g}" for tick in _TICKS])
    axis.minorticks_off()
    axis.set_ylim(_FLOOR_DB, _CEILING_DB + 3)
    axis.tick_params(labelsize=7)
    axis.grid(color="#e5e5e5", lw=0.5)
