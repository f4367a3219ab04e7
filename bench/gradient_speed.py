"""How fast gradients are made, reduced, encoded and decoded, on one thread and on all.

    python bench/gradient_speed.py [--millions 4] [--rounds 7] [--json FILE]

Prints medians in million vectors a second, and how far the decoded directions are off.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import gradients, metrics


def median_rate(call: Callable[[], object], count: int, rounds: int) -> float:
    """Million vectors a second; the first call, which makes tables and pages, does not count."""
    call()
    seconds = []
    for _ in range(rounds):
        start = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - start)
    return count / statistics.median(seconds) / 1e6


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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--millions", type=int, default=10, help="random directions to check")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()

    volume = np.random.default_rng(2).integers(0, 256, (128, 128, 128), np.uint8)
    field = gradients.central_differences(volume)
    code = gradients.encode_directions(field)
    count = volume.size
    rates: dict[str, dict[str, float]] = {}
    for name, threads in (("one thread", 1), ("all threads", None)):
        calls: dict[str, Callable[[], object]] = {
            "central differences": partial(gradients.central_differences, volume, threads=threads),
            "reduce": partial(gradients.reduce, field, threads=threads),
            "encode": partial(gradients.encode_directions, field, threads=threads),
            "decode": partial(gradients.decode_directions, code, threads=threads),
        }
        rates[name] = {k: median_rate(call, count, options.rounds) for k, call in calls.items()}
    found = {"million_per_second": rates, "error": errors(options.millions)}
    for name, values in rates.items():
        print(name, "  ".join(f"{k} {v:.1f} M/s" for k, v in values.items()))
    print(found["error"])
    if options.json:
        options.json.write_text(json.dumps(found, indent=2) + "\n")


if __name__ == "__main__":
    main()
