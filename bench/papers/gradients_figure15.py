"""Gradients, Figures 3 and 15: coarse levels shaded on the fly, and by filtered gradients.

    script/bench papers/gradients_figure15 [--data ../shared/data] [--quick] [--json FILE]

Pictures of level 0, and of levels 1 and 2 shaded by differences of the coarse voxels and by the
stored, filtered and coded gradients: PSNR and SSIM beside level 0. Of the central 128³ voxels the
mean angle between the strongest fifth of the original gradients and the coarse ones, and the share
whose coarse gradient vanished, which is what makes the holes of Figure 3: filtered (equation 1),
the naive mean of 2×2×2, plain subsampling, and on the fly.
"""

from __future__ import annotations

from typing import Any

import _measure
import _paper
import numpy as np
from _scenes import SCENES
from gradient_pyramid import CROP, WAYS, measure
from PIL import Image
from render_quality import gradients, gradients_file
from volumes import source_crop

from octobrick.renderer import Renderer

LEVELS = 2
SHOWN = ("ct_vhf_head.mhd", "sim_heptane.nii.gz", "ct_cranium.nrrd")


def run(options: Any) -> dict[str, Any]:
    options.pictures.mkdir(parents=True, exist_ok=True)
    scenes = SCENES[: 1 if options.quick else None]
    found: dict[str, Any] = {"side": options.side, "pictures": [], "angles": {}}
    with Renderer("1GiB") as renderer:
        for scene in scenes:
            found["pictures"] += gradients(renderer, scene, options)
            voxels = source_crop(options.data / scene.file, CROP)
            found["angles"][scene.file] = measure(voxels, LEVELS)
    rows = []
    for scene in scenes:
        if scene.file in SHOWN or options.quick:
            wide = np.asarray(Image.open(options.pictures / gradients_file(scene, LEVELS)))
            rows.append(np.hsplit(wide, 3))
    _paper.save(_paper.mosaic(rows), options.pictures / "gradients-figure15")
    return found


def table(found: dict[str, Any]) -> str:
    """Likeness of pictures; then angles and what vanished."""
    pictures = [
        [f"{row['volume']}, level {row['level']}"]
        + [f"{row[way]['psnr']:.2f}" for way in ("differences", "pyramid")]
        + [f"{row[way]['ssim']:.4f}" for way in ("differences", "pyramid")]
        for row in found["pictures"]
    ]
    angles = [
        [f"{file}, level {level + 1}"]
        + [f"{of[way][level]['mean_degrees']:.1f}" for way in WAYS]
        + [f"{100 * of[way][level]['vanished']:.2f}" for way in WAYS]
        for file, of in found["angles"].items()
        for level in range(LEVELS)
    ]
    head = ["pictures beside level 0", "on the fly dB", "filtered dB", "on the fly SSIM"]
    names = [way.replace("scalars", "on the fly") for way in WAYS]
    return "\n\n".join(
        [
            _measure.layout([*head, "filtered SSIM"], pictures),
            _measure.layout(
                ["gradients", *(f"{n} °" for n in names), *(f"{n} gone %" for n in names)], angles
            ),
        ]
    )


def main() -> None:
    parser = _paper.parser(__doc__)
    parser.add_argument("--side", type=int, default=320, help="pixels of the square pictures")
    options = parser.parse_args()
    _measure.report(options, run(options), table)


if __name__ == "__main__":
    main()
