"""Sampling straight from S3Dc codes: nanoseconds per sample, beside the same samples of an array.

    python bench/s3dc_sampling.py [--data ../shared/data] [--json FILE] [--rounds 7] [--mib 256]

Points are random, or lie half a voxel apart along tiles of parallel rays, as a ray caster asks for
them. Volumes are repeated along z until they have --mib MiB, which no cache holds. One thread, on
processor time: times of a machine that does other things besides are comparable within a row.

"array" is sampled by the templates that sample the code, which fetch ahead for 32 points ("plain",
with its 16 fetches, does not); "loop" is the array, point by point, as a simple program does. Times
come from bench/s3dc_sampling.cpp, which is built here with cmake. Before, samples of each code are
compared with those that `octobrick.codec.reference_sampling` takes from the decoded volume.
"""

from __future__ import annotations

import argparse
import json
import platform
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from volumes import volumes

from octobrick.codec import S3dc, S3dcSampler, _native, reference_sampling
from octobrick.codec.arrays import SAMPLE_DTYPES

ROOT = Path(__file__).parents[1]
BITS = (2, 4, 8)
COLUMNS = (
    ("nearest_code", "nearest"),
    ("nearest_array", "array"),
    ("nearest_loop", "loop"),
    ("trilinear_code", "plain"),
    ("trilinear_shared_code", "shared"),
    ("trilinear_array", "array"),
    ("trilinear_loop", "loop"),
)


def build(folder: Path) -> Path:
    """Compiles bench/s3dc_sampling.cpp."""
    flags = ["-DOCTOBRICK_PYTHON=OFF", "-DOCTOBRICK_BENCH=ON"]
    for command in (
        ["cmake", "-S", str(ROOT), "-B", str(folder), *flags],
        ["cmake", "--build", str(folder), "--target", "s3dc_sampling"],
    ):
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return folder / "codec/s3dc_sampling"


def enlarged(voxels: NDArray[Any], mib: int) -> NDArray[Any]:
    """The volume, repeated along z until it has so many MiB."""
    times = max(1, -(-(mib << 20) // voxels.nbytes))
    return np.ascontiguousarray(np.tile(voxels, (times, 1, 1)))


def check(codec: S3dc, code: bytes, voxels: NDArray[Any]) -> dict[str, float]:
    """Fetches per sample; stops where samples are not those of the decoded volume."""
    points = np.random.default_rng(1).uniform(-1, np.array(voxels.shape[::-1]) + 1, (200_000, 3))
    sampler = S3dcSampler(codec, code, voxels.shape, voxels.dtype)
    decoded = codec.decode(code, voxels.shape, voxels.dtype)
    fetch = reference_sampling.fetch_from(decoded)
    between = reference_sampling.trilinear(fetch, voxels.shape, points).astype(np.float32)
    nearest = reference_sampling.nearest(fetch, voxels.shape, points).astype(np.float32)
    for found, expected in (
        (sampler.nearest(points), nearest),
        (sampler.trilinear(points), between),
        (sampler.trilinear(points, shared=False), between),
    ):
        np.testing.assert_array_equal(found, expected)
    number = SAMPLE_DTYPES.index(voxels.dtype)
    counter = _native.S3dcSampler(code, voxels.shape, number, codec.block, codec.bits)
    names = ("nearest", "trilinear", "trilinear_shared")
    kinds = (
        _native.Sampling.NEAREST,
        _native.Sampling.TRILINEAR,
        _native.Sampling.TRILINEAR_SHARED,
    )
    counts = [sum(counter.count_fetches(kind, points)) / len(points) for kind in kinds]
    return dict(zip(names, counts, strict=True))


def measure(
    program: Path, codec: S3dc, code: bytes, voxels: NDArray[Any], rounds: int
) -> dict[str, float]:
    """Nanoseconds per sample by way of sampling and set of points."""
    with tempfile.TemporaryDirectory() as folder:
        raw, coded = Path(folder) / "voxels", Path(folder) / "code"
        voxels.tofile(raw)
        coded.write_bytes(code)
        numbers = [
            SAMPLE_DTYPES.index(voxels.dtype), *voxels.shape, *codec.block, codec.bits, rounds,
        ]  # fmt: skip
        command = [str(program), str(raw), str(coded), *map(str, numbers)]
        text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    times: dict[str, float] = json.loads(text)
    return times


def print_row(bits: int, points: str, times: dict[str, float], fetches: float) -> None:
    ns = [times[f"{column}_{points}"] for column, _ in COLUMNS]
    plain, shared, array, loop = ns[3:]
    print(
        f"{bits:4} {points:7}"
        + "".join(f"{t:8.1f}" for t in ns)
        + f"{fetches:9.2f} {plain / shared:8.2f} {array / shared:8.2f} {loop / shared:8.2f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared/data")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--mib", type=int, default=256, help="of each volume, repeated along z")
    parser.add_argument("--edge", type=int, default=8, help="voxels of a block on each axis")
    parser.add_argument("--only", nargs="*", help="files to take, by a part of their names")
    arguments = parser.parse_args()
    report: dict[str, Any] = {"machine": platform.processor() or platform.machine(), "volumes": {}}
    with tempfile.TemporaryDirectory() as folder:
        program = build(Path(folder))
        for name, crop in volumes(arguments.data, 512):
            if arguments.only and not any(part in name for part in arguments.only):
                continue
            if crop.dtype not in (np.uint8, np.uint16):
                continue
            voxels = enlarged(crop, arguments.mib)
            entry: dict[str, Any] = {"shape": voxels.shape, "dtype": voxels.dtype.name, "rows": []}
            report["volumes"][name] = entry
            print(
                f"\n{name} {voxels.shape} {voxels.dtype}, blocks of {arguments.edge}; ns a sample"
            )
            print(" " * 12 + "".join(f"{head:>8}" for _, head in COLUMNS), end="")
            print("  fetches  /shared: plain    array     loop")
            for bits in BITS:
                codec = S3dc((arguments.edge,) * 3, bits)
                code = codec.encode(voxels)
                fetches = check(codec, code, voxels)
                times = measure(program, codec, code, voxels, arguments.rounds)
                entry["rows"].append({"bits": bits, "fetches": fetches, "ns": times})
                for points in ("random", "rays"):
                    print_row(bits, points, times, fetches["trilinear_shared"])
    if arguments.json:
        arguments.json.write_text(json.dumps(report, indent=2) + "\n")


if __name__ == "__main__":
    main()
