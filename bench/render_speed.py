"""Frame times of the renderer by codec, step and shading, with what each pass takes.

    script/bench render_speed [--source FILE] [--side 512] [--preset ct-bone] [--frames 5] [--json]

Three kinds of frame: *cold*, with nothing on the GPU (upload, decode, cast); *turned*, from another
side, with all bricks resident and the slab decoded; *again*, the same view once more. Shaders are
compiled before. A picture without anything in it fails.
"""

from __future__ import annotations

import argparse
import json
import statistics
from pathlib import Path
from typing import Any

from octobrick.codec import S3dc
from octobrick.renderer import Camera, RenderedImage, Renderer, TransferFunction
from octobrick.store import Volume, ingest, open_volume

ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "bench" / "out"
CODECS = {"s3dc 4 bits": S3dc(), "lossless": None}
PASSES = ("select", "decode", "empty space", "cast", "total")


def main() -> None:
    arguments = parse_arguments()
    rows = [row for name in CODECS for row in measure_codec(name, arguments)]
    if arguments.json:
        print(json.dumps(rows, indent=1))
        return
    print(f"{rows[0]['gl_renderer']}; {arguments.side}x{arguments.side}, level {arguments.level}")
    head = f"{'codec':12} {'step':>5} {'shaded':>6} {'frame':>7}"
    print(head + "".join(f" {name:>11}" for name in PASSES) + "   (milliseconds, median)")
    for row in rows:
        times = "".join(f" {row['milliseconds'].get(name, 0):11.1f}" for name in PASSES)
        print(
            f"{row['codec']:12} {row['step_voxels']:5} {row['shading']!s:>6} "
            f"{row['frame']:>7}{times}"
        )


def parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--source", default=str(ROOT / "data" / "ct_vhf_head.mhd"))
    parser.add_argument("--side", type=int, default=512, help="pixels of the square picture")
    parser.add_argument("--preset", default="ct-bone", choices=TransferFunction.preset_names())
    parser.add_argument("--level", type=int, default=0)
    parser.add_argument("--frames", type=int, default=5)
    parser.add_argument("--json", action="store_true")
    return parser.parse_args()


def measure_codec(name: str, arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Ingest with one codec and time all kinds of frames."""
    OUT.mkdir(parents=True, exist_ok=True)
    path = OUT / f"render_speed_{name.split()[0]}.zarr"
    ingest(arguments.source, path, codec=CODECS[name], overwrite=True)
    rows = []
    with open_volume(path) as volume, Renderer() as renderer:
        for step_voxels in (1.0, 0.5):
            for shading in (False, True):
                frames = measure_frames(renderer, volume, arguments, step_voxels, shading)
                for kind, images in frames.items():
                    rows.append(
                        {
                            "codec": name,
                            "step_voxels": step_voxels,
                            "shading": shading,
                            "frame": kind,
                            "milliseconds": medians(images),
                            "bricks": images[0].stats.bricks,
                            "gl_renderer": renderer.gl_renderer,
                        }
                    )
    return rows


def measure_frames(
    renderer: Renderer,
    volume: Volume,
    arguments: argparse.Namespace,
    step_voxels: float,
    shading: bool,
) -> dict[str, list[RenderedImage]]:
    function = TransferFunction.preset(arguments.preset)

    def frame(azimuth: float) -> RenderedImage:
        image = renderer.render(
            volume,
            Camera.orbit(volume, azimuth, 20),
            function,
            (arguments.side, arguments.side),
            step_voxels=step_voxels,
            shading=shading,
            level=arguments.level,
        )
        if not image.premultiplied.any():
            raise SystemExit("the picture is empty; choose another --preset")
        return image

    frame(30)  # compiles
    kinds: dict[str, list[RenderedImage]] = {"cold": [], "turned": [], "again": []}
    for i in range(arguments.frames):
        renderer.forget_bricks()
        kinds["cold"].append(frame(30 + 7 * i))
        kinds["turned"].append(frame(33 + 7 * i))
        kinds["again"].append(frame(33 + 7 * i))
    return kinds


def medians(images: list[RenderedImage]) -> dict[str, float]:
    return {
        name: statistics.median(image.stats.milliseconds.get(name, 0.0) for image in images)
        for name in PASSES
    }


if __name__ == "__main__":
    main()
