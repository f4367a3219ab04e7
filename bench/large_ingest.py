"""Memory and speed of ingesting a volume that is larger than the memory it may take.

    script/bench large_ingest [--side 1024] [--lossless] [--folder DIR] [--keep] [--json]

Generates a raw uint16 file of SIDE³ voxels (2 GiB for 1024) plane by plane: waves with noise, so
that nothing compresses to nothing. Then `octobrick ingest` runs as a process of its own, and the
system's account of that process is what counts.
"""

from __future__ import annotations

import argparse
import json
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--side", type=int, default=1024)
    parser.add_argument("--lossless", action="store_true")
    parser.add_argument("--folder", type=Path, help="where to write (a temporary folder)")
    parser.add_argument("--keep", action="store_true", help="keep the file and the volume")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()

    folder = Path(tempfile.mkdtemp(dir=arguments.folder, prefix="octobrick-large-"))
    try:
        result = measure(folder, arguments.side, lossless=arguments.lossless)
    finally:
        if not arguments.keep:
            shutil.rmtree(folder)
    if arguments.json:
        print(json.dumps(result, indent=1))
        return
    for name, value in result.items():
        print(f"{name:24} {value:.4g}" if isinstance(value, float) else f"{name:24} {value}")


def measure(folder: Path, side: int, *, lossless: bool) -> dict[str, object]:
    source = folder / "waves.raw"
    generate(source, side)
    octobrick = str(Path(sys.executable).with_name("octobrick"))
    command = [octobrick, "ingest", str(source)]
    command += [str(folder / "waves.zarr"), "--shape", f"{side},{side},{side}"]
    command += ["--dtype", "uint16", "--json", "--codec", "lossless" if lossless else "s3dc"]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    report = json.loads(done.stdout)
    first = report["levels"][0]
    return {
        "source_mebibytes": source.stat().st_size / 2**20,
        "peak_rss_mebibytes": resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024,
        "seconds": report["elapsed_seconds"],
        "megabytes_per_second": report["megabytes_per_second"],
        "ratio": first["ratio"],
        "psnr_db": first["psnr_db"],
        "max_error": first["max_error"],
    }


def generate(path: Path, side: int) -> None:
    """Write SIDE³ uint16 voxels, z slowest, with memory for a few planes."""
    noise = np.random.default_rng(0).integers(0, 200, (side, side)).astype(np.uint16)
    at = np.linspace(0, 6, side, dtype=np.float32)
    y, x = at[:, np.newaxis], at[np.newaxis, :]
    with path.open("wb") as file:
        for index, z in enumerate(at):
            wave = (np.sin(y + z) * np.cos(x - z / 2) + 1) * 30000
            plane = wave.astype(np.uint16) + np.roll(noise, 37 * index, axis=0)
            file.write(plane.astype("<u2").tobytes())


if __name__ == "__main__":
    main()
