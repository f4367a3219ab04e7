"""Zerobit, Figures 5, 8, 10 and 13: null nodes, costs, ratio and fidelity, time of a voxel.

    script/bench papers/zerobit_code [--data ../shared/data] [--quick] [--json FILE]

The paper's data, 6.4 GB of the Visible Man with its background removed, are not at hand. Ours are
serial sections of a mouse brain in RGB, once as they are, once with their white background made
black as the paper did with its blue one ("cut out"). Published numbers are those in the paper's
text; its figures' tables are not. Figure 8's costs follow from the shares of null nodes. Times are
those of bench/zerobit_access.cpp, of a part of the volume where voxels are not background.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import _measure
import numpy as np
import zerobit
from numpy.typing import NDArray
from volumes import central

WHITE = 225  # the least channel from which a voxel of the sections is background
PAPERS_TIMES = {"voxel_random": 1.4, "plane_z": 1.0, "cell": 1.0}
"""Times of a voxel over that of an array, at most, at 5 %; planes and cells "in most cases"."""


def volumes(data: Path, quick: bool) -> Iterator[tuple[str, NDArray[Any]]]:
    """Name and colours (z, y, x, 3)."""
    whole = zerobit.tiff(data / "rgb_histology.tif")
    part = np.ascontiguousarray(whole[central(whole.shape[:3], 96)]) if quick else whole
    yield "sections", part
    cut_out = part.copy()
    cut_out[part.min(axis=3) >= WHITE] = 0
    yield "cut out", cut_out


def run(data: Path, quick: bool) -> dict[str, Any]:
    """Rows by target ratio, with the times of the least and the greatest."""
    found: dict[str, Any] = {}
    with _measure.program("zerobit_access") as program:
        for name, array in volumes(data, quick):
            rows = []
            for ratio in zerobit.RATIOS:
                row, code = zerobit.measure(array, ratio)
                row["operations"] = operations(row)
                if ratio in zerobit.TIMED:
                    times = zerobit.access_times(program, array, code, 3 if quick else 5)
                    ways = times["accesses"].items()
                    row["access"] = {way: zerobit.with_ratios(ns) for way, ns in ways}
                rows.append(row)
            background = float((array == 0).all(axis=3).mean())
            found[name] = {"shape": array.shape, "background": background, "rows": rows}
    return {"volumes": found}


def operations(row: dict[str, Any]) -> dict[str, float]:
    """Additions of a vector for each voxel, on average over cells that are not null (Figure 8)."""
    level0, level1 = 1 - row["null_nodes_level0"], 1 - row["null_nodes_level1"]
    return {"voxel": 7 * (level0 + level1), "cell": 0.375 * level0 + 3 * level1}


def table(result: dict[str, Any]) -> str:
    """Figures 5, 8 and 10 in one, then 13."""
    rows = [(name, row) for name, of in result["volumes"].items() for row in of["rows"]]
    sizes = [
        [
            name,
            f"{row['ratio']:.0%}",
            f"{row['kept']:.2%}",
            f"{row['null_cells']:.0%}",
            f"{row['null_nodes_level0']:.3f}",
            f"{row['null_nodes_level1']:.3f}",
            f"{row['operations']['voxel']:.1f}",
            f"{row['operations']['cell']:.2f}",
            f"{row['compression']:.1f}",
            f"{row['compression_without_pointers']:.1f}",
            "" if row["papers_compression"] is None else f"{row['papers_compression']:.1f}",
            f"{row['psnr_db']:.1f}",
            f"{row['size_of_old_coding']:.2f}",
        ]
        for name, row in rows
    ]
    times = [
        [
            name,
            f"{row['ratio']:.0%}",
            way,
            f"{took['array_ns']:.1f}",
            f"{took['code_ns']:.1f}",
            f"{took['over_array']:.2f}",
            f"<= {PAPERS_TIMES[way]}" if way in PAPERS_TIMES else "",
            f"{took['gain_over_old_table']:.2f}" if "gain_over_old_table" in took else "",
        ]
        for name, row in rows
        for way, took in row.get("access", {}).items()
    ]
    head = (
        *("volume", "ratio", "kept", "null cells", "g0", "g1", "ops/voxel", "ops/voxel by cell"),
        *("CR", "CR'", "paper", "PSNR dB", "old/new size"),
    )
    time_head = (
        *("volume", "ratio", "access", "array ns", "code ns", "code/array", "paper"),
        "old/new time",
    )
    shares = ", ".join(f"{name} {of['background']:.0%}" for name, of in result["volumes"].items())
    return (
        f"background: {shares}; worst costs: 14 operations a voxel, 3.375 by cell\n"
        f"{_measure.layout(head, sizes)}\n\n{_measure.layout(time_head, times)}"
    )


if __name__ == "__main__":
    _measure.main(__doc__, run, table)
