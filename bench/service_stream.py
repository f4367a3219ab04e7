"""Bricks and pictures over a shaped link: first picture, convergence, bytes moved, by each way.

    script/bench service_stream [--mbit 50] [--delay-ms 40] [--rounds 3] [--source FILE]

The server runs in one network namespace and the client in another, joined by a link that is
shaped in both directions; needs root, ip and /dev/net/tun. The same working set is fetched, the
coarsest level first, then what `select` says a view of bone needs (else all of level 0 that bone
can show): by select and one batch; with one request for each brick, over six connections, as
browsers have them, or one; and as raw voxels, without code and zstd, over six. A first picture is
possible once the coarsest level is there. The ways take turns; medians. Every brick is compared
with the disk afterwards.

Then the renderer itself draws a view of bone at level 0 while bricks arrive, 512² pixels, without
a cache on disk: in batches, as it does; with one request for each brick, over six connections; raw
voxels over six; and from files on disk, which is what drawing takes by itself (its volume is
opened over the link all the same). The time begins when the volume is opened; shaders are made
before. *First* is the first picture that shows something, *converged* the one that has every brick,
which is compared with the picture from disk.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from _measure import layout, machine, write_json
from _shaped_link import ShapedLink

ROOT = Path(__file__).resolve().parents[1]
HERE = Path(__file__).resolve().parent
SERVED_SECONDS = 60.0
PORT = 8000
WAYS = ("batch", "single-6", "single-1", "raw-6")
RENDERED = ("render-batch", "render-single", "render-raw", "render-disk")
EVERY = [*WAYS, *RENDERED]


def main() -> None:
    """Ingest, serve, fetch in turns, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--mbit", type=float, default=50.0, help="of the link, each direction")
    parser.add_argument("--delay-ms", type=float, default=40.0, help="round trip")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--source", type=Path, default=ROOT / "data" / "ct_vhf_head.mhd")
    parser.add_argument("--ways", nargs="*", default=EVERY, choices=EVERY, metavar="WAY")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there")
    options = parser.parse_args()
    if os.geteuid() != 0:
        raise SystemExit("needs root, for network namespaces")
    with tempfile.TemporaryDirectory(prefix="octobrick-stream-") as folder:
        figures = measure(Path(folder), options)
    print(table(figures))
    if options.json:
        write_json(options.json, {"machine": machine(), **figures})


def measure(folder: Path, options: argparse.Namespace) -> dict[str, Any]:
    """All rounds of all ways."""
    octobrick = str(Path(sys.executable).with_name("octobrick"))
    served = folder / "served"
    for codec, name in (("s3dc", "head"), ("lossless", "raw")):
        command = [octobrick, "ingest", str(options.source), str(served / f"{name}.zarr")]
        subprocess.run([*command, "--codec", codec], check=True, stdout=subprocess.DEVNULL)
    serve = [octobrick, "serve", str(served)]
    with ShapedLink(options.mbit, options.delay_ms) as link:
        server = subprocess.Popen(
            link.at_server([*serve, "--host", link.server_address, "--port", str(PORT)]),
            stdout=subprocess.PIPE,
        )
        try:
            assert server.stdout
            server.stdout.readline()
            runs = [ask(link, served, way) for _ in range(options.rounds) for way in options.ways]
        finally:
            server.terminate()
            server.communicate(timeout=SERVED_SECONDS)
    by_way: dict[str, list[dict[str, Any]]] = {}
    for run in runs:
        by_way.setdefault(run["way"], []).append(run)
    return {
        "link": {"mbit": options.mbit, "round_trip_ms": options.delay_ms},
        "source": options.source.name,
        "ways": {way: _medians(found) for way, found in by_way.items()},
    }


def ask(link: ShapedLink, served: Path, way: str) -> dict[str, Any]:
    """One fetch in a process of its own behind the link; {} where the server has no such route."""
    script = "_stream_render.py" if way in RENDERED else "_stream_fetch.py"
    command = [sys.executable, str(HERE / script), way, link.server_address, str(PORT)]
    done = subprocess.run(
        link.at_client([*command, str(served)]), check=True, stdout=subprocess.PIPE
    )
    found: dict[str, Any] = json.loads(done.stdout)
    return {"way": way, **found}


def _medians(runs: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        name: statistics.median(run[name] for run in runs)
        for name in ("pictures", "bricks", "first_seconds", "all_seconds", "link_nbytes")
        if name in runs[0]
    }


def table(figures: dict[str, Any]) -> str:
    """All of it, for people."""
    rows: dict[bool, list[list[str]]] = {False: [], True: []}
    for way, found in figures["ways"].items():
        if "all_seconds" not in found:
            rows[False].append([way, "-", "-", "-", "not tried: no such route"])
            continue
        rows[way in RENDERED].append(
            [
                way,
                f"{found['bricks']:.0f}",
                f"{found['first_seconds']:.2f}",
                f"{found['all_seconds']:.2f}",
                f"{found['link_nbytes'] / 1e6:.2f}",
                *([f"{found['pictures']:.0f}"] if "pictures" in found else []),
            ]
        )
    link = figures["link"]
    head = f"{figures['source']} over {link['mbit']:g} Mbit/s, {link['round_trip_ms']:g} ms"
    fetched = ["way", "bricks", "coarse level, s", "all, s", "MB over the link"]
    drawn = ["way", "bricks", "first, s", "converged, s", "MB over the link", "pictures"]
    tables = [layout(fetched, rows[False]), layout(drawn, rows[True])]
    return "\n\n".join([head, *(t for t, r in zip(tables, rows.values(), strict=True) if r)])


if __name__ == "__main__":
    main()
