"""Writes tests/golden/gradients/ from the reference implementation.

    python tests/golden/make_gradients.py

Tests read these files and never write them. Little-endian, three numbers a direction: NAME.vectors,
float64; NAME.code, their codes; NAME.decoded, float32 bits of what those decode to. vectors.json
lists the names and how many directions each has.
"""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import reference_gradients as reference

FOLDER = Path(__file__).parent / "gradients"
Vectors = NDArray[np.float64]


def signed(points: list[tuple[float, float, float]]) -> Vectors:
    """Every order and sign of the components of some points."""
    turned = sorted({p for point in points for p in itertools.permutations(point)})
    signs = list(itertools.product((1, -1), repeat=3))
    return np.array([np.multiply(p, s) for p in turned for s in signs], np.float64)


def lattice(count: int) -> Vectors:
    """Directions all over, from whole numbers: the same on every machine."""
    at, state = [], 1
    for _ in range(3 * count):
        state = state * 48271 % (2**31 - 1)
        at.append((state >> 15) - 2**15)
    return np.array(at, np.float64).reshape(count, 3)


CASES: dict[str, Vectors] = {
    "all_over": lattice(600),
    "borders": signed([(1, 0, 0), (1, 1, 0), (1, 1, 1), (2, 1, 0), (2, 1, 1), (4, 4, 1)]),
    "holes": signed([(1, 0.498, 0), (1, 0.996, 0), (256, 255, 254), (510, 1, 1)]),
    "lengths": np.array(
        [np.multiply((3, -2, 1), s) for s in (2.0**-1070, 2.0**-149, 1.0, 2.0**127, 2.0**1020)]
    ),
    "zeros": np.array([(0, 0, 0), (-0.0, 0, -0.0), (-0.0, 1, 0), (0, -0.0, -1)], np.float64),
}


def all_files() -> dict[str, bytes]:
    """Everything that belongs in the folder, by name."""
    files: dict[str, bytes] = {}
    for name, vectors in CASES.items():
        code = reference.encode_directions(vectors)
        files[f"{name}.vectors"] = vectors.astype("<f8").tobytes()
        files[f"{name}.code"] = code.tobytes()
        files[f"{name}.decoded"] = reference.decode_directions(code).astype("<f4").tobytes()
    # Bytes that no encoder writes decode too.
    edge = np.array([0, 1, 85, 126, 127, 128, 129, 170, 254, 255], np.uint8)
    code = np.stack(np.meshgrid(edge, edge, edge, indexing="ij"), axis=-1).reshape(-1, 3)
    files["any_bytes.code"] = code.tobytes()
    files["any_bytes.decoded"] = reference.decode_directions(code).astype("<f4").tobytes()
    counts = {name: len(vectors) for name, vectors in CASES.items()} | {"any_bytes": len(code)}
    lines = ",\n  ".join(json.dumps({"name": n, "count": c}) for n, c in counts.items())
    files["vectors.json"] = f'{{"version": 1, "vectors": [\n  {lines}\n]}}\n'.encode()
    return files


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name, content in all_files().items():
        (FOLDER / name).write_bytes(content)
