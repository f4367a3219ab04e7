"""Gradients: how fast they are made, reduced, encoded and decoded, and how far codes are off.

    script/bench gradient_speed [--quick] [--json FILE]

Medians in million vectors a second, on one thread and on all. Angles are of random directions,
beside rounding them plainly to three bytes; the largest hole is the furthest that any direction
can be from all codes, with the transform, and without, as a search and its bound find it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import _measure
import numpy as np
from numpy.typing import NDArray

from octobrick.codec import gradients, metrics, reference_gradients

SIDE = 128  # voxels of the cube that is timed
ROUNDS = 7
MILLIONS = 10  # random directions


def plainly_rounded(vectors: NDArray[np.float32]) -> NDArray[np.float32]:
    """What three bytes give without transform and search: odd components of the cube's surface."""
    on_cube = vectors / np.abs(vectors).max(axis=-1, keepdims=True) * 255
    rounded: NDArray[np.float32] = np.clip(2 * np.floor(on_cube / 2) + 1, -255, 255)
    return rounded


def errors(millions: int) -> dict[str, float]:
    """The greatest and the mean angle between random directions and what is stored of them."""
    rng, angles = np.random.default_rng(1), []
    for _ in range(millions):
        vectors = rng.normal(size=(1_000_000, 3)).astype(np.float32)
        coded = gradients.decode_directions(gradients.encode_directions(vectors))
        pair = [metrics.angular_error(vectors, v) for v in (coded, plainly_rounded(vectors))]
        angles.append([(angle.max(), angle.mean()) for angle in pair])
    worst, mean = np.max(angles, axis=0)[:, 0], np.mean(angles, axis=0)[:, 1]
    return {
        "directions": millions * 10**6,
        "max_degrees": float(worst[0]),
        "mean_degrees": float(mean[0]),
        "plain_rounding_max_degrees": float(worst[1]),
        "plain_rounding_mean_degrees": float(mean[1]),
    }


def holes() -> dict[str, dict[str, float]]:
    """The largest hole between directions that have a code, and a bound on it."""
    found = {}
    for name, percent in (("treated", reference_gradients.BLEND_PERCENT), ("untreated", 0)):
        least, most = reference_gradients.largest_hole(percent)
        found[name] = {"found_degrees": least, "bound_degrees": most}
    return found


def rates(rounds: int) -> dict[str, dict[str, float]]:
    """Million vectors a second, on one thread and on all."""
    volume = np.random.default_rng(2).integers(0, 256, (SIDE,) * 3, np.uint8)
    field = gradients.central_differences(volume)
    code = gradients.encode_directions(field)
    found = {}
    for name, threads in (("one_thread", 1), ("all_threads", None)):
        calls: dict[str, Callable[[], object]] = {
            "central_differences": partial(gradients.central_differences, volume, threads=threads),
            "reduce": partial(gradients.reduce, field, threads=threads),
            "encode": partial(gradients.encode_directions, field, threads=threads),
            "decode": partial(gradients.decode_directions, code, threads=threads),
        }
        medians = _measure.alternating(calls, rounds)
        found[name] = {call: volume.size / took / 1e6 for call, took in medians.items()}
    return found


def run(_data: Path, quick: bool) -> dict[str, Any]:
    """Rates, errors and holes; no volume is read."""
    return {
        "million_per_second": rates(3 if quick else ROUNDS),
        "error": errors(1 if quick else MILLIONS),
        "largest_hole": holes(),
    }


def table(result: dict[str, Any]) -> str:
    """Rates; then angles."""
    rates, error, hole = (result[k] for k in ("million_per_second", "error", "largest_hole"))
    calls = list(rates["one_thread"])
    speed = [
        [name.replace("_", " "), *(f"{row[call]:.1f}" for call in calls)]
        for name, row in rates.items()
    ]
    angles = [
        ["ours"]
        + [f"{error[k]:.4f}" for k in ("max_degrees", "mean_degrees")]
        + [f"{hole['treated'][k]:.4f}" for k in ("found_degrees", "bound_degrees")],
        ["plain rounding"]
        + [f"{error[f'plain_rounding_{k}_degrees']:.4f}" for k in ("max", "mean")]
        + [f"{hole['untreated'][k]:.4f}" for k in ("found_degrees", "bound_degrees")],
    ]
    head = [
        f"of {error['directions']:,} directions",
        "max °",
        "mean °",
        "largest hole °",
        "bound °",
    ]
    return "\n\n".join(
        [
            _measure.layout(["M/s", *(call.replace("_", " ") for call in calls)], speed),
            _measure.layout(head, angles),
        ]
    )


if __name__ == "__main__":
    _measure.main(__doc__, run, table)
