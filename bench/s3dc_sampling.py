"""Sampling straight from S3Dc codes: nanoseconds per sample, beside the same samples of an array.

    script/bench s3dc_sampling [--data ../shared/data] [--quick] [--json FILE]

Points are random, or lie half a voxel apart along tiles of parallel rays, as a ray caster asks for
them. Volumes of 8 and 16 bits are repeated along z until they have 256 MiB, which no cache holds;
blocks of 8³ voxels, of 4³ where it says so; "4v" is a width per block, 4 bits per voxel in all.
One thread, on processor time: times of a machine that does other things
besides are comparable within a row.

"array" is sampled by the templates that sample the code, which fetch ahead for 32 points ("plain",
with its 16 fetches, does not); "loop" is the array, point by point, as a simple program does. Times
come from bench/s3dc_sampling.cpp, which is built here with cmake. Before, samples of each code are
compared with those that `octobrick.codec.reference_sampling` takes from the decoded volume.
"""

from __future__ import annotations

import json
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import _measure
import numpy as np
from numpy.typing import NDArray
from volumes import volumes

from octobrick.codec import S3dc, S3dcSampler, _native, reference_sampling
from octobrick.codec.arrays import SAMPLE_DTYPES

CODECS = {
    "2": S3dc((8, 8, 8), 2),
    "4": S3dc((8, 8, 8), 4),
    "8": S3dc((8, 8, 8), 8),
    "4v": S3dc((8, 8, 8), bits_per_voxel=4),
    "4v, 4³": S3dc((4, 4, 4), bits_per_voxel=4),
}
MIB = 256
COLUMNS = (
    ("nearest_code", "nearest"),
    ("nearest_array", "array"),
    ("nearest_loop", "loop"),
    ("trilinear_code", "plain"),
    ("trilinear_shared_code", "shared"),
    ("trilinear_array", "array"),
    ("trilinear_loop", "loop"),
)


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
            SAMPLE_DTYPES.index(voxels.dtype), *voxels.shape, *codec.block, codec.bits or 0,
            rounds,
        ]  # fmt: skip
        command = [str(program), str(raw), str(coded), *map(str, numbers)]
        text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    times: dict[str, float] = json.loads(text)
    return times


def run(data: Path, quick: bool) -> dict[str, Any]:
    """Nanoseconds and fetches per sample, by volume and bits."""
    rows: dict[str, Any] = {}
    with _measure.program("s3dc_sampling") as program:
        for name, crop in volumes(data, 64 if quick else 512):
            if crop.dtype not in (np.uint8, np.uint16):
                continue
            voxels = enlarged(crop, 1 if quick else MIB)
            found = []
            for bits, codec in CODECS.items():
                code = codec.encode(voxels)
                fetches = check(codec, code, voxels)
                times = measure(program, codec, code, voxels, 1 if quick else 5)
                found.append({"bits": bits, "fetches": fetches, "ns": times})
            rows[name] = {"shape": voxels.shape, "dtype": voxels.dtype.name, "rows": found}
            if quick and len(rows) == 2:
                break
    return {"rows": rows}


def table(figures: dict[str, Any]) -> str:
    """Nanoseconds, fetches of shared trilinear samples, and what those gain over the others."""
    lines = []
    for name, volume in figures["rows"].items():
        for row in volume["rows"]:
            for points in ("random", "rays"):
                ns = [row["ns"][f"{column}_{points}"] for column, _ in COLUMNS]
                plain, shared, array, loop = ns[3:]
                lines.append(
                    [f"{name[:20]} {volume['dtype']}", row["bits"], points]
                    + [f"{t:.1f}" for t in ns]
                    + [f"{row['fetches']['trilinear_shared']:.2f}"]
                    + [f"{t / shared:.2f}" for t in (plain, array, loop)]
                )
    head = ["ns a sample", "bits", "points", *(name for _, name in COLUMNS)]
    head += ["fetches", "plain/shared", "array/shared", "loop/shared"]
    return _measure.layout(head, lines)


if __name__ == "__main__":
    _measure.main(__doc__, run, table)
