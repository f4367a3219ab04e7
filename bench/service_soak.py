"""Mixed load and faults on a server, for minutes: no wrong byte, no leak, each fault by its kind.

    script/bench service_soak [--minutes 10 | --seconds 20] [--clients 6] [--workers 2]

Serves three volumes of 96 x 128 x 128 voxels by `--workers` processes (2, or 1 with `--seconds`),
and once more by a server that wants tokens. Clients ask for all that there is: bricks and
gradients, single and in batches, selections, pictures in all formats, metadata, 304s, chunks for
readers of Zarr and precomputed; every other one as a page of another origin does. The project's own
client reads along, with a disk cache that is too small. Meanwhile, in turn: a render worker and,
where there are several, a server process are killed, a shard is cut short and mended, a volume is
replaced while it is read, a client leaves in the middle of a batch, another takes what it asked for
slowly, the disk under a client's cache is full (a tmpfs for root, else a limit on files). Each
brick's checksum is verified and its bytes are compared with the volume of that revision on disk.
Other settings of the server come from the environment. Status 1 if a promise broke.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from typing import Any

from _measure import layout, machine, write_json
from _soak_run import Soak

# Memory may still settle (allocators, caches that fill): below this it does not count as growing.
GROWTH_LIMIT = 0.10
GROWTH_FLOOR_NBYTES = 24_000_000
DESCRIPTORS_LIMIT = 8
LEAK_SECONDS = 100.0  # before, caches and allocators are still filling


def main() -> None:
    """Run, print a table, fail where a promise broke."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seconds", type=float, help="instead of minutes, for a short one")
    parser.add_argument("--clients", type=int, default=6, help="threads that ask")
    parser.add_argument("--workers", type=int, help="server processes")
    parser.add_argument("--source", type=Path, help="a volume to ingest instead")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there")
    options = parser.parse_args()
    seconds = options.seconds or 60 * options.minutes
    with tempfile.TemporaryDirectory(prefix="octobrick-soak-") as folder:
        workers = options.workers or (1 if options.seconds else 2)
        soak = Soak(Path(folder), options.source, options.clients, workers)
        figures = soak.run(seconds)
    broken = broken_promises(figures)
    print(table(figures))
    if options.json:
        write_json(options.json, {"machine": machine(), **figures, "broken": broken})
    for promise in broken:
        print(f"BROKEN: {promise}", file=sys.stderr)
    sys.exit(1 if broken else 0)


def broken_promises(figures: dict[str, Any]) -> list[str]:
    """What must hold and does not; whether something grows shows only after some minutes."""
    broken = list(figures["wrong"])
    if figures["seconds"] >= LEAK_SECONDS:
        broken += leaks(figures)
    if figures["verified_bricks"] == 0:
        broken.append("no brick was verified")
    for name, fault in figures["faults"].items():
        if fault["injected"] and not fault["seen"]:
            broken.append(f"fault {name}: injected {fault['injected']} times, never seen")
    return broken


def leaks(figures: dict[str, Any]) -> list[str]:
    """What grew from the second to the last quarter of the time."""
    broken = []
    memory, files = figures["memory"], figures["descriptors"]
    more = memory["last_quarter"] - memory["second_quarter"]
    if more > max(GROWTH_FLOOR_NBYTES, GROWTH_LIMIT * memory["second_quarter"]):
        broken.append(f"memory grew by {more / 1e6:.1f} MB between the second and last quarter")
    if files["last_quarter"] - files["second_quarter"] > DESCRIPTORS_LIMIT:
        broken.append(f"descriptors grew: {files}")
    return broken


def table(figures: dict[str, Any]) -> str:
    """All of it, for people."""
    rate = [
        [name, str(n), f"{n / figures['seconds']:.1f}"] for name, n in figures["requests"].items()
    ]
    faults = [
        [name, str(f["injected"]), str(f["seen"]), ", ".join(f["kinds"]) or "-"]
        for name, f in figures["faults"].items()
    ]
    flat = [
        [
            name,
            *(f"{figures[key][part] / scale:.1f}" for part in ("second_quarter", "last_quarter")),
            f"{figures[key]['slope_per_minute'] / scale:+.2f}",
        ]
        for name, key, scale in (("memory, MB", "memory", 1e6), ("descriptors", "descriptors", 1))
    ]
    errors = [[kind, str(n)] for kind, n in sorted(figures["errors"].items())]
    return "\n\n".join(
        (
            f"{figures['seconds']:.0f} s, {figures['verified_bricks']} bricks compared with the "
            f"disk, {len(figures['wrong'])} wrong",
            layout(["request", "answers", "per second"], rate),
            layout(["fault", "injected", "seen", "kinds of the answers"], faults),
            layout(["process tree", "2nd quarter", "last quarter", "a minute"], flat),
            layout(["error kind", "answers"], errors),
        )
    )


if __name__ == "__main__":
    main()
