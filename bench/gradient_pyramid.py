"""How well coarse gradients tell the directions of the original ones, level by level.

    python bench/gradient_pyramid.py FOLDER [--crop 128] [--levels 3] [--json FILE]

Looks at the strongest fifth of the original gradients: the angle between each and the gradient of
the coarse voxel that it lies in, and the share whose coarse gradient has vanished (below a tenth
of its own). Four ways to a coarse gradient: `weighted` (gradients.reduce), `mean` of 2×2×2
gradients, `subsampled` (every second gradient), `scalars` (differences of reduced voxels, as a
shader would take them).
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import gradients, metrics
from octobrick.codec.reduce import mean2

from volumes import volumes  # isort: skip

STRONGEST = 0.2
VANISHED = 0.1
Field = NDArray[np.float32]


def plain_mean(field: Field) -> Field:
    """The mean of every 2×2×2 gradients."""
    return np.stack([mean2(np.ascontiguousarray(field[..., i])) for i in range(3)], axis=-1)


def pyramids(voxels: NDArray[Any], levels: int) -> dict[str, list[Field]]:
    """The gradients of levels 1 and up, in every way, in units of the original voxel."""
    first = gradients.central_differences(voxels)
    ways: dict[str, list[Field]] = {
        way: [] for way in ("weighted", "mean", "subsampled", "scalars")
    }
    weighted = mean = subsampled = first
    scalars = voxels.astype(np.float32)
    for level in range(1, levels + 1):
        weighted, mean = gradients.reduce(weighted), plain_mean(mean)
        subsampled, scalars = subsampled[::2, ::2, ::2], mean2(scalars)
        on_the_fly = gradients.central_differences(scalars, (2**level,) * 3)
        fields = (weighted, mean, subsampled, on_the_fly)
        for way, field in zip(ways, fields, strict=True):
            ways[way].append(field)
    return ways


def measure(voxels: NDArray[Any], levels: int) -> dict[str, list[dict[str, float]]]:
    """Per way and level: mean and 95th percentile angle, and the share that vanished."""
    first = gradients.central_differences(voxels)
    size = np.linalg.norm(first, axis=-1)
    strong = np.nonzero((size >= np.quantile(size, 1 - STRONGEST)) & (size > 0))
    found: dict[str, list[dict[str, float]]] = {}
    for way, fields in pyramids(voxels, levels).items():
        found[way] = []
        for level, field in enumerate(fields, 1):
            coarse = field[tuple(axis >> level for axis in strong)]
            angle = metrics.angular_error(first[strong], coarse)
            gone = np.linalg.norm(coarse, axis=-1) < VANISHED * size[strong]
            found[way].append(
                {
                    "mean_degrees": float(angle.mean()),
                    "p95_degrees": float(np.quantile(angle, 0.95)),
                    "vanished": float(gone.mean()),
                }
            )
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--crop", type=int, default=128)
    parser.add_argument("--levels", type=int, default=3)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()

    results = {}
    for name, voxels in volumes(options.folder, options.crop):
        results[name] = measure(voxels, options.levels)
        for level in range(options.levels):
            cells = "   ".join(
                f"{way} {rows[level]['mean_degrees']:5.1f}° {rows[level]['p95_degrees']:5.1f}° "
                f"{100 * rows[level]['vanished']:4.1f}%"
                for way, rows in results[name].items()
            )
            print(f"{name[:24]:24} level {level + 1}   {cells}", flush=True)
    for level in range(options.levels):
        cells = "   ".join(
            f"{way} {np.mean([r[way][level]['mean_degrees'] for r in results.values()]):.1f}°"
            for way in ("weighted", "mean", "subsampled", "scalars")
        )
        print(f"mean of all, level {level + 1}: {cells}")
    if options.json:
        options.json.write_text(json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
