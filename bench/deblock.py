"""What deblocking does to decoded S3Dc volumes: PSNR and seam energy before and after.

    python bench/deblock.py FOLDER [--crop 128] [--bits 1,2,3,4] [--blocks 4,8,16] [--json FILE]

Takes every scalar volume of a folder, in a crop around its centre; of a folder in it, which holds
time steps, the first. Per
volume, bits and block: PSNR without the filter, and what is gained by the filter unlimited, by the
clamp and by the ramp. Seam energy is the mean jump across block borders over the mean jump
elsewhere; 1 is seamless.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import S3dc, deblock, metrics

from volumes import volumes  # isort: skip

WAYS: dict[str, dict[str, Any]] = {
    "unlimited": {},
    "sequential": {"axes": "sequential"},
    "clamp": {"limit": "clamp"},
    "ramp": {"limit": "ramp"},
    "auto": {},
}
UNLIMITED = ("unlimited", "sequential")
DEFAULT = "auto"


def seam_energy(volume: NDArray[Any], block: int) -> float:
    """The mean |jump| across block borders over the mean |jump| inside blocks."""
    across, inside = [], []
    for axis in range(3):
        jumps = np.abs(np.diff(volume.astype(np.float64), axis=axis))
        at_border = np.arange(1, volume.shape[axis]) % block == 0
        across.append(jumps.compress(at_border, axis).ravel())
        inside.append(jumps.compress(~at_border, axis).ravel())
    return float(np.concatenate(across).mean() / np.concatenate(inside).mean())


def measure(voxels: NDArray[Any], bits: int, block: int, strength: float) -> dict[str, Any]:
    """PSNR and seams before the filter, and after it in every way."""
    codec = S3dc((block,) * 3, bits)
    code = codec.encode(voxels)
    decoded = codec.decode(code, voxels.shape, voxels.dtype)
    bounds = deblock.s3dc_bounds(codec, code, voxels.shape, voxels.dtype)
    original = voxels.astype(np.float32)
    peak = float(np.ptp(original))
    before = metrics.psnr(original, decoded.astype(np.float32), peak)
    found: dict[str, Any] = {
        "psnr_db": before,
        "seam": seam_energy(decoded, block),
        "original_seam": seam_energy(voxels, block),
    }
    for name, options in WAYS.items():
        bound = None if name in UNLIMITED else bounds
        after = deblock.rational_bezier(decoded, codec.block, strength, bound, **options)
        found[f"{name}_gain_db"] = metrics.psnr(original, after, peak) - before
        found[f"{name}_seam"] = seam_energy(after, block)
    return found


def summarise(rows: list[dict[str, Any]]) -> None:
    """Mean and worst gain per number of bits, and what the default loses."""
    print("\nbits   " + "   ".join(f"{way:>10} mean  worst" for way in WAYS))
    for bits in sorted({row["bits"] for row in rows}):
        cells = []
        for way in WAYS:
            gains = [row[f"{way}_gain_db"] for row in rows if row["bits"] == bits]
            cells.append(f"{np.mean(gains):15.2f} {min(gains):6.2f}")
        print(f"{bits:4}   " + "   ".join(cells))
    worse = [row for row in rows if row[f"{DEFAULT}_gain_db"] < 0]
    print(f"\nThe default ({DEFAULT}) lowers PSNR in {len(worse)} of {len(rows)} rows:")
    for row in sorted(worse, key=lambda row: float(row[f"{DEFAULT}_gain_db"])):
        print(
            f"  {row['volume']} {row['bits']} bits, blocks of {row['block']}: "
            f"{row[f'{DEFAULT}_gain_db']:+.2f} dB"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--crop", type=int, default=128)
    parser.add_argument("--bits", default="1,2,3,4")
    parser.add_argument("--blocks", default="4,8,16")
    parser.add_argument("--strength", type=float, default=4)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()

    rows: list[dict[str, Any]] = []
    head = "  ".join(f"{way:>10} dB seam" for way in WAYS)
    print(f"{'volume':28} bits block   dB    seam (orig)  {head}")
    for name, voxels in volumes(options.folder, options.crop):
        for bits in map(int, options.bits.split(",")):
            for block in map(int, options.blocks.split(",")):
                found = measure(voxels, bits, block, options.strength)
                rows.append({"volume": name, "bits": bits, "block": block, **found})
                cells = "  ".join(
                    f"{found[f'{way}_gain_db']:+13.2f} {found[f'{way}_seam']:4.2f}" for way in WAYS
                )
                print(
                    f"{name[:28]:28} {bits:4} {block:5} {found['psnr_db']:6.2f} "
                    f"{found['seam']:5.2f} ({found['original_seam']:4.2f})  {cells}",
                    flush=True,
                )
    summarise(rows)
    if options.json:
        options.json.write_text(json.dumps(rows, indent=2) + "\n")


if __name__ == "__main__":
    main()
