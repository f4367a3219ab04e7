"""Writes the golden vectors of S3Dc version 1: tests/golden/s3dc.

    python tests/golden/make_s3dc.py

Made once, by the numpy reference alone, so that they do not depend on what they are to check. They
are the format: if a change makes this script write other bytes, that change breaks every volume on
disk, and needs a new version of docs/spec/s3dc.md instead. Tests read them and never write.

Each vector is three files, little-endian and C-ordered (z, y, x), for readers in any language:
NAME.voxels, what was encoded; NAME.code, its code; NAME.decoded, what that decodes to. vectors.json
lists name, dtype, shape, block and bits.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import reference

FOLDER = Path(__file__).parent / "s3dc"


@dataclass(frozen=True)
class Vector:
    """One case; `content` names the function that fills it."""

    dtype: str
    shape: tuple[int, int, int]
    block: tuple[int, int, int]
    bits: int
    content: str = "noise"

    @property
    def name(self) -> str:
        """Unique, and a file name on every system."""
        shape, block = ("x".join(map(str, extents)) for extents in (self.shape, self.block))
        return f"{self.dtype}-{shape}-blocks{block}-{self.bits}bit-{self.content}"


VECTORS = (
    # Every type at every width that a GPU takes, and one that crosses bytes; cut blocks.
    *(
        Vector(dtype, (5, 6, 21), (4, 4, 8), bits, "structure")
        for dtype in ("uint8", "int8", "uint16", "int16", "float32")
        for bits in (1, 2, 3, 4, 8)
    ),
    # Widths and rows at their edges: one voxel, one row, exact words, a row of several chunks.
    *(Vector("uint8", (2, 3, 70), (2, 2, 16), bits) for bits in (5, 6, 7)),
    Vector("uint16", (1, 1, 1), (8, 8, 8), 4),
    Vector("uint16", (1, 1, 17), (1, 1, 1), 1),
    Vector("int16", (1, 9, 1), (2, 2, 2), 8),
    Vector("uint8", (3, 3, 64), (8, 8, 8), 4),
    Vector("uint16", (2, 2, 131), (1, 2, 50), 6),
    # Numbers at their edges.
    *(Vector(dtype, (2, 4, 9), (2, 2, 3), 4, "constant") for dtype in ("int8", "float32")),
    *(Vector(dtype, (1, 2, 33), (1, 1, 33), 8, "full_range") for dtype in ("uint16", "int16")),
    Vector("float32", (1, 2, 16), (1, 2, 16), 4, "huge"),
    Vector("float32", (1, 2, 16), (1, 2, 16), 3, "denormal"),
    Vector("float32", (1, 1, 8), (1, 1, 2), 2, "zeros_and_offsets"),
)


def noise(count: int) -> NDArray[np.int64]:
    """Whole numbers in [0, 2^16), always the same: a multiplicative congruential sequence."""
    values, state = np.empty(count, np.int64), 1
    for i in range(count):
        state = state * 48271 % (2**31 - 1)
        values[i] = state >> 15
    return values


def fill(vector: Vector) -> NDArray[Any]:
    """The voxels of a vector, from arithmetic that gives the same on every machine."""
    count = int(np.prod(vector.shape))
    dtype = np.dtype(vector.dtype)
    at = np.arange(count)
    match vector.content:
        case "noise" | "structure":
            values = noise(count)
            if vector.content == "structure":
                values = (at * 911 + values // 16) % 65536
            narrow = values >> 8 if dtype.itemsize == 1 else values
            offset = 0 if dtype.kind == "u" else -(2 ** (8 * min(dtype.itemsize, 2) - 1))
            array = (narrow + offset).astype(dtype)
            if dtype.kind == "f":
                array /= np.float32(64)  # exact: a power of two
        case "constant":
            array = np.full(count, -77, dtype)
        case "full_range":
            info = np.iinfo(dtype)
            array = (int(info.min) + at * 65535 // (count - 1)).astype(dtype)
        case "huge":
            largest = np.float64(np.finfo(np.float32).max)
            array = ((at / (count - 1) * 2 - 1) * largest).astype(dtype)
        case "denormal":
            array = (at * 2.0**-149).astype(dtype)
        case "zeros_and_offsets":
            array = np.array([-0.0, 0.0, -0.0, -0.0, -1e30, -1e-30, 1e8, 1e8 + 8], dtype)
        case _:
            raise AssertionError(vector.content)
    return array.reshape(vector.shape)


def files_of(vector: Vector) -> dict[str, bytes]:
    """The three files of a vector, by name."""
    voxels = fill(vector)
    code = reference.encode(voxels, vector.block, vector.bits)
    decoded = reference.decode(code, vector.shape, voxels.dtype, vector.block, vector.bits)
    little_endian = voxels.dtype.newbyteorder("<")
    return {
        f"{vector.name}.voxels": voxels.astype(little_endian).tobytes(),
        f"{vector.name}.code": code,
        f"{vector.name}.decoded": decoded.astype(little_endian).tobytes(),
    }


def all_files() -> dict[str, bytes]:
    """Everything that belongs in the folder, by name."""
    files = {name: content for vector in VECTORS for name, content in files_of(vector).items()}
    listed = [{"name": vector.name, **asdict(vector)} for vector in VECTORS]
    lines = ",\n  ".join(json.dumps(entry) for entry in listed)
    files["vectors.json"] = f'{{"version": 1, "vectors": [\n  {lines}\n]}}\n'.encode()
    return files


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name, content in all_files().items():
        (FOLDER / name).write_bytes(content)
