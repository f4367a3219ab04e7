"""Writes the golden vectors of zerobit version 1: tests/golden/zerobit.

    python tests/golden/make_zerobit.py

Made once, by the numpy reference alone, so that they do not depend on what they are to check. They
pin the format and the decoder; an encoder may choose otherwise. If a change makes a code decode to
other voxels, that change breaks every volume on disk, and needs a new version of
docs/spec/zerobit.md instead. Tests read them and never write.

Each vector is three files, little-endian and C-ordered (z, y, x, channel), for readers in any
language: NAME.voxels, what was encoded; NAME.code, its code; NAME.decoded, what that decodes to.
Where NAME.codebook is, it is shared. vectors.json lists name, dtype, shape and settings.
"""

from __future__ import annotations

import json
import struct
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import reference_zerobit as reference
from octobrick.codec import reference_zerobit_encoder as encoder

FOLDER = Path(__file__).parent / "zerobit"


@dataclass(frozen=True)
class Vector:
    """One case; `content` names the function that fills it."""

    dtype: str
    shape: tuple[int, ...]
    ratio: float
    content: str = "waves"
    per_block: bool = False
    shared: bool = False

    @property
    def name(self) -> str:
        """Unique, and a file name on every system."""
        extents = "x".join(map(str, self.shape))
        kept = f"{round(self.ratio * 1000)}permille"
        rules = ("-block" if self.per_block else "") + ("-shared" if self.shared else "")
        return f"{self.dtype}-{extents}-{kept}-{self.content}{rules}"


TYPES = ("uint8", "int8", "uint16", "int16", "float32")
VECTORS = (
    # Every type, over a border of unit blocks and with cut cells.
    *(Vector(dtype, (6, 9, 19), 0.1) for dtype in TYPES),
    *(Vector(dtype, (6, 9, 19, 3), 0.1) for dtype in ("uint8", "uint16")),
    Vector("uint8", (5, 18, 7), 0.05, per_block=True),
    *(Vector(dtype, (6, 9, 19), 0.1, shared=True) for dtype in ("uint16", "float32")),
    # Everything kept, and nothing.
    *(Vector(dtype, (4, 8, 8), 1, "noise") for dtype in ("uint8", "int16", "float32")),
    *(Vector(dtype, (8, 4, 8), 0, "noise") for dtype in ("uint8", "float32")),
    Vector("uint8", (4, 4, 8, 3), 1, "noise"),
    # Edges.
    Vector("uint8", (1, 1, 1), 0.05, "noise"),
    Vector("uint8", (17, 3, 33), 0.05, "constant"),
    Vector("float32", (4, 4, 8), 1, "huge"),
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
    if vector.content == "huge":
        largest = np.float64(np.finfo(np.float32).max)
        signs = np.where(noise(count) % 2 == 0, 1.0, -1.0)
        return (signs * largest).astype(dtype).reshape(vector.shape)
    if vector.content == "constant":
        return np.full(vector.shape, 77, dtype)
    values = noise(count).reshape(vector.shape)
    if vector.content == "waves":
        # Parabolas along each axis, a little noise, and a corner of background.
        z, y, x, c = np.ogrid[tuple(slice(0, n) for n in (*vector.shape, 1)[:4])]
        waves = (3000 * (z % 7) + 150 * (y - 5) ** 2 + 120 * (x - 9) ** 2 + 5000 * c) % 65536
        wide = values.reshape(*vector.shape[:3], -1)
        values = np.where((z < 4) & (x < 8), 4096, np.minimum(waves + wide // 64, 65535))
        values = np.broadcast_to(values, wide.shape).reshape(vector.shape)
    narrow = values >> 8 if dtype.itemsize == 1 else values
    offset = 0 if dtype.kind == "u" else -(2 ** (8 * min(dtype.itemsize, 2) - 1))
    array = (narrow + offset).astype(dtype)
    return array / np.float32(64) if dtype.kind == "f" else array  # exact: a power of two


def share_codebook(code: bytes, channels: int, dtype: np.dtype[Any]) -> tuple[bytes, bytes]:
    """A code whose codebook is taken out of it, and that codebook."""
    averages, details = struct.unpack_from("<HH", code, 20)
    end = 64 + (averages + details) * channels * dtype.itemsize
    kind = reference.DTYPES.index(dtype)
    codebook = struct.pack("<4sBBBBHHI", b"OBZC", 1, kind, channels, 0, averages, details, 0)
    codebook += code[64:end]
    digest = 0xCBF29CE484222325
    for byte in codebook:
        digest = (digest ^ byte) * 0x100000001B3 % 2**64
    header = code[:7] + b"\1" + code[8:24] + struct.pack("<Q", digest) + code[32:64]
    return header + code[end:], codebook


def files_of(vector: Vector) -> dict[str, bytes]:
    """The files of a vector, by name."""
    voxels = fill(vector)
    image = voxels.reshape(*vector.shape[:3], -1)
    code = encoder.encode(image, encoder.Settings(vector.ratio, vector.per_block))
    codebook = b""
    if vector.shared:
        code, codebook = share_codebook(code, image.shape[3], voxels.dtype)
    decoded = reference.decode(code, codebook=codebook)
    little_endian = voxels.dtype.newbyteorder("<")
    files = {
        f"{vector.name}.voxels": voxels.astype(little_endian).tobytes(),
        f"{vector.name}.code": code,
        f"{vector.name}.decoded": decoded.astype(little_endian).tobytes(),
    }
    if vector.shared:
        files[f"{vector.name}.codebook"] = codebook
    return files


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
