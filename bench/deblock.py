"""What deblocking does to decoded volumes: PSNR and seam energy before and after.

    script/bench deblock [--data ../shared/data] [--crop 128] [--quick] [--json FILE]

S3Dc at 1, 2, 3 and 4 bits with blocks of 4³, 8³ and 16³, and zerobit at 1, 2 and 5 %, whose blocks
are its cells of 4³ voxels, of every scalar volume of a folder, in a crop around its centre (0: the
whole volume); of a folder in it, which holds time steps, the first. "unlimited" is the paper's
filter, "clamp", "ramp" and "auto" limit it by what the code can have lost; of zerobit that is twice
the threshold of the unit block. All of these at the default strength, the first and the last at the
others too. Seam energy is the mean jump across block borders over the mean jump elsewhere; 1 is
seamless. Rows where the default lowers PSNR are listed at the end.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import _measure
import numpy as np
from numpy.typing import NDArray
from volumes import volumes

from octobrick.codec import S3dc, Zerobit, deblock, metrics

BITS = (1, 2, 3, 4)
BLOCKS = (4, 8, 16)
RATIOS = (0.01, 0.02, 0.05)
STRENGTHS = (0.0, 1.0, 4.0, 16.0, 64.0)
DEFAULT_STRENGTH = 4.0
WAYS: dict[str, dict[str, Any]] = {
    "unlimited": {},
    "sequential": {"axes": "sequential"},
    "clamp": {"limit": "clamp"},
    "ramp": {"limit": "ramp"},
    "auto": {},
}
UNLIMITED = ("unlimited", "sequential")
SWEPT = ("unlimited", "auto")  # at all strengths
DEFAULTS = {"S3Dc": "auto", "zerobit": "ramp"}  # what deblock.deblocked takes
CELL = 4  # of zerobit, voxels
WHOLE = 10**9  # a crop that no volume reaches


@dataclass(frozen=True)
class Decoded:
    """What a code gives back, and what it can have lost.

    Args:
        code: "S3Dc 2 bits", or "zerobit 5 %".
        block: voxels per axis.
        voxels: decoded.
        bounds: the greatest error, one per block.
    """

    code: str
    block: int
    voxels: NDArray[Any]
    bounds: NDArray[np.float32]


def decoded(voxels: NDArray[Any], quick: bool) -> Iterator[Decoded]:
    """The volume through every code."""
    for bits in BITS:
        for block in (8,) if quick else BLOCKS:
            codec = S3dc((block,) * 3, bits)
            code = codec.encode(voxels)
            bounds = deblock.s3dc_bounds(codec, code, voxels.shape, voxels.dtype)
            back = codec.decode(code, voxels.shape, voxels.dtype)
            yield Decoded(f"S3Dc {bits} bits", block, back, bounds)
    for ratio in RATIOS:
        zerobit = Zerobit(ratio)
        code = zerobit.encode(voxels)
        bounds = deblock.zerobit_bounds(zerobit, code)
        back = zerobit.decode(code, voxels.shape, voxels.dtype)
        yield Decoded(f"zerobit {ratio:.0%}", CELL, back, bounds)


def seam_energy(volume: NDArray[Any], block: int) -> float:
    """The mean |jump| across block borders over the mean |jump| inside blocks."""
    across = inside = 0.0
    across_count = inside_count = 0
    for axis in range(3):
        jumps = np.abs(np.diff(volume.astype(np.float32), axis=axis))
        at_border = jumps.take(range(block - 1, jumps.shape[axis], block), axis)
        at_borders = float(at_border.sum(dtype=np.float64))
        across, across_count = across + at_borders, across_count + at_border.size
        inside += float(jumps.sum(dtype=np.float64)) - at_borders
        inside_count += jumps.size - at_border.size
    return (across / across_count) / (inside / inside_count)


def measure(original: NDArray[Any], coded: Decoded, strengths: tuple[float, ...]) -> dict[str, Any]:
    """PSNR and seams before the filter, and after it in every way at every strength."""
    wide = original.astype(np.float32)
    peak = float(np.ptp(wide))
    before = metrics.psnr(wide, coded.voxels.astype(np.float32), peak)
    found: list[dict[str, Any]] = []
    for strength in strengths:
        for way in WAYS if strength == DEFAULT_STRENGTH else SWEPT:
            bound = None if way in UNLIMITED else coded.bounds
            after = deblock.rational_bezier(
                coded.voxels, (coded.block,) * 3, strength, bound, **WAYS[way]
            )
            gain = metrics.psnr(wide, after, peak) - before
            seam = seam_energy(after, coded.block)
            found.append({"way": way, "strength": strength, "gain_db": gain, "seam": seam})
    return {
        "code": coded.code,
        "block": coded.block,
        "psnr_db": before,
        "seam": seam_energy(coded.voxels, coded.block),
        "original_seam": seam_energy(original, coded.block),
        "filtered": found,
    }


def run(data: Path, quick: bool, crop: int = 128) -> dict[str, Any]:
    """A row for each volume, code and block."""
    strengths = (DEFAULT_STRENGTH,) if quick else STRENGTHS
    rows = [
        {"volume": name, **measure(voxels, coded, strengths)}
        for name, voxels in volumes(data, min(crop, 64) if quick else crop or WHOLE)
        for coded in decoded(voxels, quick)
    ]
    return {"crop": crop, "rows": rows, "summary": summary(rows)}


def filtered(row: dict[str, Any], way: str, strength: float) -> dict[str, Any]:
    """What the filter did to a row, in one way."""
    return next(f for f in row["filtered"] if (f["way"], f["strength"]) == (way, strength))


def summary(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Mean and worst gain, and mean seams, of each code, way and strength."""
    found = []
    for code in dict.fromkeys(row["code"] for row in rows):
        of_code = [row for row in rows if row["code"] == code]
        for first in of_code[0]["filtered"]:
            way, strength = first["way"], first["strength"]
            gains = [filtered(row, way, strength)["gain_db"] for row in of_code]
            seams = [filtered(row, way, strength)["seam"] for row in of_code]
            found.append(
                {
                    "code": code,
                    "way": way,
                    "strength": strength,
                    "mean_gain_db": float(np.mean(gains)),
                    "worst_gain_db": min(gains),
                    "mean_seam_before": float(np.mean([row["seam"] for row in of_code])),
                    "mean_seam_after": float(np.mean(seams)),
                }
            )
    return found


def table(result: dict[str, Any]) -> str:
    """Rows at the default strength; means over volumes at all; what the default makes worse."""
    rows = result["rows"]
    head = ["gain dB, seam after", "code", "block", "dB", "seam", "original", *WAYS]
    lines = [[*before(row), *(after(row, way) for way in WAYS)] for row in rows]
    means = [
        [
            of["code"],
            of["way"],
            f"{of['strength']:g}",
            f"{of['mean_gain_db']:+.2f}",
            f"{of['worst_gain_db']:+.2f}",
            f"{of['mean_seam_before']:.2f}",
            f"{of['mean_seam_after']:.2f}",
        ]
        for of in result["summary"]
    ]
    mean_head = ["mean of all", "way", "strength", "gain dB", "worst", "seam", "seam after"]
    worse = sorted(
        (row for row in rows if default_gain(row) < 0), key=lambda row: float(default_gain(row))
    )
    shown = tuple(DEFAULTS.values())
    worse_head = ["the default lowers PSNR", "code", "block", "dB", "seam", "original", *shown]
    return "\n\n".join(
        [
            _measure.layout(head, lines),
            _measure.layout(mean_head, means),
            f"The default lowers PSNR in {len(worse)} of {len(rows)} rows.",
            _measure.layout(
                worse_head, [[*before(row), *(after(row, way) for way in shown)] for row in worse]
            ),
        ]
    )


def default_gain(row: dict[str, Any]) -> float:
    way = DEFAULTS[row["code"].partition(" ")[0]]
    gain: float = filtered(row, way, DEFAULT_STRENGTH)["gain_db"]
    return gain


def before(row: dict[str, Any]) -> list[str]:
    figures = [f"{row[k]:.2f}" for k in ("psnr_db", "seam", "original_seam")]
    return [row["volume"][:28], row["code"], str(row["block"]), *figures]


def after(row: dict[str, Any], way: str) -> str:
    found = filtered(row, way, DEFAULT_STRENGTH)
    return f"{found['gain_db']:+.2f} {found['seam']:4.2f}"


def main() -> None:
    parser = _measure.parser(__doc__)
    parser.add_argument("--crop", type=int, default=128, help="voxels per axis; 0: whole volumes")
    options = parser.parse_args()
    _measure.report(options, run(options.data, options.quick, options.crop), table)


if __name__ == "__main__":
    main()
