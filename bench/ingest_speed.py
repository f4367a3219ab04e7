"""Speed and memory of ingesting a large volume, beside a pyramid made with TensorStore.

    script/bench ingest_speed [--side 1024] [--rounds 3] [--memory 512MiB] [--folder DIR] [--json]

Generates a raw uint16 file of SIDE³ voxels (2 GiB for 1024) plane by plane: waves with noise, so
that nothing compresses to nothing. It is in the page cache then. Each round makes, in turn and each
in a process of its own, octobrick volumes (S3Dc at 4 bits, the same with gradients, lossless) and
what TensorStore makes of the same file: levels by 2×2×2 mean until one brick, sharded Zarr v3 with
the same bricks and shards, zstd 3. TensorStore measures no errors and keeps no ranges. Ends with
the time that one brick takes, step by step, on one thread.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from _measure import machine

BRICK, SHARD = 64, 4
ZSTD_OF_VOXELS, ZSTD_OF_CODES = 3, 1  # octobrick's defaults
OURS = {
    "octobrick, S3Dc": [],
    "octobrick, S3Dc, gradients": ["--gradients"],
    "octobrick, lossless": ["--codec", "lossless"],
}
PEER = "TensorStore, lossless"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--side", type=int, default=1024)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--memory", help="what octobrick may take")
    parser.add_argument("--folder", type=Path, help="where to write (a temporary folder)")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--peer", nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.peer:
        pyramid_by_tensorstore(Path(arguments.peer[0]), Path(arguments.peer[1]), arguments.side)
        return

    folder = Path(tempfile.mkdtemp(dir=arguments.folder, prefix="octobrick-ingest-"))
    try:
        result = measure(folder, arguments)
    finally:
        shutil.rmtree(folder)
    print(json.dumps(result, indent=1) if arguments.json else table(result))


def measure(folder: Path, arguments: argparse.Namespace) -> dict[str, Any]:
    side, source = arguments.side, folder / "waves.raw"
    generate(source, side)
    runs: dict[str, list[dict[str, float]]] = {name: [] for name in (*OURS, PEER)}
    for _ in range(arguments.rounds):
        for name, own in runs.items():
            dest = folder / "pyramid.zarr"
            command = (
                [sys.executable, __file__, "--side", str(side), "--peer", str(source), str(dest)]
                if name == PEER
                else ingest_command(source, dest, side, OURS[name], arguments.memory)
            )
            own.append(run_apart(command))
            own[-1]["stored_mebibytes"] = folder_nbytes(dest) / 2**20
            shutil.rmtree(dest)
    medians = {
        name: {key: statistics.median(run[key] for run in own) for key in own[0]}
        for name, own in runs.items()
    }
    for figures in medians.values():
        figures["megavoxels_per_second"] = side**3 / figures["seconds"] / 1e6
        figures["times_tensorstore"] = medians[PEER]["seconds"] / figures["seconds"]
    return {
        "machine": machine(),
        "side": side,
        "rounds": arguments.rounds,
        "memory": arguments.memory,
        "pyramids": medians,
        "brick_milliseconds": steps(source, side),
    }


def ingest_command(
    source: Path, dest: Path, side: int, options: list[str], memory: str | None
) -> list[str]:
    octobrick = str(Path(sys.executable).with_name("octobrick"))
    command = [octobrick, "ingest", str(source), str(dest), "--shape", f"{side},{side},{side}"]
    command += ["--dtype", "uint16", "--quiet", *options]
    return command + (["--memory", memory] if memory else [])


def run_apart(command: list[str]) -> dict[str, float]:
    """Wall and processor seconds, and peak memory, of a process."""
    started = time.monotonic()
    process = subprocess.Popen(command)
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.monotonic() - started
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)} failed with status {process.returncode}")
    return {
        "seconds": seconds,
        "processor_seconds": usage.ru_utime + usage.ru_stime,
        "peak_rss_mebibytes": usage.ru_maxrss / 1024,
    }


def pyramid_by_tensorstore(source: Path, dest: Path, side: int) -> None:
    """Levels of means until one brick, written shard by shard."""
    import tensorstore as ts

    context = ts.Context({"cache_pool": {"total_bytes_limit": 2**28}})
    voxels = np.memmap(source, "<u2", "r", shape=(side, side, side))
    finer, level = ts.array(voxels, context=context), 0
    while True:
        array = ts.open(zarr_spec(dest / str(level), finer.shape), context=context).result()
        for box in boxes(finer.shape, BRICK * SHARD):
            array[box].write(finer[box]).result()
        if max(array.shape) <= BRICK:
            return
        finer = ts.downsample(array, [2, 2, 2], "mean")
        level += 1


def zarr_spec(path: Path, shape: tuple[int, ...]) -> dict[str, Any]:
    codecs = [
        {"name": "bytes", "configuration": {"endian": "little"}},
        {"name": "zstd", "configuration": {"level": ZSTD_OF_VOXELS, "checksum": True}},
    ]
    sharding = {"chunk_shape": [BRICK] * 3, "codecs": codecs}
    grid = {"chunk_shape": [BRICK * SHARD] * 3}
    return {
        "driver": "zarr3",
        "kvstore": {"driver": "file", "path": f"{path}/"},
        "create": True,
        "metadata": {
            "shape": list(shape),
            "data_type": "uint16",
            "chunk_grid": {"name": "regular", "configuration": grid},
            "codecs": [{"name": "sharding_indexed", "configuration": sharding}],
        },
    }


def boxes(shape: tuple[int, ...], side: int) -> list[tuple[slice, ...]]:
    corners = np.ndindex(*(-(-n // side) for n in shape))
    return [
        tuple(slice(i * side, min((i + 1) * side, n)) for i, n in zip(at, shape, strict=True))
        for at in corners
    ]


def steps(source: Path, side: int) -> dict[str, float]:
    """Milliseconds that a brick in cache takes, step by step, on one thread; the least of many."""
    from octobrick.codec import S3dc, gradients, metrics, reduce
    from octobrick.store import frame as zstd_frame

    start = (side // 2, side // 4, side // 4)
    volume = np.memmap(source, "<u2", "r", shape=(side, side, side))
    around = np.array(volume[tuple(slice(i - 1, i + BRICK + 1) for i in start)])
    brick = around[1:-1, 1:-1, 1:-1]
    codec = S3dc(block=(8, 8, 8), bits=4)
    code = codec.encode(brick)
    decoded = codec.decode(code, brick.shape, brick.dtype)
    low, high = brick.min(), brick.max()
    gradient = gradients.reduced_differences(around, start_zyx=(1, 1, 1), shape_zyx=brick.shape)
    directions = gradients.encode_directions(gradient).tobytes()
    calls: dict[str, Callable[[], object]] = {
        "copy": brick.copy,
        "range": lambda: (around.min(), around.max()),
        "histogram": lambda: metrics.histogram(brick, low, high),
        "mean of 2×2×2": lambda: reduce.mean2(brick),
        "S3Dc encode": lambda: codec.encode(brick),
        "S3Dc decode": lambda: codec.decode(code, brick.shape, brick.dtype),
        "errors": lambda: metrics.compare(brick, decoded),
        "zstd of the code": lambda: zstd_frame.compress(code, ZSTD_OF_CODES),
        "zstd of the voxels": lambda: zstd_frame.compress(brick.tobytes(), ZSTD_OF_VOXELS),
        "gradient at half resolution": lambda: gradients.reduced_differences(
            around, start_zyx=(1, 1, 1), shape_zyx=brick.shape, threads=1
        ),
        "its reductions": lambda: gradients.reduce(gradient, threads=1),
        "its directions": lambda: gradients.encode_directions(gradient, threads=1),
        "zstd of the directions": lambda: zstd_frame.compress(directions, ZSTD_OF_CODES),
    }
    return {name: 1e3 * least_seconds(call) for name, call in calls.items()}


def least_seconds(call: Callable[[], object]) -> float:
    def once() -> float:
        started = time.perf_counter()
        call()
        return time.perf_counter() - started

    return min(once() for _ in range(50))


def folder_nbytes(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def table(result: dict[str, Any]) -> str:
    lines = [f"{result['side']}³ uint16, medians of {result['rounds']} rounds; {result['machine']}"]
    lines.append(
        f"{'':28} {'Mvoxel/s':>9} {'× peer':>7} {'CPU s':>7} {'MiB RAM':>8} {'MiB disk':>9}"
    )
    for name, run in result["pyramids"].items():
        lines.append(
            f"{name:28} {run['megavoxels_per_second']:9.0f} {run['times_tensorstore']:7.2f} "
            f"{run['processor_seconds']:7.1f} {run['peak_rss_mebibytes']:8.0f} "
            f"{run['stored_mebibytes']:9.0f}"
        )
    lines.append("one brick of 64³ voxels, one thread:")
    lines += [
        f"  {name:28} {milliseconds:7.3f} ms {BRICK**3 / milliseconds / 1e3:7.0f} Mvoxel/s"
        for name, milliseconds in result["brick_milliseconds"].items()
    ]
    return "\n".join(lines)


def generate(path: Path, side: int) -> None:
    """Write SIDE³ uint16 voxels, z slowest, with memory for a few planes."""
    noise = np.random.default_rng(0).integers(0, 200, (side, side)).astype(np.uint16)
    at = np.linspace(0, 6, side, dtype=np.float32)
    y, x = at[:, np.newaxis], at[np.newaxis, :]
    with path.open("wb") as file:
        for index, z in enumerate(at):
            wave = (np.sin(y + z) * np.cos(x - z / 2) + 1) * 30000
            plane = wave.astype(np.uint16) + np.roll(noise, 37 * index, axis=0)
            file.write(plane.astype("<u2").tobytes())


if __name__ == "__main__":
    main()
