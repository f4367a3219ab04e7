"""Figures of the peers as text: all rows, who is ahead, and each loss by name."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from statistics import median
from typing import Any

import _measure
from _peers_verdicts import Row, Rows, Verdict, summary

Layout = Callable[[Sequence[str], Iterable[Sequence[str]]], str]

HEAD = (
    *("method", "sampled by", "resident bits", "disk bits", "PSNR dB", "max error %"),
    *("encode Mvoxel/s", "decode"),
)
COMPACT = (
    *("S3Dc fixed 4", "S3Dc widths 2", "zfp rate 2", "S3Dc widths 4", "zfp rate 4"),
    *("NanoVDB Fp4", "S3Dc bound 1 %", "NanoVDB FpN 1 %", "zfp ~1 %", "zerobit 5 %"),
)
LOSSLESS = (
    *("S3Dc bound 0 %", "lossless, zstd 3", "zstd 1", "zstd 3", "zstd 19"),
    *("blosc2 zstd shuffle", "blosc2 zstd bitshuffle", "blosc2 lz4 bitshuffle"),
)


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table for the documentation."""
    lines = [list(head), ["---"] * len(head), *map(list, rows)]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def volume_table(name: str, volume: dict[str, Any]) -> str:
    """All rows of one volume; one that failed says why."""
    shape = "×".join(map(str, volume["shape"]))
    title = f"{name}, {shape} {volume['dtype']}"
    lines = [[method, *_cells(row)] for method, row in volume["rows"].items()]
    return f"{title}\n{_measure.layout(HEAD, lines)}{_failures(volume['rows'])}"


def _cells(row: Row) -> list[str]:
    if "failed" in row:
        return [f"! {row['kind']}", *[""] * (len(HEAD) - 2)]
    rates = [row.get(f"{way}_mvoxels_per_second") for way in ("encode", "decode")]
    return [
        row["access"],
        f"{row['resident_bits']:.2f}",
        f"{row['disk_bits']:.2f}",
        _psnr(row),
        f"{row['max_error_percent']:.3g}",
        *("–" if rate is None else _rate(rate) for rate in rates),
    ]


def _rate(rate: float) -> str:
    return f"{rate:.0f}" if rate >= 100 else f"{rate:.3g}"


def _psnr(row: Row) -> str:
    return "∞" if row["is_lossless"] else f"{row['psnr_db']:.2f}"


def _failures(rows: Rows) -> str:
    failed = {k: row for k, row in rows.items() if "failed" in row}
    return "".join(f"\n! {k}: {row['failed']}" for k, row in failed.items())


def compact_table(volumes: dict[str, Any], layout: Layout) -> str:
    """Resident bits, bits on disk, and dB of some methods; a volume to a line."""
    lines = [
        [f"{name}, {v['dtype']}", *(_compact(v["rows"].get(k)) for k in COMPACT)]
        for name, v in volumes.items()
    ]
    return layout(["resident, disk bits: dB", *COMPACT], lines)


def _compact(row: Row | None) -> str:
    if row is None or "failed" in row:
        return "–" if row is None or row["kind"] == "not possible" else row["kind"]
    resident = f"{row['resident_bits']:.2f}" if row["is_sampled"] else "raw"
    psnr = "∞" if row["is_lossless"] else f"{row['psnr_db']:.1f}"
    return f"{resident}, {row['disk_bits']:.2f}: {psnr}"


def lossless_table(volumes: dict[str, Any], layout: Layout) -> str:
    """Bits on disk of what loses nothing, and of S3Dc those resident."""
    lines = [
        [name, *(_lossless(k, v["rows"].get(k)) for k in LOSSLESS)] for name, v in volumes.items()
    ]
    return layout(["bits on disk without loss", *LOSSLESS], lines)


def _lossless(method: str, row: Row | None) -> str:
    if row is None or "failed" in row:
        return "–" if row is None or row["kind"] == "not possible" else row["kind"]
    resident = f" ({row['resident_bits']:.2f} resident)" if method.startswith("S3Dc") else ""
    return f"{row['disk_bits']:.2f}{resident}"


def rate_table(volumes: dict[str, Any], layout: Layout) -> str:
    """Medians over the volumes of the rates, and their spread."""
    methods = list(dict.fromkeys(k for v in volumes.values() for k in v["rows"]))
    lines = []
    for method in methods:
        cells = [method]
        for way in ("encode", "decode"):
            key = f"{way}_mvoxels_per_second"
            rates = [v["rows"].get(method, {}).get(key) for v in volumes.values()]
            known = sorted(rate for rate in rates if rate is not None)
            cells.append(
                f"{_rate(median(known))} ({_rate(known[0])} – {_rate(known[-1])})" if known else "–"
            )
        lines.append(cells)
    return layout(["Mvoxel/s, median (of all volumes)", "encode", "decode"], lines)


def wins_table(found: dict[str, list[Verdict]], layout: Layout) -> str:
    """For each rule and peer on how many volumes we are ahead."""
    groups: dict[tuple[str, str], list[Verdict]] = {}
    for verdict in (v for of in found.values() for v in of):
        name = f"{verdict.peer} {verdict.note}" if "rate" in verdict.rule else verdict.peer
        groups.setdefault((verdict.rule, name), []).append(verdict)
    lines = []
    for (rule, peer), of in sorted(groups.items()):
        counts = Counter(v.winner for v in of)
        lines.append([rule, peer, *(str(counts[who]) for who in ("ours", "tie", "peer", "none"))])
    return layout(["rule", "peer", "we win", "tie", "we lose", "no figure"], lines)


SCORED = {
    "PSNR at equal resident bits": "dB, resident",
    "PSNR at equal disk bits": "dB, disk",
    "disk bits at equal greatest error": "bits at equal error",
    "disk bits without loss": "bits without loss",
}


def scores_table(found: dict[str, list[Verdict]], layout: Layout) -> str:
    """For each peer on how many volumes we win, tie and lose, by rules of size and error."""
    every = [verdict for of in found.values() for verdict in of]
    lines = []
    for peer in dict.fromkeys(v.peer for v in every if v.rule in SCORED):
        cells = []
        for rule in SCORED:
            counts = Counter(v.winner for v in every if (v.peer, v.rule) == (peer, rule))
            wins = "–".join(str(counts[who]) for who in ("ours", "tie", "peer"))
            cells.append(wins if counts else "")
        lines.append([peer, *cells])
    return layout(["won–tied–lost beside", *SCORED.values()], lines)


def losses(found: dict[str, list[Verdict]]) -> str:
    """One line for each comparison that a peer won or that has no figures."""
    lines = []
    for name, of in found.items():
        for verdict in of:
            if verdict.winner == "none":
                lines.append(f"no figure  {name}: {verdict.peer}: {verdict.note}")
            if verdict.winner == "peer":
                ours = "nothing" if verdict.ours is None else f"{verdict.ours:.4g}"
                against = f"{verdict.peer} {verdict.note}".strip()
                lines.append(
                    f"lost  {name}: {verdict.rule}, {against}: "
                    f"{ours} beside {verdict.theirs:.4g} {verdict.unit}"
                )
    return "\n".join(lines)


def short_losses(found: dict[str, list[Verdict]]) -> str:
    """The losses in quality and size, gathered by rule and peer, for the documentation."""
    groups: dict[tuple[str, str], list[str]] = {}
    for name, of in found.items():
        for v in of:
            if v.winner == "peer":
                peer = f"{v.peer} ({v.note})" if "rate" in v.rule else v.peer
                ours = "nothing" if v.ours is None else f"{v.ours:.3g}"
                groups.setdefault((v.rule, peer), []).append(f"{name} {ours} / {v.theirs:.3g}")
    return "\n".join(
        f"- {rule}, {peer}: {'; '.join(names)}" for (rule, peer), names in sorted(groups.items())
    )


def summary_line(found: dict[str, list[Verdict]]) -> str:
    """How many of all comparisons are won; those of rates by themselves."""
    every = [v for of in found.values() for v in of]
    parts = {
        "size and error": [v for v in every if not v.rule.endswith("rate")],
        "rates": [v for v in every if v.rule.endswith("rate")],
    }
    texts = []
    for what, of in parts.items():
        counts = summary(of)
        decided = sum(counts.values()) - counts["none"]
        texts.append(
            f"{what}: we win {counts['ours']} of {decided}, tie {counts['tie']}, "
            f"lose {counts['peer']}" + (f", {counts['none']} without figure" * bool(counts["none"]))
        )
    return "\n".join(texts)
