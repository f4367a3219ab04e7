"""How well coarse gradients tell the directions of the original ones, level by level.

    script/bench gradient_pyramid [--data ../shared/data] [--quick] [--json FILE]

Looks at the strongest fifth of the original gradients: the angle between each and the gradient of
the coarse voxel that it lies in, and the share whose coarse gradient has vanished (below a tenth
of its own). Four ways to a coarse gradient: `weighted` (gradients.reduce), `mean` of 2×2×2
gradients, `subsampled` (every second gradient), `scalars` (differences of reduced voxels, as a
shader would take them). Of each volume its central 128³ voxels.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import _measure
import numpy as np
from numpy.typing import NDArray
from volumes import volumes

from octobrick.codec import gradients, metrics
from octobrick.codec.reduce import mean2

CROP = 128
LEVELS = 3
WAYS = ("weighted", "mean", "subsampled", "scalars")
STRONGEST = 0.2
VANISHED = 0.1
Field = NDArray[np.float32]


def plain_mean(field: Field) -> Field:
    """The mean of every 2×2×2 gradients."""
    return np.stack([mean2(np.ascontiguousarray(field[..., i])) for i in range(3)], axis=-1)


def pyramids(voxels: NDArray[Any], levels: int) -> dict[str, list[Field]]:
    """The gradients of levels 1 and up, in every way, in units of the original voxel."""
    first = gradients.central_differences(voxels)
    ways: dict[str, list[Field]] = {way: [] for way in WAYS}
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


def run(data: Path, quick: bool) -> dict[str, Any]:
    """Every volume's angles and shares, and their means over the volumes."""
    found = {name: measure(voxels, LEVELS) for name, voxels in volumes(data, 64 if quick else CROP)}
    measures = ("mean_degrees", "p95_degrees", "vanished")
    means = {
        way: [
            {k: float(np.mean([of[way][level][k] for of in found.values()])) for k in measures}
            for level in range(LEVELS)
        ]
        for way in WAYS
    }
    return {"volumes": found, "mean_of_volumes": means}


def table(result: dict[str, Any]) -> str:
    """Mean angle, 95th percentile and share that vanished, of each way."""
    of_all = {**result["volumes"], "mean of all": result["mean_of_volumes"]}
    rows = [
        [name[:28], str(level + 1), *(figures(ways[way][level]) for way in WAYS)]
        for name, ways in of_all.items()
        for level in range(LEVELS)
    ]
    head = ["mean, 95 %, vanished", "level", *WAYS]
    return _measure.layout(head, rows)


def figures(found: dict[str, float]) -> str:
    degrees = f"{found['mean_degrees']:.1f}° {found['p95_degrees']:5.1f}°"
    return f"{degrees} {found['vanished']:6.1%}"


if __name__ == "__main__":
    _measure.main(__doc__, run, table)
