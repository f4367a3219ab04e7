"""Gradients, Tables 2, 3 and 4: rates of making and coding gradients, and the LUT of the encoder.

    script/bench papers/gradients_tables [--data ../shared/data] [--quick] [--json FILE]

Table 2: million voxels a second of processor time, on one thread as the paper's: central
differences, the pyramid by the filter, and encoding of its levels and of level 0. The paper gives
seconds for three volumes of which only the size is known; its rates are the size over these.

Tables 3 and 4: the native encoder has no table of any size to choose. Here a table of the inverse
at the nodes of a grid is made by the reference's bisection and interpolated as the paper says, then
the same search as ever; beside it the native encoder, and rounding without any transform. All with
the same random directions.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import _measure
import numpy as np
from gradient_speed import plainly_rounded
from numpy.typing import NDArray
from volumes import source_crop

from octobrick.codec import gradients, metrics, reference_gradients

FILES = ("ct_bonsai.nii.gz", "ct_vhf_head.mhd")
CROP = 256  # voxels per axis
SIZES = (8, 32, 64, 128)  # of the table; the paper has no 8
PUBLISHED_SECONDS = {32: 0.55, 64: 1.59, 128: 6.17}  # Table 3
PUBLISHED_ERROR, PUBLISHED_UNCODED_ERROR = 0.165, 0.318  # Table 4, degrees
DIRECTIONS = 400_000
PART = 50_000  # directions searched at once
Floats = NDArray[np.float32]


class PublishedTimes(NamedTuple):
    """Table 2, on one thread of a Core i7 930."""

    volume: str
    million_voxels: float
    differences_seconds: float
    downsampling_seconds: float
    encoding_seconds: float


TABLE_2 = (
    PublishedTimes("Vix", 512 * 512 * 250 / 1e6, 10, 75, 62),
    PublishedTimes("Chameleon", 512**3 / 1e6, 20, 143, 129),
    PublishedTimes("Head", 512 * 512 * 485 / 1e6, 18, 134, 117),
)


def pyramid(field: Floats) -> list[Floats]:
    """Level 0 and all coarser ones, on one thread."""
    levels = [field]
    while max(levels[-1].shape[:3]) > 1:
        levels.append(gradients.reduce(levels[-1], threads=1))
    return levels


def encode_all(levels: list[Floats]) -> None:
    for level in levels:
        gradients.encode_directions(level, threads=1)


def rates(voxels: NDArray[Any], rounds: int) -> dict[str, float]:
    """Million voxels of level 0 a processor second, the best of some rounds, on one thread."""
    field = gradients.central_differences(voxels)
    levels = pyramid(field)
    calls: dict[str, Callable[[], object]] = {
        "differences": partial(gradients.central_differences, voxels, threads=1),
        "downsampling": partial(pyramid, field),
        "encoding": partial(encode_all, levels),
    }
    took = {
        name: min(processor_seconds(call) for _ in range(rounds)) for name, call in calls.items()
    }
    return {name: voxels.size / seconds / 1e6 for name, seconds in took.items()}


def processor_seconds(call: Callable[[], object]) -> float:
    start = time.process_time()
    call()
    return time.process_time() - start


def lookup_table(size: int) -> NDArray[np.float64]:
    """The inverse transform (p, q) at the nodes i/size, j/size with j <= i."""
    i, j = np.indices((size + 1, size + 1))
    return np.stack(reference_gradients.invert(i / size, np.minimum(i, j) / size), axis=-1)


def looked_up(table: NDArray[np.float64], p: Floats, q: Floats) -> tuple[Floats, Floats]:
    """Interpolated between the three nearest nodes, as the paper says."""
    size = len(table) - 1
    i, j = (np.minimum((x * size).astype(int), size - 1) for x in (p, q))
    along_p, along_q = p * size - i, q * size - j
    lower = along_p >= along_q
    first, then = np.where(lower, along_p, along_q), np.where(lower, along_q, along_p)
    side = np.where(lower[:, np.newaxis], table[i + 1, j], table[i, j + 1])
    near, far = table[i, j], table[i + 1, j + 1]
    found = near + first[:, np.newaxis] * (side - near) + then[:, np.newaxis] * (far - side)
    return found[:, 0].astype(np.float32), found[:, 1].astype(np.float32)


def searched(vectors: Floats, near: Callable[[Floats, Floats], tuple[Floats, Floats]]) -> Floats:
    """What is decoded of vectors, sorted magnitudes each, when `near` says where to search."""
    found = []
    for start in range(0, len(vectors), PART):
        sizes = np.sort(np.abs(vectors[start : start + PART]), axis=-1)[:, ::-1]
        p, q = (sizes[:, k] / sizes[:, 0] for k in (1, 2))
        found.append(_best(p, q, *near(p, q)))
    return np.concatenate(found)


def _best(p: Floats, q: Floats, near_p: Floats, near_q: Floats) -> Floats:
    """Of the codes along (1, near_p, near_q) the one that decodes nearest to (1, p, q)."""
    wanted = np.stack([np.ones_like(p), p, q], axis=-1).astype(np.float64)
    best, least = np.zeros_like(wanted), np.full(len(p), np.inf)
    for a in reference_gradients.STEPS:
        b = np.clip(2 * np.floor(near_p * (a / 2)) + 1, 1, a)
        c = np.clip(2 * np.floor(near_q * (a / 2)) + 1, 1, b)
        parts = reference_gradients.transform(np.full_like(b, a), b, c)
        decoded = np.stack(parts, axis=-1).astype(np.float64)
        decoded /= np.linalg.norm(decoded, axis=-1, keepdims=True)
        away = -(wanted * decoded).sum(-1)
        better = away < least
        least = np.where(better, away, least)
        best[better] = decoded[better]
    return best.astype(np.float32)


def lookup(count: int) -> list[dict[str, Any]]:
    """Seconds to make each table, and the greatest and mean error with it."""
    vectors = np.random.default_rng(3).normal(size=(count, 3)).astype(np.float32)
    sizes = np.sort(np.abs(vectors), axis=-1)[:, ::-1].astype(np.float32)
    rows: list[dict[str, Any]] = []
    for size in SIZES:
        start = time.perf_counter()
        table = lookup_table(size)
        seconds = time.perf_counter() - start
        decoded = searched(vectors, partial(looked_up, table))
        rows.append({"size": size, "seconds": seconds, **angles(sizes, decoded)})
    coded = gradients.decode_directions(gradients.encode_directions(vectors))
    rows.append({"size": "native encoder", **angles(vectors, coded)})
    rows.append({"size": "no encoding", **angles(vectors, plainly_rounded(vectors))})
    return rows


def angles(wanted: Floats, found: Floats) -> dict[str, float]:
    angle = metrics.angular_error(wanted, found)
    return {"max_degrees": float(angle.max()), "mean_degrees": float(angle.mean())}


def run(data: Path, quick: bool) -> dict[str, Any]:
    """Rates of two volumes; tables for the inverse."""
    crop = 128 if quick else CROP
    volumes = {file: source_crop(data / file, crop) for file in FILES}
    count = DIRECTIONS // 10 if quick else DIRECTIONS
    return {
        "shapes": {file: voxels.shape for file, voxels in volumes.items()},
        "rates": {file: rates(voxels, 2 if quick else 3) for file, voxels in volumes.items()},
        "directions": count,
        "lookup": lookup(count),
    }


def table(found: dict[str, Any]) -> str:
    lines = [
        [file, *(f"{rate:.2f}" for rate in of_file.values())]
        for file, of_file in found["rates"].items()
    ]
    lines += [
        [f"published, {p.volume}"] + [f"{p.million_voxels / seconds:.2f}" for seconds in p[2:]]
        for p in TABLE_2
    ]
    text = [
        _measure.layout(["Mvoxel/s, one thread", "differences", "downsampling", "encoding"], lines)
    ]
    lines = []
    for row in found["lookup"]:
        size, seconds = row["size"], PUBLISHED_SECONDS.get(row["size"])
        published = {"no encoding": PUBLISHED_UNCODED_ERROR, 8: "-"}.get(size, PUBLISHED_ERROR)
        name = f"table {size}" if isinstance(size, int) else size
        made = f"{row['seconds']:.3f}" if "seconds" in row else "-"
        errors = [f"{row['max_degrees']:.4f}", f"{published}", f"{row['mean_degrees']:.4f}"]
        lines.append([name, made, f"{seconds or '-'}", *errors])
    head = [f"{found['directions']:,} directions", "made in s", "published", "max °", "published"]
    text.append(_measure.layout([*head, "mean °"], lines))
    return "\n\n".join(text)


if __name__ == "__main__":
    _measure.main(__doc__, run, table)
