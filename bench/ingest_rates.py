"""Whether `--psnr` and `--ratio` give what was asked for, on every volume of a folder.

    script/bench ingest_rates [--folder DIR] [--codec s3dc|zerobit] [--psnr 40 50] [--ratio 10 30]
                              [--json]

Ingests each volume for real, once per target, and prints what level 0 got, and how far the coarser
levels are from what was asked for. Whatever was kept exactly, or missed with a warning, says so.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from _measure import DATA, machine

from octobrick.codec import Zerobit
from octobrick.codec.errors import OctobrickError
from octobrick.store import IngestResult, ingest
from octobrick.store.sources import open_source

READABLE = (".gz", ".mhd", ".nii", ".npy", ".nrrd", ".tif", ".vdb", ".nvdb")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--folder", type=Path, default=DATA)
    parser.add_argument("--codec", choices=["s3dc", "zerobit"], default="s3dc")
    parser.add_argument("--psnr", type=float, nargs="*", default=[40.0, 50.0])
    parser.add_argument("--ratio", type=float, nargs="*", default=[10.0, 30.0])
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    targets: list[dict[str, Any]] = [{"psnr": value} for value in arguments.psnr]
    targets += [{"ratio": value} for value in arguments.ratio]
    rows = []
    for path in sorted(arguments.folder.iterdir()):
        if path.suffix not in READABLE or not is_readable(path):
            continue
        for target in targets:
            rows.append(row(path, target, arguments.codec))
            if not arguments.json:
                print(line(rows[-1]), flush=True)
    if arguments.json:
        print(json.dumps({"machine": machine(), "codec": arguments.codec, "rows": rows}, indent=1))


def is_readable(path: Path) -> bool:
    try:
        with open_source(path):
            return True
    except OctobrickError as error:
        print(f"# skipped {path.name}: {error.kind}")
        return False


def row(path: Path, target: dict[str, Any], codec: str) -> dict[str, Any]:
    options: dict[str, Any] = {"codec": Zerobit()} if codec == "zerobit" else {}
    with tempfile.TemporaryDirectory() as folder:
        started = time.monotonic()
        try:
            result = ingest(path, Path(folder) / "v.zarr", **target, **options)
        except OctobrickError as error:
            return {"volume": path.name, "target": target, "refused": error.message}
    seconds = time.monotonic() - started
    kind, wanted = next(iter(target.items()))
    levels = [found(result, i, kind) for i in range(len(result.levels))]
    # Levels that were kept exactly miss nothing.
    off = [wanted - v if kind == "psnr" else 1 - v / wanted for v in levels[1:] if np.isfinite(v)]
    return {
        "volume": path.name,
        "target": target,
        "level_0": levels[0],
        "worst_shortfall": max(off, default=0.0),
        "exact_levels": sum(level.psnr_db is None for level in result.levels),
        "levels": len(levels),
        "seconds": seconds,
        "warnings": list(result.warnings),
    }


def found(result: IngestResult, index: int, kind: str) -> float:
    level = result.levels[index]
    if kind == "psnr":
        return float("inf") if level.psnr_db is None else level.psnr_db
    return level.ratio or float("inf")


def line(row: dict[str, Any]) -> str:
    kind, wanted = next(iter(row["target"].items()))
    head = f"{row['volume']:34} {kind:5} {wanted:5g}"
    if "refused" in row:
        return f"{head}  refused: {row['refused']}"
    unit = "dB" if kind == "psnr" else "× "
    shortfall = row["worst_shortfall"]
    coarse = f"{shortfall:+.2f} dB" if kind == "psnr" else f"{100 * shortfall:+.1f} %"
    return (
        f"{head}  level 0 {row['level_0']:7.2f} {unit}  coarser short by {coarse:>9}  "
        f"exact {row['exact_levels']}/{row['levels']}  {row['seconds']:5.1f} s"
    )


if __name__ == "__main__":
    main()
