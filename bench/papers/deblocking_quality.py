"""Deblocking: before and after, for S3Dc at 1 to 4 bits and zerobit, and by λ.

    script/bench papers/deblocking_quality [--data ../shared/data] [--quick] [--json FILE]

What the paper's lost sections measured is not known, so this is what we can say of its filter. Of
three volumes, shaded pictures beside the uncompressed one's, without and with the filter as the
renderer has it: PSNR, SSIM, and seams, the mean jump across borders of blocks over that elsewhere.
Of the same volumes' central voxels PSNR by λ: the filter of the paper's section 4 ("unlimited"),
its other reading, one axis after another ("sequential"), and limited by the code's bound ("auto").
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import _measure
import _paper
import numpy as np
from _scenes import SCENES, Scene
from deblock import DEFAULT_STRENGTH, STRENGTHS, decoded, filtered, measure, summary
from PIL import Image
from render_quality import deblocking, deblocking_file
from volumes import source_crop

from octobrick.codec import S3dc, Zerobit
from octobrick.renderer import Renderer

FILES = ("ct_bonsai.nii.gz", "ct_vhf_head.mhd", "ct_cranium.nrrd")
BLOCK = (8, 8, 8)
CODES: dict[str, S3dc | Zerobit] = {
    **{f"S3Dc {bits} bits": S3dc(BLOCK, bits) for bits in (1, 2, 3, 4)},
    "zerobit 2 %": Zerobit(0.02),
}
SHOWN_FILE, SHOWN_CODES = "ct_bonsai.nii.gz", ("S3Dc 1 bits", "S3Dc 2 bits", "zerobit 2 %")
WAYS_SHOWN = ("unlimited", "sequential", "auto")
CROP = 96  # voxels per axis, of the sweep


def run(options: Any) -> dict[str, Any]:
    options.pictures.mkdir(parents=True, exist_ok=True)
    scenes = [s for s in SCENES if s.file in FILES][: 1 if options.quick else None]
    pictures: list[dict[str, Any]] = []
    with Renderer("1GiB") as renderer:
        for scene in scenes:
            pictures += deblocking(renderer, scene, options, CODES)
    rows = [row for scene in scenes for row in sweep(scene, options.data)]
    found = {"side": options.side, "pictures": pictures, "rows": rows, "summary": summary(rows)}
    for scene in scenes:
        if scene.file == SHOWN_FILE:
            files = [options.pictures / deblocking_file(scene, code) for code in SHOWN_CODES]
            mosaic = _paper.mosaic([np.hsplit(np.asarray(Image.open(f)), 3) for f in files])
            _paper.save(mosaic, options.pictures / "deblocking")
    draw(found, options)
    return found


def sweep(scene: Scene, data: Path) -> Iterator[dict[str, Any]]:
    """A row for each code: blocks of 8³, or zerobit's cells."""
    voxels = source_crop(data / scene.file, CROP)
    for coded in decoded(voxels, quick=True):
        yield {"volume": scene.file, **measure(voxels, coded, STRENGTHS)}


def draw(found: dict[str, Any], options: Any) -> None:
    """The mean change of PSNR by λ, of each code."""
    with _paper.plots(options.pictures / "deblocking-strength", 2) as axes:
        for axis, way in zip(axes, ("unlimited", "auto"), strict=True):
            for code in dict.fromkeys(row["code"] for row in found["summary"]):
                axis.plot(STRENGTHS, gains(found["summary"], code, way), marker="o", label=code)
            axis.axhline(0, color="black", linewidth=0.8)
            axis.set_xscale("symlog", linthresh=1)
            axis.set(xticks=STRENGTHS, xticklabels=[f"{s:g}" for s in STRENGTHS], xlim=(-0.2, 90))
            axis.set(xlabel="λ", ylabel="change of PSNR, dB", title=way)
        axes[1].legend(fontsize=7, ncols=2, loc="upper right")


def gains(rows: list[dict[str, Any]], code: str, way: str) -> list[float]:
    """The mean change of PSNR at each strength."""
    return [row["mean_gain_db"] for row in rows if (row["code"], row["way"]) == (code, way)]


def table(found: dict[str, Any]) -> str:
    """Pictures before and after; then the sweep."""
    pictures = [
        [f"{row['volume']}, {row['code']}"]
        + [f"{row[k]['psnr']:.2f}" for k in ("before", "after")]
        + [f"{row[k]['ssim']:.4f}" for k in ("before", "after")]
        + [f"{row[k]['seams']:.2f}" for k in ("before", "after")]
        for row in found["pictures"]
    ]
    head = ["picture", "dB", "on", "SSIM", "on", "seams", "on"]
    by_volume = [
        [f"{row['volume']}, {row['code']}", f"{row['psnr_db']:.2f}"]
        + [f"{filtered(row, w, DEFAULT_STRENGTH)['gain_db']:+.2f}" for w in WAYS_SHOWN]
        for row in found["rows"]
    ]
    means = [
        [f"{code}, {way}", *(f"{g:+.2f}" for g in gains(found["summary"], code, way))]
        for code in dict.fromkeys(row["code"] for row in found["summary"])
        for way in ("unlimited", "auto")
    ]
    return "\n\n".join(
        [
            _measure.layout(head, pictures),
            _measure.layout(["voxels, λ 4", "dB", *WAYS_SHOWN], by_volume),
            _measure.layout(["mean change, dB, at λ", *(f"{s:g}" for s in STRENGTHS)], means),
        ]
    )


def main() -> None:
    parser = _paper.parser(__doc__)
    parser.add_argument("--side", type=int, default=320, help="pixels of the square pictures")
    options = parser.parse_args()
    _measure.report(options, run(options), table)


if __name__ == "__main__":
    main()
