"""How true pictures are: what deblocking and the gradient pyramid make of them.

    script/bench render_quality [--data ../shared/data] [--side 384] [--json FILE] [--pictures DIR]

Deblocking: pictures of codes (S3Dc at 2 bits with blocks of 8³, zerobit at 2 %), shaded, beside the
picture of the uncompressed volume: PSNR and SSIM without and with the filter, and the mean jump at
the borders of blocks over that elsewhere. Gradients: pictures of levels 1 and 2, of lossless
volumes, beside that of level 0, shaded by central differences of what is shown, and by the stored
pyramid. Steps of half a voxel of level 0, the volume's own window, all of what is visible in view.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import _measure
import numpy as np
from _scenes import SCENES, Scene, camera_of, likeness, stored
from deblock import seam_energy
from numpy.typing import NDArray
from PIL import Image

from octobrick.codec import S3dc, Zerobit
from octobrick.codec.deblock import deblocked
from octobrick.renderer import Renderer
from octobrick.store import Volume

OUT = _measure.OUT / "quality"


CODES: dict[str, S3dc | Zerobit] = {"S3Dc 2 bits": S3dc((8, 8, 8), 2), "zerobit 2 %": Zerobit(0.02)}


def main() -> None:
    parser = _measure.parser(__doc__)
    parser.add_argument("--side", type=int, default=384, help="pixels of the square pictures")
    parser.add_argument("--pictures", type=Path, default=OUT, help="where to put them")
    options = parser.parse_args()
    options.pictures.mkdir(parents=True, exist_ok=True)
    scenes = [scene for scene in SCENES if (options.data / scene.file).exists()]
    scenes = scenes[:1] if options.quick else scenes
    with Renderer("1GiB") as renderer:
        result = {
            "machine": _measure.machine(),
            "gl_renderer": renderer.gl_renderer,
            "side": options.side,
            "deblocking": [row for scene in scenes for row in deblocking(renderer, scene, options)],
            "gradients": [row for scene in scenes for row in gradients(renderer, scene, options)],
        }
    _measure.report(options, result, table)


def deblocking(
    renderer: Renderer, scene: Scene, options: Any, codes: dict[str, S3dc | Zerobit] = CODES
) -> Iterator[dict[str, Any]]:
    """One row for each code, and of each a file with three pictures; see `deblocking_file`."""
    exact = stored(scene, options.data, "exact", codec=None)
    camera, function = camera_of(exact, scene)
    size, window = (options.side, options.side), exact.window

    def picture(volume: Volume, on: bool) -> NDArray[np.uint8]:
        image = renderer.render(
            volume, camera, function, size, level=0, window=window, deblocking=on
        )
        return image.rgba[..., :3]

    wanted = picture(exact, False)
    for name, codec in codes.items():
        volume = stored(scene, options.data, "coded", codec=codec)
        before, after = picture(volume, False), picture(volume, True)
        show = np.hstack([wanted, before, after])
        Image.fromarray(show).save(options.pictures / deblocking_file(scene, name))
        yield {
            "volume": scene.file,
            "code": name,
            "before": likeness(wanted, before) | {"seams": seams(exact, codec, False)},
            "after": likeness(wanted, after) | {"seams": seams(exact, codec, True)},
        }


def deblocking_file(scene: Scene, code: str) -> str:
    """Uncompressed, decoded, deblocked, side by side."""
    name = "".join(c if c.isalnum() else "-" for c in code.lower().replace(" %", ""))
    return f"deblocking-{scene.file.split('.')[0]}-{name}.png"


def seams(exact: Volume, codec: S3dc | Zerobit, filtered: bool) -> float:
    """Mean jump at the borders of blocks over that elsewhere, in the middle 128³ voxels."""
    voxels = exact.read(0)
    middle = tuple(slice(max(0, n // 2 - 64), n // 2 + 64) for n in voxels.shape)
    crop = np.ascontiguousarray(voxels[middle])
    code = codec.encode(crop)
    block = 4 if isinstance(codec, Zerobit) else codec.block[0]
    if filtered:
        return seam_energy(deblocked(codec, code, crop.shape, crop.dtype), block)
    return seam_energy(codec.decode(code, crop.shape, crop.dtype).astype(np.float32), block)


def gradients(renderer: Renderer, scene: Scene, options: Any) -> Iterator[dict[str, Any]]:
    """One row for each of levels 1 and 2, and of each a file; see `gradients_file`."""
    volume = stored(scene, options.data, "gradients", codec=None, gradients=True)
    camera, function = camera_of(volume, scene)

    def picture(level: int, source: str) -> NDArray[np.uint8]:
        image = renderer.render(
            volume,
            camera,
            function,
            (options.side, options.side),
            level=level,
            gradients=source,
            step_voxels=0.5 / 2**level,
        )
        return image.rgba[..., :3]

    wanted = picture(0, "differences")
    for level in (1, 2):
        differences, pyramid = picture(level, "differences"), picture(level, "stored")
        show = np.hstack([wanted, differences, pyramid])
        Image.fromarray(show).save(options.pictures / gradients_file(scene, level))
        yield {
            "volume": scene.file,
            "level": level,
            "differences": likeness(wanted, differences),
            "pyramid": likeness(wanted, pyramid),
        }


def gradients_file(scene: Scene, level: int) -> str:
    """Level 0, the coarse level by differences, and by the pyramid, side by side."""
    return f"gradients-{scene.file.split('.')[0]}-{level}.png"


def table(result: dict[str, Any]) -> str:
    def cells(found: dict[str, float], *more: str) -> list[str]:
        return [f"{found['psnr']:.2f}", f"{found['ssim']:.4f}", *(f"{found[m]:.2f}" for m in more)]

    deblocking = [
        [row["volume"], row["code"], *cells(row["before"], "seams"), *cells(row["after"], "seams")]
        for row in result["deblocking"]
    ]
    gradients = [
        [row["volume"], str(row["level"]), *cells(row["differences"]), *cells(row["pyramid"])]
        for row in result["gradients"]
    ]
    return "\n".join(
        [
            f"{result['gl_renderer']}, {result['side']}x{result['side']}, shaded",
            "",
            "Deblocking: picture beside that of the uncompressed volume",
            _measure.layout(
                ["volume", "code", "dB", "SSIM", "seams", "dB, on", "SSIM, on", "seams, on"],
                deblocking,
            ),
            "",
            "Gradients: picture of a coarse level beside that of level 0",
            _measure.layout(
                ["volume", "level", "dB, differences", "SSIM", "dB, pyramid", "SSIM"], gradients
            ),
        ]
    )


if __name__ == "__main__":
    main()
