"""How fast bricks of a volume on a server come: one by one, in batches, and from the disk cache.

python bench/remote_volume.py http://host:8000/v1/volumes/head --level 0
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from octobrick.store.brick_cache import BrickCache
from octobrick.store.http_volume import HttpVolume
from octobrick.store.remote_bricks import Place


def measured(read: Callable[[], int], nbricks: int) -> dict[str, float]:
    """Bricks and code bytes per second of one reading of all bricks."""
    started = time.perf_counter()
    nbytes = read()
    seconds = time.perf_counter() - started
    return {
        "bricks_per_second": round(nbricks / seconds),
        "code_megabytes_per_second": round(nbytes / 1e6 / seconds, 1),
        "seconds": round(seconds, 3),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("url")
    parser.add_argument("--level", type=int, default=0)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        nothing, kept = BrickCache(Path(folder), 0), BrickCache(Path(folder) / "kept")
        for _ in range(options.rounds):
            for name, cache in (("single", nothing), ("batch", nothing), ("kept", kept)):
                with HttpVolume(options.url, cache=cache) as volume:
                    grid_zyx = volume.level(options.level).grid_zyx
                    places: list[Place] = [
                        (options.level, (z, y, x), 0, 0) for z, y, x in np.ndindex(*grid_zyx)
                    ]

                    def single(volume: HttpVolume = volume, all_: list[Place] = places) -> int:
                        return sum(len(volume.brick_code(*place) or b"") for place in all_)

                    def batch(volume: HttpVolume = volume, all_: list[Place] = places) -> int:
                        came = [code for _, code in volume.brick_codes(all_)]
                        return sum(len(code) for code in came if isinstance(code, bytes))

                    if name == "kept":
                        batch()
                    read = single if name == "single" else batch
                    line = {"how": name, "bricks": len(places), **measured(read, len(places))}
                    print(json.dumps(line), flush=True)


if __name__ == "__main__":
    main()
