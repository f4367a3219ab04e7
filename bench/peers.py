"""Our codes beside zfp, NanoVDB, Blosc2 and zstd: size, error and rate on the same volumes.

    script/bench peers [--only NAME] [--quick] [--json FILE] [--markdown FILE]

Of every scalar volume the central 192³ voxels. Bits are per voxel. "Resident" is what must be in
memory so that a renderer can sample any voxel: the code where it is sampled voxel by voxel or in
blocks of 4³, else the voxels themselves. "Disk" is behind zstd at level 3, or in the peer's own
packing where that is smaller. PSNR has the range of the data as its peak; greatest errors are in
percent of that range. "bound e" is S3Dc whose errors stay below e of the range, "zfp ~e" zfp with
the tolerance whose greatest error is nearest to that, "FpN e" NanoVDB with this tolerance.

Rates are million voxels for a second of one processor (not of the clock: the machine may do other
things besides), of the central 96³, taking turns, medians. For zfp conversions of types do not
count. NanoVDB's are of its tool, which is a process that reads and writes files, so they are in no
comparison. zstd 19 is timed once, on the whole.

Then who is ahead, by the rules of bench/_peers_verdicts.py, and each comparison that we lose. A
method that fails has a row that says so, and the status is then 1. Needs NanoVDB's tools
(apt-get install libnanovdb-tools); without them their rows say so.
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import _measure
import _peers_general
import _peers_nanovdb
import _peers_ours
import _peers_tables
import _peers_zfp
from _peers_method import Method
from _peers_plot import draw
from _peers_rows import rows_of
from _peers_verdicts import Verdict, verdicts
from _peers_volumes import peer_volumes

CROP, TIMED_CROP, ROUNDS = 192, 96, 3
QUICK_CROP, QUICK_ROUNDS, QUICK_VOLUMES = 64, 1, 3


def methods() -> list[Method]:
    """Ours, then the peers."""
    parts = (_peers_ours, _peers_zfp, _peers_nanovdb, _peers_general)
    return [method for part in parts for method in part.methods()]


def run(
    data: Path, quick: bool, only: str | None = None, json: Path | None = None
) -> dict[str, Any]:
    """The rows of each volume; printed, and written, as soon as they are there."""
    volumes: dict[str, Any] = {}
    for name, voxels in peer_volumes(data, QUICK_CROP if quick else CROP):
        if only and only.lower() not in name.lower():
            continue
        rows = rows_of(
            methods(),
            voxels,
            timed_crop=QUICK_CROP if quick else TIMED_CROP,
            rounds=QUICK_ROUNDS if quick else ROUNDS,
        )
        volumes[name] = {"shape": voxels.shape, "dtype": voxels.dtype.name, "rows": rows}
        print(_peers_tables.volume_table(name, volumes[name]), end="\n\n", flush=True)
        if json:  # a run that is cut short has some
            _measure.write_json(json, {"volumes": volumes})
        if quick and len(volumes) == QUICK_VOLUMES:
            break
    return {"volumes": volumes}


def compared(figures: dict[str, Any]) -> dict[str, list[Verdict]]:
    """The comparisons on each volume."""
    return {name: verdicts(volume["rows"]) for name, volume in figures["volumes"].items()}


def table(figures: dict[str, Any]) -> str:
    """Who is ahead, and what we lose."""
    found = compared(figures)
    return "\n\n".join(
        (
            _peers_tables.wins_table(found, _measure.layout),
            _peers_tables.losses(found),
            _peers_tables.summary_line(found),
        )
    )


def write_markdown(figures: dict[str, Any], path: Path) -> None:
    """The tables of the documentation."""
    volumes, found = figures["volumes"], compared(figures)
    layout = _peers_tables.markdown
    parts = (
        _peers_tables.compact_table(volumes, layout),
        _peers_tables.lossless_table(volumes, layout),
        _peers_tables.rate_table(volumes, layout),
        _peers_tables.scores_table(found, layout),
        _peers_tables.short_losses(found),
        _peers_tables.summary_line(found),
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n\n".join(parts) + "\n", encoding="utf-8")


def _options() -> argparse.Namespace:
    parser = _measure.parser(__doc__)
    parser.add_argument("--only", metavar="NAME", help="volumes whose name has this in it")
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="write tables there")
    parser.add_argument(
        "--plot", type=Path, metavar="FILE", default=_measure.OUT / "peers.png", help="the picture"
    )
    return parser.parse_args()


def _plain(verdict: Verdict) -> dict[str, Any]:
    """A comparison for JSON, which has no infinite numbers."""
    is_lossless = verdict.ours == math.inf
    ours = None if is_lossless else verdict.ours
    return {**asdict(verdict), "ours": ours, "ours_is_lossless": is_lossless}


def main() -> None:
    options = _options()
    figures = run(options.data, options.quick, options.only, options.json)
    if not figures["volumes"]:
        sys.exit(f"no scalar volume in {options.data} is called {options.only or 'anything'}")
    found = {name: [_plain(v) for v in of] for name, of in compared(figures).items()}
    _measure.report(options, {**figures, "verdicts": found}, table)
    draw(figures["volumes"], options.plot)
    if options.markdown:
        write_markdown(figures, options.markdown)
    failed = [
        f"{name}: {method}: {row['failed']}"
        for name, volume in figures["volumes"].items()
        for method, row in volume["rows"].items()
        if row.get("kind") == "error"
    ]
    if failed:
        sys.exit("!! failed:\n" + "\n".join(failed))


if __name__ == "__main__":
    main()
