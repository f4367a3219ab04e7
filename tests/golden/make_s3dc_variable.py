"""Writes the golden vectors of S3Dc with widths per block, and with scales.

    python tests/golden/make_s3dc_variable.py

They lie in tests/golden/s3dc_variable. Made once, by the numpy reference alone, as those of
make_s3dc.py, and as binding: if a change makes this script write other bytes, that change breaks
codes that people keep, and needs a new version of docs/spec/s3dc-variable.md instead. Tests read
them and never write.

Each vector is NAME.voxels, what was encoded; NAME.code; NAME.decoded; and where there is a
prediction NAME.prediction; little-endian, C-ordered (z, y, x). vectors.json lists form, dtype,
shape, block and what chose widths: `max_error`, or the `bits` of all blocks.
"""

from __future__ import annotations

import json
import runpy
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import reference, reference_variable

FOLDER = Path(__file__).parent / "s3dc_variable"
noise = runpy.run_path(str(Path(__file__).with_name("make_s3dc.py")))["noise"]


@dataclass(frozen=True)
class Vector:
    """One case; `content` names the function that fills it."""

    form: str  # "variable" or "scaled"
    dtype: str
    shape: tuple[int, int, int]
    block: tuple[int, int, int]
    content: str
    max_error: float | None = None
    bits: int | None = None
    predicted: bool = False

    @property
    def name(self) -> str:
        """Unique, and a file name on every system."""
        shape, block = ("x".join(map(str, extents)) for extents in (self.shape, self.block))
        rule = f"{self.bits}bit" if self.max_error is None else f"error{self.max_error:g}"
        ending = "-predicted" if self.predicted else ""
        return f"{self.form}-{self.dtype}-{shape}-blocks{block}-{rule}-{self.content}{ending}"


TYPES = ("uint8", "int8", "uint16", "int16", "float32")
VECTORS = (
    # Every type from constant blocks to exact or raw ones, cut blocks, more than one group.
    *(Vector("variable", t, (5, 9, 13), (4, 4, 4), "growing", max_error=0) for t in TYPES),
    *(Vector("variable", t, (5, 9, 13), (4, 4, 4), "growing", max_error=2) for t in TYPES),
    *(Vector("variable", t, (5, 9, 13), (4, 4, 4), "growing", max_error=0.5, predicted=True)
      for t in TYPES),
    # One width for all, with differences that do not fit and blocks coded by themselves.
    *(Vector("variable", t, (4, 4, 20), (4, 4, 4), "growing", bits=3, predicted=True)
      for t in TYPES),
    # Numbers at their edges, and blocks that are no multiple of 32.
    Vector("variable", "uint16", (2, 3, 11), (2, 3, 5), "full_range", max_error=20),
    Vector("variable", "float32", (1, 2, 16), (1, 2, 8), "huge", max_error=1e34),
    Vector("variable", "float32", (1, 2, 16), (1, 2, 8), "huge", bits=8, predicted=True),
    Vector("variable", "float32", (1, 2, 16), (1, 2, 16), "denormal", max_error=0),
    # Scales.
    *(Vector("scaled", t, (3, 5, 21), (2, 4, 8), "growing", bits=4) for t in TYPES),
    Vector("scaled", "uint16", (2, 2, 70), (2, 2, 16), "full_range", bits=8),
    Vector("scaled", "uint8", (2, 2, 17), (2, 2, 2), "growing", bits=1),
)  # fmt: skip


def fill(vector: Vector) -> NDArray[Any]:
    """The voxels of a vector, from arithmetic that gives the same on every machine."""
    count, dtype = int(np.prod(vector.shape)), np.dtype(vector.dtype)
    at = np.arange(count)
    match vector.content:
        case "growing":  # from constant to wild, along the volume
            wide = 8 if dtype.itemsize == 1 else 16
            values = (noise(count) >> (16 - at * wide // (count - 1))) + at % 2
            array = (values % 2**wide).astype(f"uint{wide}")
            if dtype.kind == "f":
                return (array / np.float32(8)).astype(dtype).reshape(vector.shape)
            return array.view(dtype).reshape(vector.shape)
        case "full_range":
            return (at * 65535 // (count - 1)).astype(dtype).reshape(vector.shape)
        case "huge":
            largest = np.float64(np.finfo(np.float32).max)
            return ((at / (count - 1) * 2 - 1) * largest).astype(dtype).reshape(vector.shape)
        case "denormal":
            return (at * 2.0**-149).astype(dtype).reshape(vector.shape)
    raise AssertionError(vector.content)


def scales_of(bits: int) -> NDArray[np.uint16]:
    """Eight scales that an encoder might have found: powers of the linear one."""
    t = np.arange(2**bits) / (2**bits - 1)
    powers = [np.floor(t ** (1 + k / 4) * 65535 + 0.5) for k in range(8)]
    return np.stack(powers).astype("<u2")


def encode_scaled(voxels: NDArray[Any], vector: Vector) -> bytes:
    """A fixed-rate code whose indices are those nearest on scale `number of the block` modulo 8."""
    assert vector.bits is not None
    scales, indices, choices = scales_of(vector.bits), np.empty(voxels.shape, np.uint8), []
    ends = reference.end_points(voxels, vector.block)
    for number, (cell, block) in enumerate(reference.blocks(voxels.shape, vector.block)):
        choices.append(number % 8)
        low, high = ends[cell]
        levels = reference_variable.at_positions(scales[number % 8].astype(np.int64), low, high)
        off = np.abs(voxels[block][..., None].astype(np.float64) - levels.astype(np.float64))
        indices[block] = off.argmin(-1)
    choices += [0] * (len(choices) % 2)
    pairs = bytes(a | b << 4 for a, b in zip(choices[::2], choices[1::2], strict=True))
    little_endian = ends.astype(ends.dtype.newbyteorder("<")).tobytes()
    return little_endian + reference.pack_rows(indices, vector.bits) + scales.tobytes() + pairs


def files_of(vector: Vector) -> dict[str, bytes]:
    """The files of a vector, by name."""
    voxels = fill(vector)
    shape, dtype, block = vector.shape, voxels.dtype, vector.block
    files = {"voxels": voxels}
    prediction = None
    if vector.predicted:
        prediction = files["prediction"] = np.roll(voxels, 1, axis=2)
    if vector.form == "scaled":
        assert vector.bits is not None
        code = encode_scaled(voxels, vector)
        decoded = reference_variable.decode_scaled(code, shape, dtype, block, vector.bits)
    else:
        if vector.max_error is not None:
            code = reference_variable.encode_bound(voxels, block, vector.max_error, prediction)
        else:
            assert vector.bits is not None
            code = reference_variable.encode_same(voxels, block, vector.bits, prediction)
        decoded = reference_variable.decode(code, shape, dtype, block, prediction)
    files["decoded"] = decoded
    contents = {
        f"{vector.name}.{suffix}": array.astype(dtype.newbyteorder("<")).tobytes()
        for suffix, array in files.items()
    }
    return {**contents, f"{vector.name}.code": code}


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
