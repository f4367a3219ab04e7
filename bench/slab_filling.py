"""Filling a slab with all voxels of a level, by shaders and on the CPU, deblocked or not.

    script/bench slab_filling [--data ../shared/data] [--quick] [--json FILE]

The CT bonsai, 256³ voxels of 8 bits, by codec; all bricks are at hand, compressed. Milliseconds,
medians; both ways take turns. Where shaders do not know the codec there is only the CPU. Texels
that differ between both ways fail.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import _measure

from octobrick.codec import S3dc, Zerobit
from octobrick.renderer.context import GraphicsContext
from octobrick.renderer.gpu_filler import GpuFiller
from octobrick.renderer.host_filler import HostFiller
from octobrick.renderer.slab_buffer import SlabBuffer
from octobrick.renderer.slab_filler import SlabContent, SlabFiller
from octobrick.renderer.slab_format import SlabFormat
from octobrick.renderer.slabs import power_of_two
from octobrick.store import Volume, ingest, open_volume
from octobrick.store.box import Box, cells_touching

SOURCE = "ct_bonsai.nii.gz"
CODECS: dict[str, S3dc | Zerobit | None] = {
    "S3Dc 4 bits": S3dc(),
    "S3Dc 2 bits": S3dc(bits=2),
    "S3Dc error 4": S3dc((4, 4, 4), max_error=4),
    "zerobit 5 %": Zerobit(),
    "lossless": None,
}
BY_SHADERS = ("S3Dc 4 bits", "S3Dc 2 bits", "lossless")
BUDGET_NBYTES = 1 << 28
ROUNDS, QUICK_ROUNDS = 9, 1
STRENGTH = 4.0


def run(data: Path, quick: bool) -> dict[str, Any]:
    """Milliseconds by codec and way."""
    figures: dict[str, Any] = {"machine": _measure.machine(), "milliseconds": {}}
    context = GraphicsContext()
    figures["gl_renderer"] = context.renderer_name
    for name, codec in CODECS.items():
        with TemporaryDirectory() as folder:
            path = Path(folder) / "volume.zarr"
            ingest(data / SOURCE, path, codec=codec)
            with open_volume(path) as volume:
                rounds = QUICK_ROUNDS if quick else ROUNDS
                figures["milliseconds"][name] = measure(context, volume, name, rounds)
    context.release()
    return figures


def measure(context: GraphicsContext, volume: Volume, name: str, rounds: int) -> dict[str, float]:
    """Milliseconds by way, of one volume."""
    with context.current() as gl:
        host = HostFiller(context, gl, BUDGET_NBYTES)
        gpu = GpuFiller(context, gl, BUDGET_NBYTES)
        plain, filtered = SlabBuffer(context, gl), SlabBuffer(context, gl)
        calls = {"CPU": filling(gl, volume, plain, host, None)}
        if name in BY_SHADERS:
            calls["CPU"]()
            texels = plain.read()
            calls["shaders"] = filling(gl, volume, plain, gpu, None)
            calls["shaders"]()
            if plain.read() != texels:
                raise SystemExit(f"{name}: shaders and the CPU disagree")
        calls["CPU, deblocked"] = filling(gl, volume, filtered, host, STRENGTH)
        seconds = _measure.alternating(calls, rounds)
        for slab in (plain, filtered):
            slab.release_texture()
        host.forget()
        gpu.forget()
    return {way: 1e3 * took for way, took in seconds.items()}


def filling(
    gl: Any, volume: Volume, slab: SlabBuffer, filler: SlabFiller, strength: float | None
) -> Callable[[], None]:
    """A call that fills a slab anew with all of level 0."""
    box = Box.of_shape(volume.levels[0].shape_zyx)
    bricks = list(cells_touching(box, volume.brick_shape_zyx))
    content = SlabContent(volume.revision, 0, 0, 0, box, strength)
    z, y, x = map(power_of_two, box.shape_zyx)

    def fill() -> None:
        slab.require(SlabFormat.of(volume.dtype, deblocked=strength is not None), (z, y, x))
        slab.held = None
        filler.fill(volume, slab, content, bricks)
        gl.finish()

    return fill


def table(figures: dict[str, Any]) -> str:
    """The figures as text."""
    ways = ("shaders", "CPU", "CPU, deblocked")
    rows = [
        (name, *(f"{took[way]:.1f}" if way in took else "" for way in ways))
        for name, took in figures["milliseconds"].items()
    ]
    return f"{figures['gl_renderer']}\n" + _measure.layout(("milliseconds", *ways), rows)


if __name__ == "__main__":
    _measure.main(__doc__, run, table)
