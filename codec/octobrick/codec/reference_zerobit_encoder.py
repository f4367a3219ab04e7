"""How Zerobit's encoder chooses, in plain numpy: the other half of `reference_zerobit`."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from octobrick.codec.reference_zerobit import (
    DIVISORS,
    DTYPES,
    HEADER,
    Array,
    Doubles,
    Zyx,
    cell_sums,
    detail_dtype,
)

# ---- What is kept ------------------------------------------------------------------------------


@dataclass
class Settings:
    """As the arguments of `Zerobit`."""

    ratio: float = 0.05
    per_block: bool = False
    orthonormal: bool = True
    count_averages: bool = False
    background: Array | None = None


@dataclass
class KeptCell:
    """A cell that is not null: its number in the unit block, average and details that live."""

    number: int
    average: Array
    details: dict[tuple[int, int], Array]  # by node and j


def rounded(sums: Doubles, dtype: np.dtype[Any]) -> Doubles:
    """Coefficients as their codewords would have them."""
    values = sums / DIVISORS
    if dtype.kind == "f":
        return values.astype(np.float32).astype(np.float64) + 0.0
    values = np.floor(values + 0.5)
    limit = 2.0 ** (8 * dtype.itemsize - 1)
    values[1:] = np.clip(values[1:], -limit, limit - 1)
    return values


def ranks(sums: Doubles, dtype: np.dtype[Any], background: Array, settings: Settings) -> Doubles:
    """How much each of 64 coefficients matters; 0 for one that is null."""
    zero = np.zeros_like(sums)
    zero[0] = background
    squares = ((sums - DIVISORS * zero) ** 2).sum(axis=1)
    squares[8:] *= 8 if settings.orthonormal else 64
    return np.where((rounded(sums, dtype) == zero).all(axis=1), 0.0, squares)


def wanted_cells(shape: Zyx, wanted: Array | None) -> Iterator[tuple[int, int, Zyx]]:
    """Unit block, number in it and position of every cell that is wanted."""
    cells = [-(-n // 4) for n in shape]
    grid = [-(-n // 16) for n in shape]
    for block, (bz, by, bx) in enumerate(np.ndindex(*grid)):
        for number, (z, y, x) in enumerate(np.ndindex(4, 4, 4)):
            cell = (4 * bz + z, 4 * by + y, 4 * bx + x)
            inside = all(c < n for c, n in zip(cell, cells, strict=True))
            if inside and (wanted is None or wanted[cell]):
                yield block, number, cell


def common_colour(cells: list[Doubles], channels: int) -> Doubles:
    """The commonest colour of constant cells, of several the lowest; 0 where there are none."""
    counts: dict[tuple[float, ...], int] = {}
    for cell in cells:
        colour = cell[0, 0, 0]
        if (cell == colour).all():
            key = tuple(float(v) + 0.0 for v in colour)
            counts[key] = counts.get(key, 0) + 1
    if not counts:
        return np.zeros(channels)
    return np.array(min(counts, key=lambda colour: (-counts[colour], colour)))


@dataclass
class Kept:
    """What of a volume is kept."""

    background: Doubles
    least: float
    greatest: float
    blocks: list[list[KeptCell]]
    dropped: list[float] = field(default_factory=list)  # per unit block


def keep(image: Array, settings: Settings, wanted: Array | None = None) -> Kept:
    """Transform, rank and threshold an image (z, y, x, C)."""
    nz, ny, nx, channels = image.shape
    dtype = image.dtype
    padding = [(0, -n % 4) for n in (nz, ny, nx)]
    wide = np.pad(image, [*padding, (0, 0)], mode="edge").astype(np.float64)
    places = list(wanted_cells((nz, ny, nx), wanted))
    voxels = [
        wide[4 * z : 4 * z + 4, 4 * y : 4 * y + 4, 4 * x : 4 * x + 4] for _, _, (z, y, x) in places
    ]
    background = settings.background
    if background is None:
        background = common_colour(voxels, channels)
    sums = [cell_sums(v) for v in voxels]
    rank = [ranks(s, dtype, background, settings) for s in sums]

    block_count = int(np.prod([-(-n // 16) for n in (nz, ny, nx)]))
    first = 0 if settings.count_averages else 1
    alive: list[list[float]] = [[] for _ in range(block_count)]
    for (block, _, _), r in zip(places, rank, strict=True):
        alive[block] += [float(v) for v in r[first:] if v > 0]
    thresholds = find_thresholds(alive, 64 * len(places) * settings.ratio, settings.per_block)

    low = min((float(v.min()) for v in voxels), default=float(background[0]))
    high = max((float(v.max()) for v in voxels), default=float(background[0]))
    kept = Kept(background, low, high, [[] for _ in range(block_count)], [0.0] * block_count)
    weight = 8.0 if settings.orthonormal else 64.0
    for (block, number, _), s, r in zip(places, sums, rank, strict=True):
        lives = (r > 0) & (r >= thresholds[block])
        values = rounded(s, dtype)
        details = {((k - 1) // 7, (k - 1) % 7 + 1): values[k] for k in range(1, 64) if lives[k]}
        greatest = max((float(r[k]) for k in range(1, 64) if not lives[k]), default=0.0)
        kept.dropped[block] = max(kept.dropped[block], float(np.sqrt(greatest / weight)) / 8)
        average_lives = not settings.count_averages or r[0] >= thresholds[block]
        average = values[0] if average_lives else background
        if details or (average != background).any():
            kept.blocks[block].append(KeptCell(number, average, details))
    return kept


def find_thresholds(alive: list[list[float]], budget: float, per_block: bool) -> list[float]:
    """For each unit block the rank of its n-th greatest coefficient; inf where n is 0."""
    total = sum(len(ranks) for ranks in alive)
    if per_block:
        return [nth_greatest(r, share(budget, len(r), total)) for r in alive]
    everything = [rank for ranks in alive for rank in ranks]
    return [nth_greatest(everything, share(budget, total, total))] * len(alive)


def share(budget: float, of: int, total: int) -> int:
    """A unit block's part of the coefficients that may live."""
    return min(of, int(np.floor(budget * of / total + 0.5))) if total else 0


def nth_greatest(ranks: list[float], count: int) -> float:
    """The count-th greatest; infinite for none."""
    return sorted(ranks, reverse=True)[count - 1] if count else float("inf")


# ---- Codebooks ---------------------------------------------------------------------------------


def median_cut(colours: list[Array], dtype: np.dtype[Any]) -> list[Array]:
    """At most 256 codewords, the means of boxes."""
    points: dict[tuple[float, ...], int] = {}
    for colour in colours:
        key = tuple(float(v) for v in colour)
        points[key] = points.get(key, 0) + 1
    boxes = [sorted(points)] if points else []
    while len(boxes) < 256:
        sizes = [sum(points[c] for c in box) if len(box) > 1 else 0 for box in boxes]
        if not any(sizes):
            break
        most = sizes.index(max(sizes))
        boxes[most], other = halves(boxes[most], points)
        boxes.append(other)
    return [mean(box, points, dtype) for box in boxes]


def halves(
    box: list[tuple[float, ...]], points: dict[tuple[float, ...], int]
) -> tuple[list[tuple[float, ...]], list[tuple[float, ...]]]:
    """A box cut at the median across its longest side."""
    extents = np.ptp(np.array(box), axis=0)
    axis = int(extents.argmax())
    box = sorted(box, key=lambda colour: colour[axis])
    total, before = sum(points[c] for c in box), 0
    for k, colour in enumerate(box[:-1]):
        before += points[colour]
        if 2 * before >= total:
            return box[: k + 1], box[k + 1 :]
    return box[:-1], box[-1:]


def mean(
    box: list[tuple[float, ...]], points: dict[tuple[float, ...], int], dtype: np.dtype[Any]
) -> Array:
    """The mean of a box, duplicates counted."""
    total = np.zeros(len(box[0]))
    for colour in box:
        total = total + points[colour] * np.array(colour)
    total /= sum(points[c] for c in box)
    return (
        total.astype(np.float32).astype(np.float64) if dtype.kind == "f" else np.floor(total + 0.5)
    )


def nearest(colour: Array, codewords: list[Array]) -> int:
    """The index of the nearest codeword, of several the first."""
    return int(((np.array(codewords) - colour) ** 2).sum(axis=1).argmin())


# ---- The zerobit structure ---------------------------------------------------------------------


def encode_block(cells: list[KeptCell], averages: list[Array], details: list[Array]) -> bytes:
    """NNNC, CBFT, CIA, ZSMS, DIS of one unit block."""
    if not cells:
        return b"\0"
    flags, entries, zsms, dis = 0, [], bytearray(), bytearray()
    for cell in cells:
        flags |= 1 << cell.number
        maps = [sum(1 << j - 1 for i, j in cell.details if i == node) for node in range(9)]
        entries.append((nearest(cell.average, averages), len(dis), len(zsms), maps[0] != 0))
        zsms.append(sum(1 << i - 1 for i in range(1, 9) if maps[i]))
        zsms += bytes(m | (0x80 if i == 0 else 0) for i, m in enumerate(maps) if m)
        dis += bytes(nearest(cell.details[key], details) for key in sorted(cell.details))
    cia = b"".join(
        struct.pack("<BHH", average, len(zsms) + detail, zerobit | level0 << 15)
        for average, detail, zerobit, level0 in entries
    )
    return bytes([len(cells)]) + struct.pack("<Q", flags) + cia + bytes(zsms) + bytes(dis)


def encode(image: Array, settings: Settings, wanted: Array | None = None) -> bytes:
    """The code of an image (z, y, x, C), with its own codebook."""
    nz, ny, nx, channels = image.shape
    dtype = image.dtype
    kept = keep(image, settings, wanted)
    every = [cell for cells in kept.blocks for cell in cells]
    averages = median_cut([c.average for c in every], dtype)
    details = median_cut([d for c in every for d in c.details.values()], dtype)
    blocks = [encode_block(cells, averages, details) for cells in kept.blocks]
    step = np.float32(max(kept.dropped) / 255)
    while np.float64(step) * 255 < max(kept.dropped):
        step = np.nextafter(step, np.float32(np.inf))
    thresholds = bytes(
        int(min(255, np.ceil(d / np.float64(step)))) if step > 0 else 0 for d in kept.dropped
    )
    pointers = np.cumsum([0, *map(len, blocks[:-1])]).astype("<u4").tobytes()

    def sample(value: float) -> bytes:
        return np.array(value, dtype.newbyteorder("<")).tobytes().ljust(4, b"\0")

    header = struct.pack(
        HEADER, b"OBZB", 1, DTYPES.index(dtype), channels, 0, nz, ny, nx,
        len(averages), len(details), 0, b"".join(map(sample, kept.background)),
        sample(kept.least), sample(kept.greatest), step, sum(map(len, blocks)), 0,
    )  # fmt: skip
    words = (
        np.array(averages, np.float64).astype(dtype.newbyteorder("<")).tobytes()
        + np.array(details, np.float64).astype(detail_dtype(dtype)).tobytes()
    )
    return header + words + thresholds + pointers + b"".join(blocks) + bytes(8)
