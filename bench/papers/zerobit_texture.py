"""Zerobit, Figure 19: solid textures on a mesh, their sizes, and what sampling them costs.

    script/bench papers/zerobit_texture [--data ../shared/data] [--quick] [--json FILE]

The paper's four procedural textures of 256³ (48 MB) and models are not at hand. Ours are two
marbles and two woods of `octobrick synth`, on the Stanford bunny, which is fitted into the texture.

Sizes: of the code alone, as the paper has it (three colours in one codebook, all cells that the
surface touches in one code, its pointers included; "whole" keeps all cells), and of the volume that
ingest makes (a code for each channel and brick, zstd behind it), level 0. PSNR is that of the cells
that are kept, peak 255.

Times: processor seconds of frames of 512² as the camera goes around, all threads, without a GPU.
"plain" is an uncompressed 3D texture in one piece, "tiles" what the renderer does: the tiles that
the surface touches, decoded when they are loaded, found through a table. The paper decodes each
texel as it is fetched, in software. They take turns; only ratios mean anything.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import _measure
import numpy as np
from numpy.typing import NDArray

from octobrick.codec import Zerobit, metrics
from octobrick.renderer import Camera
from octobrick.renderer.context import GraphicsContext
from octobrick.renderer.solid_texture.mesh_drawer import MeshDrawer
from octobrick.renderer.solid_texture.mesh_request import make_mesh_request
from octobrick.renderer.solid_texture.texture_tiles import TILE
from octobrick.store import Mesh, Placement, Volume, ingest, open_volume, read_mesh, synth
from octobrick.store.surface.cell_encoder import enlarged
from octobrick.store.surface.option import volume_bounds
from octobrick.store.surface.selection import level_selection

TEXTURES = (("marble", 0), ("marble", 1), ("wood", 0), ("wood", 1))
RATIOS = (0.03, 0.05, 0.10)
PICTURE = (512, 512)
FRAMES = 12  # of 54 in the paper
BUDGET_NBYTES = 2**30
PAPER = "188 to 540 KB of 48 MB at 3 to 10 %; +14 % nearest, +15 % linear"


def run(data: Path, quick: bool) -> dict[str, Any]:
    """Sizes of all textures; times of the first."""
    side = 128 if quick else 256
    mesh = read_mesh(data / "mesh_bunny.ply.gz")
    placement = Placement.fitted(mesh, *volume_bounds((side,) * 3, (1, 1, 1)), "y")
    cells = level_selection(mesh, placement, (side,) * 3, (1, 1, 1), side, 0)
    found: dict[str, Any] = {"side": side, "cells": cells.ncells, "textures": {}}
    with tempfile.TemporaryDirectory() as folder:
        for kind, seed in TEXTURES[: 2 if quick else 4]:
            path = Path(folder) / f"{kind}{seed}.npy"
            synth(kind, (side,) * 3, np.uint8, path, seed, rgb=True)
            texture = np.load(path)
            rows = [code_sizes(texture, cells.of_brick((0, 0, 0)), ratio) for ratio in RATIOS]
            for row in rows:
                row |= volume_sizes(path, mesh, placement, row["ratio"])
            found["textures"][f"{kind} {seed}"] = rows
        first = Path(folder) / f"{TEXTURES[0][0]}{TEXTURES[0][1]}.npy"
        found["times"] = times(first, mesh, placement, 6 if quick else FRAMES)
    return found


def code_sizes(texture: NDArray[Any], kept: NDArray[np.bool_], ratio: float) -> dict[str, Any]:
    """Of one code of all three colours, with the cells that are kept and with all."""
    codec = Zerobit(ratio, background=(0.0, 0.0, 0.0))
    voxels = enlarged(kept)
    code = codec.encode(np.where(voxels[..., np.newaxis], texture, 0), wanted=kept)
    decoded = codec.decode(code, texture.shape, texture.dtype)
    whole = codec.encode(texture)
    return {
        "ratio": ratio,
        "code_nbytes": len(code),
        "whole_nbytes": len(whole),
        "nbytes": texture.nbytes,
        "psnr_db": metrics.compare(texture[voxels], decoded[voxels]).psnr(255.0),
    }


def volume_sizes(path: Path, mesh: Mesh, placement: Placement, ratio: float) -> dict[str, Any]:
    """Of the volume on disk: its finest level, and all coarser ones."""
    result = ingest(
        path,
        path.with_suffix(".zarr"),
        codec=Zerobit(ratio),
        axes="zyxs",
        surface=mesh,
        surface_placement=placement,
        overwrite=True,
    )
    finest, *coarser = (level.stored_nbytes for level in result.levels)
    return {"volume_nbytes": finest, "coarser_nbytes": sum(coarser)}


def times(path: Path, mesh: Mesh, placement: Placement, nframes: int) -> dict[str, Any]:
    """Median processor milliseconds of a frame, by sampling and how the texture lies."""
    ingest(
        path,
        path.with_suffix(".zarr"),
        codec=Zerobit(RATIOS[-1]),
        axes="zyxs",
        surface=mesh,
        surface_placement=placement,
        overwrite=True,
    )
    with open_volume(path.with_suffix(".zarr")) as volume:
        context = GraphicsContext()
        with context.current() as gl:
            side = volume.levels[0].shape_zyx[0]
            ways = {
                "plain": MeshDrawer(context, gl, BUDGET_NBYTES, tile=side),
                "tiles": MeshDrawer(context, gl, BUDGET_NBYTES, tile=TILE),
            }
            found = frames(volume, mesh, gl, ways, nframes)
            for drawer in ways.values():
                drawer.release()
        context.release()
    return found | {"gl_renderer": context.renderer_name}


def frames(
    volume: Volume, mesh: Mesh, gl: Any, ways: dict[str, MeshDrawer], nframes: int
) -> dict[str, Any]:
    """Frames around the mesh, each drawn in both ways, in turn."""
    request = make_mesh_request(
        volume,
        mesh,
        Camera.orbit(volume, 0, 15),
        PICTURE,
        placement=None,
        up="z",
        sampling="linear",
        transfer_function=None,
        window=None,
        shading=True,
        background=(0, 0, 0),
        level=0,
        t=0,
        c=None,
        size_max=None,
    )
    found: dict[str, Any] = {"load_seconds": {}, "resident_nbytes": {}}
    for way, drawer in ways.items():
        start = time.perf_counter()
        found["resident_nbytes"][way] = drawer.texture(request).nbytes
        found["load_seconds"][way] = time.perf_counter() - start
    for sampling in ("nearest", "linear"):
        took: dict[str, list[float]] = {way: [] for way in ways}
        pictures = {}
        for frame in range(nframes + 1):  # the first compiles
            camera = Camera.orbit(volume, 360 * frame / nframes, 15)
            now = replace(request, sampling=sampling, camera=camera)
            for way, drawer in ways.items():
                start = time.process_time()
                drawer.draw(now)
                gl.finish()
                took[way].append(1e3 * (time.process_time() - start))
                pictures[way] = drawer.canvas.finished(now.background)
        worst = metrics.max_error(pictures["plain"], pictures["tiles"])
        medians = {way: statistics.median(ms[1:]) for way, ms in took.items()}
        overhead = statistics.median(
            b / a for a, b in zip(took["plain"][1:], took["tiles"][1:], strict=True)
        )
        found[sampling] = {"ms": medians, "overhead": overhead - 1, "largest_difference": worst}
    return found


def table(result: dict[str, Any]) -> str:
    """Sizes, then times."""
    rows = [
        [
            name,
            f"{row['ratio']:.0%}",
            f"{row['code_nbytes'] / 1024:.0f}",
            f"{row['nbytes'] / row['code_nbytes']:.0f}",
            f"{row['whole_nbytes'] / 1024:.0f}",
            f"{row['psnr_db']:.1f}",
            f"{row['volume_nbytes'] / 1024:.0f}",
            f"{row['coarser_nbytes'] / 1024:.0f}",
        ]
        for name, rows in result["textures"].items()
        for row in rows
    ]
    head = ("texture", "ratio", "code KB", "CR", "whole KB", "PSNR dB", "volume KB", "levels 1..")
    took = result["times"]
    lines = [
        [
            sampling,
            *(f"{took[sampling]['ms'][way]:.1f}" for way in ("plain", "tiles")),
            f"{took[sampling]['overhead']:+.0%}",
            f"{took[sampling]['largest_difference']:g}",
        ]
        for sampling in ("nearest", "linear")
    ]
    time_head = ("sampling", "plain ms", "tiles ms", "overhead", "largest difference")
    load = ", ".join(f"{way} {s:.1f} s" for way, s in took["load_seconds"].items())
    held = ", ".join(f"{way} {n / 2**20:.1f} MiB" for way, n in took["resident_nbytes"].items())
    share = result["cells"] / (result["side"] / 4) ** 3
    return (
        f"{result['side']}³, {result['cells']} cells kept ({share:.1%}); paper: {PAPER}\n"
        f"{_measure.layout(head, rows)}\n\n{_measure.layout(time_head, lines)}\n"
        f"loading: {load}; on the device: {held}; {took['gl_renderer']}"
    )


if __name__ == "__main__":
    _measure.main(__doc__, run, table)
