"""Frames of a large volume: passes, decode rate beside the device's copy rate, bytes a view moves.

    script/bench render_scale [--repeat 2] [--side 1024] [--frames 5] [--json FILE]

The volume is the bundled head, repeated along each axis (4 times as often along z), at S3Dc 4 bits
with a gradient pyramid: 936x1024x1024 voxels with --repeat 2. *First* is a picture with nothing on
the device: read, upload, decode, cast. *Turned* is the next one from another side; *near* a view
from close by, of a part of it. Decode rates count decoded bytes; the copy rate counts bytes read
and written by a copy from buffer to buffer, in the same run.
"""

from __future__ import annotations

import argparse
import statistics
import time
from pathlib import Path
from typing import Any

import _measure
import numpy as np

from octobrick.codec import S3dc
from octobrick.renderer import Camera, RenderedImage, Renderer, TransferFunction
from octobrick.renderer.context import GraphicsContext
from octobrick.store import Volume, ingest, open_volume
from octobrick.store.box import Box
from octobrick.store.sources import open_source

ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "bench" / "out"
COPY_NBYTES = 1 << 30
GREY = TransferFunction(((0.0, (0.0, 0.0, 0.0)), (1.0, (1.0, 1.0, 1.0))), ((0.0, 0.0), (1.0, 1.0)))
PASSES = ("select", "decode", "empty space", "cast", "total")
KINDS: dict[str, dict[str, Any]] = {
    "unshaded": {"shading": False},
    "shaded": {},
    "shaded, deblocked": {"deblocking": True},
    "mip": {"mode": "mip", "transfer_function": GREY},
    "shaded, level 1, pyramid": {"level": 1, "gradients": "stored"},
    "shaded, level 1, differences": {"level": 1, "gradients": "differences"},
}


def main() -> None:
    parser = _measure.parser(__doc__)
    parser.add_argument("--repeat", type=int, default=2, help="of the head along x and y")
    parser.add_argument("--side", type=int, default=1024, help="pixels of the square pictures")
    parser.add_argument("--frames", type=int, default=5)
    parser.add_argument("--budget", default="8GiB", help="memory of the renderer")
    parser.add_argument("--kinds", nargs="*", default=list(KINDS), choices=list(KINDS))
    options = parser.parse_args()
    volume = made(options.repeat)
    _measure.report(options, run(volume, options), table)


def made(repeat: int) -> Volume:
    """The repeated head, ingested once."""
    path = OUT / f"render_scale_{repeat}.zarr"
    if not path.exists():
        OUT.mkdir(parents=True, exist_ok=True)
        with open_source(ROOT / "data" / "ct_vhf_head.mhd") as source:
            head = source.read(Box.of_shape(source.shape_zyx))
        raw = OUT / "render_scale.npy"
        np.save(raw, np.tile(head, (2 * repeat, repeat, repeat)))
        started = time.perf_counter()
        ingest(raw, path, codec=S3dc(), gradients=True)
        print(f"# ingested with gradients in {time.perf_counter() - started:.1f} s")
        raw.unlink()
    return open_volume(path)


def run(volume: Volume, options: argparse.Namespace) -> dict[str, Any]:
    rows = []
    with Renderer(options.budget) as renderer:
        for kind in options.kinds:
            warm(renderer, volume, kind)
            rows += measured(renderer, volume, kind, options)
        return {
            "gl_renderer": renderer.gl_renderer,
            "shape_zyx": list(volume.levels[0].shape_zyx),
            "side": options.side,
            "copy_gb_per_s": copy_rate(),
            "rows": rows,
        }


def copy_rate() -> float:
    """GB/s of a copy between two buffers on the device, read and written: the best of some."""
    context = GraphicsContext()
    with context.current() as gl:
        nbytes = COPY_NBYTES >> (3 if context.software else 0)
        one, other = gl.buffer(reserve=nbytes), gl.buffer(reserve=nbytes)
        seconds = []
        for _ in range(6):
            gl.finish()
            start = time.perf_counter()
            gl.copy_buffer(other, one)
            gl.finish()
            seconds.append(time.perf_counter() - start)
    context.release()
    return 2 * nbytes / min(seconds) / 1e9


def frame(
    renderer: Renderer, volume: Volume, kind: str, azimuth: float, zoom: float, side: int
) -> RenderedImage:
    scene = {"level": 0, "transfer_function": TransferFunction.preset("ct-bone")} | KINDS[kind]
    camera = Camera.orbit(volume, azimuth, 20).zoomed(zoom)
    image = renderer.render(volume, camera, size=(side, side), **scene)  # type: ignore[arg-type]
    if not image.premultiplied.any():
        raise SystemExit(f"{kind}: the picture is empty")
    return image


def warm(renderer: Renderer, volume: Volume, kind: str) -> None:
    """Compile the shaders, on a small picture of what one brick in view needs."""
    frame(renderer, volume, kind, 30, 20.0, 32)
    frame(renderer, volume, kind, 30, 1.0, 32)


def measured(
    renderer: Renderer, volume: Volume, kind: str, options: argparse.Namespace
) -> list[dict[str, Any]]:
    frames: dict[str, list[RenderedImage]] = {"first": [], "turned": [], "near": []}
    for i in range(options.frames):
        renderer.forget_bricks()
        frames["first"].append(frame(renderer, volume, kind, 30 + 7 * i, 1.2, options.side))
        frames["turned"].append(frame(renderer, volume, kind, 34 + 7 * i, 1.2, options.side))
        frames["near"].append(frame(renderer, volume, kind, 34 + 7 * i, 5.0, options.side))
    return [row(kind, view, images) for view, images in frames.items()]


def row(kind: str, view: str, images: list[RenderedImage]) -> dict[str, Any]:
    def median(name: str) -> float:
        return statistics.median(i.stats.milliseconds.get(name, 0.0) for i in images)

    decoded = statistics.median(i.stats.decoded_nbytes for i in images)
    return {
        "kind": kind,
        "view": view,
        "milliseconds": {
            n: median(n) for n in ("select", "decode", "empty space", "cast", "total")
        },
        "decoded_nbytes": decoded,
        "decode_gb_per_s": decoded / max(median("decode"), 1e-6) / 1e6,
        "uploaded_nbytes": statistics.median(i.stats.uploaded_nbytes for i in images),
        "resident_nbytes": images[-1].stats.resident_nbytes,
        "slabs": images[-1].stats.slabs,
        "bricks": images[-1].stats.bricks,
    }


def table(result: dict[str, Any]) -> str:
    rows = [
        [
            r["kind"],
            r["view"],
            *(f"{r['milliseconds'][n]:.1f}" for n in ("decode", "cast", "total")),
            f"{r['decode_gb_per_s']:.1f}",
            f"{r['decoded_nbytes'] / 1e6:.0f}",
            f"{r['uploaded_nbytes'] / 1e6:.1f}",
            f"{r['bricks']['sampled']}/{r['bricks']['total']}",
            str(r["slabs"]),
        ]
        for r in result["rows"]
    ]
    head = ["kind", "view", "decode ms", "cast ms", "total ms", "decode GB/s", "decoded MB"]
    return (
        f"{result['gl_renderer']}; {result['shape_zyx']} voxels, {result['side']}² pixels; "
        f"device copy {result['copy_gb_per_s']:.0f} GB/s\n"
        + _measure.layout([*head, "uploaded MB", "bricks", "slabs"], rows)
    )


if __name__ == "__main__":
    main()
