"""NanoVDB files, written by numbers that were taken from its documentation, not from our reader."""

from __future__ import annotations

import itertools
import struct
import zlib
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numcodecs import blosc

from .sample import SPACING_ZYX, Sample


class Kind(NamedTuple):
    """A kind of values: its number, and the sizes and offsets of its parts."""

    number: int
    dtype: str
    background: int
    root: int
    tile_value: int
    tile: int
    upper_table: int
    lower_table: int
    entry: int
    leaf_table: int
    leaf: int


KINDS = {
    "float32": Kind(1, "<f4", 28, 64, 20, 32, 8256, 1088, 8, 96, 2144),
    "float64": Kind(2, "<f8", 32, 96, 24, 32, 8256, 1088, 8, 128, 4224),
    "int16": Kind(3, "<i2", 28, 64, 20, 32, 8256, 1088, 8, 96, 1120),
    "int32": Kind(4, "<i4", 28, 64, 20, 32, 8256, 1088, 8, 96, 2144),
    "int64": Kind(5, "<i8", 32, 96, 24, 32, 8256, 1088, 8, 128, 4224),
    "uint8": Kind(26, "u1", 28, 64, 20, 32, 8256, 1088, 8, 96, 608),
    "Vec3f": Kind(6, "<f4", 28, 96, 20, 32, 8256, 1088, 16, 128, 6272),
    "float16": Kind(9, "<f2", 28, 64, 20, 32, 8256, 1088, 8, 96, 1120),
    "uint32": Kind(10, "<u4", 28, 64, 20, 32, 8256, 1088, 8, 96, 2144),
    "bool": Kind(11, "?", 28, 64, 20, 32, 8256, 1088, 8, 80, 160),
    "RGBA8": Kind(12, "u1", 28, 64, 20, 32, 8256, 1088, 8, 96, 2144),
}


def grid_bytes(
    voxels: np.ndarray,
    start_xyz: tuple[int, int, int] = (0, 0, 0),
    kind: str | None = None,
    *,
    name: str = "density",
    background: float = 0,
    tiles: dict[tuple[int, int, int], float] | None = None,
) -> bytes:
    """A grid of voxels (z, y, x) or (z, y, x, component).

    Args:
        voxels: all of them are active.
        start_xyz: index of the first.
        kind: key of ``KINDS``; the type of the voxels if not given.
        name: of the grid.
        background: value of all else.
        tiles: values of cubes of 8 voxels a side, by the index of their first voxel; each in a
            node of 128 voxels a side in which there are voxels.
    """
    k = KINDS[kind or voxels.dtype.name]
    leaves, box = _leaves(voxels, start_xyz, background)
    lowers = sorted({_floor(at, 128) for at in leaves})
    uppers = sorted({_floor(at, 4096) for at in leaves})
    upper_nbytes, lower_nbytes = k.upper_table + k.entry * 32**3, k.lower_table + k.entry * 16**3
    root_at = 672 + 64
    uppers_at = root_at + k.root + len(uppers) * k.tile
    lowers_at = uppers_at + len(uppers) * upper_nbytes
    leaves_at = lowers_at + len(lowers) * lower_nbytes
    out = bytearray(leaves_at + len(leaves) * k.leaf)
    _put_head(out, k, name, box)
    counts = (len(leaves), len(lowers), len(uppers))
    offsets = (leaves_at - 672, lowers_at - 672, uppers_at - 672, root_at - 672)
    struct.pack_into("<4Q3I", out, 672, *offsets, *counts)
    value = np.array(background, k.dtype).tobytes() * (voxels.shape[3] if voxels.ndim == 4 else 1)
    struct.pack_into("<6iI", out, root_at, *box[0], *box[1], len(uppers))
    out[root_at + k.background : root_at + k.background + len(value)] = value
    for n, corner in enumerate(uppers):
        x, y, z = ((at >> 12) & 0xFFFFF for at in corner)
        tile_at, at = root_at + k.root + n * k.tile, uppers_at + n * upper_nbytes
        struct.pack_into("<QqI", out, tile_at, x << 42 | y << 21 | z, at - root_at, 0)
        _fill_table(out, at + k.upper_table, k.entry, 32**3, value)
        for m, child in enumerate(lowers):
            if _floor(child, 4096) == corner:
                where = (at, at + 32 + 4096, at + k.upper_table, 128, 32, k.entry)
                _put_child(out, where, corner, child, lowers_at + m * lower_nbytes)
    for n, corner in enumerate(lowers):
        at = lowers_at + n * lower_nbytes
        _fill_table(out, at + k.lower_table, k.entry, 16**3, value)
        for place, tile in (tiles or {}).items():
            if _floor(place, 128) == corner:
                entry = at + k.lower_table + _number(place, corner, 8, 16) * k.entry
                out[entry : entry + len(value)] = np.array(tile, k.dtype).tobytes()
        for m, leaf in enumerate(leaves):
            if _floor(leaf, 128) == corner:
                where = (at, at + 32 + 512, at + k.lower_table, 8, 16, k.entry)
                _put_child(out, where, corner, leaf, leaves_at + m * k.leaf)
    for n, leaf in enumerate(leaves.values()):
        at = leaves_at + n * k.leaf + k.leaf_table
        stored = leaf.reshape(-1).astype(k.dtype)
        data = np.packbits(stored, bitorder="little") if k.dtype == "?" else stored
        out[at : at + data.nbytes] = data.tobytes()
    return bytes(out)


def file_bytes(*grids: bytes, codec: str = "none", magic: bytes = b"NanoVDB0") -> bytes:
    """One segment of grids."""
    number = ("none", "zip", "blosc").index(codec)
    metas, datas = b"", b""
    for grid in grids:
        data = grid
        if codec != "none":
            packed = zlib.compress(grid) if codec == "zip" else blosc.compress(grid, b"lz4", 5)
            data = struct.pack("<Q", len(packed)) + packed
        name = grid[40:296].split(b"\0")[0] + b"\0"
        kind = int.from_bytes(grid[636:640], "little")
        metas += struct.pack(
            "<QQ16xI100xI28xHHI", len(grid), len(data), kind, len(name), number, 0, VERSION
        )
        metas += name
        datas += data
    return struct.pack("<8sIHH", magic, VERSION, len(grids), number) + metas + datas


VERSION = 32 << 21 | 6 << 10


def _leaves(voxels: np.ndarray, start_xyz: tuple[int, int, int], background: float):
    """Leaves [x, y, z, ...] by the index where they begin, and the box of all voxels."""
    xyz = voxels.swapaxes(0, 2)
    stop = [a + n for a, n in zip(start_xyz, xyz.shape, strict=False)]
    ranges = [range(a // 8 * 8, b, 8) for a, b in zip(start_xyz, stop, strict=True)]
    low = [r[0] for r in ranges]
    padded = np.full([8 * len(r) for r in ranges] + list(xyz.shape[3:]), background, voxels.dtype)
    padded[tuple(slice(a - o, b - o) for a, b, o in zip(start_xyz, stop, low, strict=True))] = xyz
    leaves = {
        corner: padded[tuple(slice(a - o, a - o + 8) for a, o in zip(corner, low, strict=True))]
        for corner in itertools.product(*ranges)
    }
    return leaves, (start_xyz, tuple(b - 1 for b in stop))


def _put_head(out: bytearray, k: Kind, name: str, box: object) -> None:
    struct.pack_into("<8sQIIIIQ", out, 0, b"NanoVDB0", 0, VERSION, 0, 0, 1, len(out))
    out[40 : 40 + len(name)] = name.encode()
    dx, dy, dz = SPACING_ZYX[::-1]
    struct.pack_into("<9d", out, 296 + 88, dx, 0, 0, 0, dy, 0, 0, 0, dz)
    struct.pack_into("<II", out, 632, 2, k.number)


def _fill_table(out: bytearray, at: int, entry: int, count: int, value: bytes) -> None:
    out[at : at + entry * count] = value.ljust(entry, b"\0") * count


def _put_child(out: bytearray, where, corner, child, child_at: int) -> None:
    at, mask, table, side, count, entry = where
    n = _number(child, corner, side, count)
    out[mask + n // 8] |= 1 << n % 8
    struct.pack_into("<q", out, table + n * entry, child_at - at)


def _number(child, corner, side: int, count: int) -> int:
    x, y, z = ((a - b) // side for a, b in zip(child, corner, strict=True))
    return (x * count + y) * count + z


def _floor(at, side: int):
    return tuple(a // side * side for a in at)


def nanovdb_plain(folder: Path, voxels: np.ndarray) -> Sample:
    path = folder / "a.nvdb"
    path.write_bytes(file_bytes(grid_bytes(voxels, (3, 9, 5))))
    return Sample(path, voxels)


def nanovdb_zip_across_tiles_of_the_root(folder: Path, voxels: np.ndarray) -> Sample:
    path = folder / "a.nvdb"
    path.write_bytes(
        file_bytes(grid_bytes(voxels, (-20, -5, 4093)), codec="zip", magic=b"NanoVDB2")
    )
    return Sample(path, voxels)


def nanovdb_blosc(folder: Path, voxels: np.ndarray) -> Sample:
    path = folder / "a.nvdb"
    path.write_bytes(file_bytes(grid_bytes(voxels, (-100, 40, 0)), codec="blosc"))
    return Sample(path, voxels)


def nanovdb_without_segments(folder: Path, voxels: np.ndarray) -> Sample:
    path = folder / "a.nvdb"
    path.write_bytes(b"NanoVDB1" + grid_bytes(voxels)[8:])
    return Sample(path, voxels)


NANOVDB_WRITERS = (
    nanovdb_plain,
    nanovdb_zip_across_tiles_of_the_root,
    nanovdb_blosc,
    nanovdb_without_segments,
)
for _writer in NANOVDB_WRITERS:
    _writer.dtypes = tuple(name for name in KINDS if name not in ("Vec3f", "RGBA8"))
