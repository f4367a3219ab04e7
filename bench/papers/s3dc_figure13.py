"""S3Dc, Figures 12 and 13: pictures of settings, and where they differ from the original.

    script/bench papers/s3dc_figure13 [--data ../shared/data] [--quick] [--json FILE]

Figure 12: the original; 4 bits with blocks of 16³; 2 bits with blocks of 2³ and of 64³, linear; the
differences of the last, by the nearest voxel and linear. Figure 13: 4 bits with 16³ by the nearest
voxel and linear, and their differences from the original, which is drawn linear. Colours
are those of `octobrick measure`. Shaded, from a head.
"""

from __future__ import annotations

from typing import Any

import _measure
import _paper
import numpy as np
from _scenes import SCENES, likeness
from numpy.typing import NDArray
from s3dc_table1 import View, coded

from octobrick.codec import S3dc
from octobrick.measure.pictures.difference_picture import (
    CLASSES,
    class_shares,
    difference_picture,
    pixel_errors,
)
from octobrick.renderer import Renderer

FILE = "ct_vhf_head.mhd"
BEST, FINE, COARSE = (16, 4), (2, 2), (64, 2)  # edge, bits

Pixels = NDArray[np.uint8]


def run(options: Any) -> dict[str, Any]:
    scene = next(s for s in SCENES if s.file == FILE)
    side = 192 if options.quick else options.side
    pictures: dict[str, Pixels] = {}
    with Renderer("1GiB") as renderer:
        exact = coded(scene, options.data, None)
        view = View(renderer, exact, scene)
        original = view.draw(exact, side, shading=True)
        for edge, bits in (BEST, FINE, COARSE):
            volume = coded(scene, options.data, S3dc((edge,) * 3, bits))
            name = f"{bits} bits, {edge}³"
            pictures[f"{name}, linear"] = view.draw(volume, side, shading=True)
            nearest = view.draw(volume, side, shading=True, direct="nearest")
            pictures[f"{name}, nearest"] = nearest
    away = {name: difference_picture(original, p) for name, p in pictures.items()}
    best, fine, coarse = (f"{bits} bits, {edge}³" for edge, bits in (BEST, FINE, COARSE))
    ways = [f"{best}, nearest", f"{best}, linear"]
    figure13 = [[pictures[w] for w in ways], [away[w] for w in ways]]
    figure12 = [
        [original, pictures[f"{best}, linear"]],
        [pictures[f"{fine}, linear"], pictures[f"{coarse}, linear"]],
        [away[f"{coarse}, nearest"], away[f"{coarse}, linear"]],
    ]
    _paper.save(_paper.mosaic(figure13), options.pictures / "s3dc-figure13")
    _paper.save(_paper.mosaic(figure12), options.pictures / "s3dc-figure12")
    rows = {n: likeness(original, p) | coloured(original, p) for n, p in pictures.items()}
    return {"volume": FILE, "side": side, **view.published(), "rows": rows}


def coloured(original: Pixels, other: Pixels) -> dict[str, float]:
    """Per cent of the pixels that are not black in both, by the name of the difference's class."""
    seen = original.any(axis=-1) | other.any(axis=-1)
    shares = class_shares(pixel_errors(original, other)[seen])
    return {kind.name: 100 * share for kind, share in zip(CLASSES, shares, strict=True)}


def table(found: dict[str, Any]) -> str:
    """Likeness, and the share of pixels of each colour."""
    lines = [
        [name, f"{row['psnr']:.2f}", f"{100 * row['ssim']:.2f}"]
        + [f"{row[kind.name]:.1f}" for kind in CLASSES]
        for name, row in found["rows"].items()
    ]
    head = [f"{found['volume']}, shaded", "dB", "SSIM %", *(kind.name for kind in CLASSES)]
    return _measure.layout(head, lines)


def main() -> None:
    parser = _paper.parser(__doc__)
    parser.add_argument("--side", type=int, default=352, help="pixels of the square pictures")
    options = parser.parse_args()
    _measure.report(options, run(options), table)


if __name__ == "__main__":
    main()
