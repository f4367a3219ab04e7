"""Frames of a large volume: passes, decode rate beside the device's copy rate, bytes a view moves.

    script/bench render_scale [--repeat 2] [--side 1024] [--frames 5] [--budget 8GiB] [--json FILE]

The volume is the bundled head, repeated along each axis (twice as often along z), at S3Dc 4 bits
with a gradient pyramid: 936x1024x1024 voxels with --repeat 2. *First* is a picture with nothing in
memory: read, upload, decode, cast. *Turned* is the next one, from another side; *near* a view from
close by, of a part of it. *Direct* kinds decode what rays touch, without a slab. Streaming: the
time to the first picture and to the one that has converged, from nothing. The decode rate counts
decoded bytes, of bricks that are resident, by the GPU's timer; the copy rate counts bytes read and
written by a copy from buffer to buffer, in the same run.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import _measure
import numpy as np

from octobrick.codec import S3dc
from octobrick.renderer import Camera, RenderedImage, Renderer, TransferFunction, frames
from octobrick.renderer.brick_codes import BrickCodes
from octobrick.renderer.brick_pool import BrickPool
from octobrick.renderer.context import GraphicsContext
from octobrick.renderer.slab_decoder import SlabDecoder, Target
from octobrick.renderer.slab_format import SlabFormat
from octobrick.store import Volume, ingest, open_volume
from octobrick.store.box import Box, cells_touching
from octobrick.store.sources import open_source

ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "bench" / "out"
COPY_NBYTES = 1 << 30
GREY = TransferFunction(((0.0, (0.0, 0.0, 0.0)), (1.0, (1.0, 1.0, 1.0))), ((0.0, 0.0), (1.0, 1.0)))
PASSES = ("select", "decode", "load", "empty space", "cast", "finish", "total")
KINDS: dict[str, dict[str, Any]] = {
    "unshaded": {"shading": False},
    "shaded": {},
    "shaded, deblocked": {"deblocking": True},
    "mip": {"mode": "mip", "transfer_function": GREY},
    "shaded, level 1, pyramid": {"level": 1, "gradients": "stored"},
    "shaded, level 1, differences": {"level": 1, "gradients": "differences"},
    "direct nearest": {"shading": False, "direct": "nearest"},
    "direct linear": {"shading": False, "direct": "linear"},
    "direct shared": {"shading": False, "direct": "shared"},
    "direct shared, shaded": {"direct": "shared"},
}
COPY_SHADER = """#version 450 core
layout(local_size_x = 256) in;
layout(std430, binding = 0) readonly buffer From { uvec4 source[]; };
layout(std430, binding = 1) writeonly buffer To { uvec4 target[]; };
uniform uint row;
void main() {
    uint i = gl_GlobalInvocationID.y * row + gl_GlobalInvocationID.x;
    target[i] = source[i];
}
"""


def main() -> None:
    parser = _measure.parser(__doc__)
    parser.add_argument("--repeat", type=int, default=2, help="of the head along x and y")
    parser.add_argument("--side", type=int, default=1024, help="pixels of the square pictures")
    parser.add_argument("--frames", type=int, default=5)
    parser.add_argument("--budget", default="8GiB", help="memory of the renderer")
    parser.add_argument("--threads", type=int, default=4, help="that read bricks")
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
    with Renderer(options.budget, threads=options.threads) as renderer:
        for kind in options.kinds:
            for zoom in (20.0, 1.0):  # compile what small pictures of it need
                frame(renderer, volume, kind, 30, zoom, 32)
            rows += measured(renderer, volume, kind, options)
        return {
            "gl_renderer": renderer.gl_renderer,
            "decodes_on": renderer.decodes_on,
            "shape_zyx": list(volume.levels[0].shape_zyx),
            "side": options.side,
            "copy_gb_per_s": copy_rates(),
            "decode_gb_per_s": {level: decode_rate(volume, level) for level in (0, 1)},
            "streaming": streamed(renderer, volume, options),
            "rows": rows,
        }


def copy_rates() -> dict[str, float]:
    """GB/s of a copy between two buffers on the device, read and written: the best of some."""
    context = GraphicsContext()
    with context.current() as gl:
        nbytes = COPY_NBYTES >> (3 if context.software else 0)
        one, other = gl.buffer(reserve=nbytes), gl.buffer(reserve=nbytes)
        program = gl.compute_shader(COPY_SHADER)
        program["row"] = 256 * 16384
        one.bind_to_storage_buffer(0)
        other.bind_to_storage_buffer(1)
        ways: dict[str, Callable[[], object]] = {
            "shader": lambda: program.run(16384, nbytes // 16 // (256 * 16384)),
            "copy": lambda: gl.copy_buffer(other, one),
        }
        rates = {}
        for name, copy in ways.items():
            seconds = []
            for _ in range(6):
                gl.finish()
                start = time.perf_counter()
                copy()
                gl.finish()
                seconds.append(time.perf_counter() - start)
            rates[name] = 2 * nbytes / min(seconds) / 1e9
    context.release()
    return rates


def decode_rate(volume: Volume, level: int) -> float:
    """GB/s of decoded voxels by the GPU's decoder, of resident bricks; on its own clock."""
    context = GraphicsContext()
    with context.current() as gl:
        z, y, x = (min(n, 512) for n in volume.levels[level].shape_zyx)
        box = Box((0, 0, 0), (z, y, x))
        pool, decoder = BrickPool(gl, 1 << 30), SlabDecoder(context, gl)
        codes = BrickCodes.of_voxels(volume, level, 0, 0)
        bricks = list(cells_touching(box, volume.brick_shape_zyx))
        texel = SlabFormat.of(np.dtype(volume.dtype))
        texture = gl.texture3d((x, y, z), 1, dtype=texel.gl_dtype)
        target = Target(texture, texel, box, 0.0)
        seconds = []
        for _ in range(8):
            gl.finish()
            start = time.perf_counter()
            query = gl.query(time=True)
            with query:
                decoder.decode(codes, pool, target, (0.0, 1.0), bricks)
            gl.finish()
            wall = time.perf_counter() - start
            seconds.append(wall if context.software else query.elapsed / 1e9)
    context.release()
    return box.nvoxels * texel.voxel_nbytes / min(seconds) / 1e9


def streamed(renderer: Renderer, volume: Volume, options: argparse.Namespace) -> dict[str, Any]:
    """From nothing in memory, files in the page cache: to the first picture, and to the last."""
    renderer.forget_bricks()
    camera, function = Camera.orbit(volume, 30, 20), TransferFunction.preset("ct-bone")
    start = time.perf_counter()
    seconds, uploaded = [], 0
    for image in frames(
        renderer, volume, camera.zoomed(1.2), function, (options.side, options.side), level=0
    ):
        seconds.append(time.perf_counter() - start)
        uploaded += image.stats.uploaded_nbytes
    return {
        "first_seconds": seconds[0],
        "converged_seconds": seconds[-1],
        "pictures": len(seconds),
        "uploaded_nbytes": uploaded,
    }


def frame(
    renderer: Renderer, volume: Volume, kind: str, azimuth: float, zoom: float, side: int
) -> RenderedImage:
    scene: dict[str, Any] = {"level": 0, "transfer_function": TransferFunction.preset("ct-bone")}
    scene |= KINDS[kind]
    camera = Camera.orbit(volume, azimuth, 20).zoomed(zoom)
    image = renderer.render(volume, camera, size=(side, side), **scene)
    if not image.premultiplied.any():
        raise SystemExit(f"{kind}: the picture is empty")
    return image


def measured(
    renderer: Renderer, volume: Volume, kind: str, options: argparse.Namespace
) -> list[dict[str, Any]]:
    images: dict[str, list[RenderedImage]] = {"first": [], "turned": [], "near": []}
    for i in range(options.frames):
        renderer.forget_bricks()
        images["first"].append(frame(renderer, volume, kind, 30 + 7 * i, 1.2, options.side))
        images["turned"].append(frame(renderer, volume, kind, 34 + 7 * i, 1.2, options.side))
        images["near"].append(frame(renderer, volume, kind, 34 + 7 * i, 5.0, options.side))
    return [row(kind, view, found) for view, found in images.items()]


def row(kind: str, view: str, images: list[RenderedImage]) -> dict[str, Any]:
    def median(name: str) -> float:
        return statistics.median(i.stats.milliseconds.get(name, 0.0) for i in images)

    return {
        "kind": kind,
        "view": view,
        "milliseconds": {name: median(name) for name in PASSES},
        "decoded_nbytes": statistics.median(i.stats.decoded_nbytes for i in images),
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
            f"{r['decoded_nbytes'] / 1e6:.0f}",
            f"{r['uploaded_nbytes'] / 1e6:.1f}",
            f"{r['bricks']['sampled']}/{r['bricks']['total']}",
            str(r["slabs"]),
        ]
        for r in result["rows"]
    ]
    head = ["kind", "view", "decode ms", "cast ms", "total ms", "decoded MB", "uploaded MB"]
    stream, copies = result["streaming"], result["copy_gb_per_s"]
    rates = ", ".join(f"level {k}: {v:.1f}" for k, v in result["decode_gb_per_s"].items())
    return (
        f"{result['gl_renderer']}, decodes on {result['decodes_on']}; {result['shape_zyx']} "
        f"voxels, {result['side']}² pixels\n"
        f"copy {copies['shader']:.0f} GB/s by a shader, {copies['copy']:.0f} by the driver; decode "
        f"on the GPU, GB/s of voxels: {rates}\n"
        f"from nothing: first picture {stream['first_seconds']:.2f} s, converged "
        f"{stream['converged_seconds']:.2f} s, {stream['pictures']} pictures, "
        f"{stream['uploaded_nbytes'] / 1e6:.0f} MB\n"
        + _measure.layout([*head, "bricks", "slabs"], rows)
    )


if __name__ == "__main__":
    main()
