"""Who is ahead: rules that compare our codes with each peer, volume by volume.

Where a family of codes has a parameter, it can be set to any size or bound, so what it gives
between two measured settings is interpolated: PSNR over bits, bits over the logarithm of the
greatest error. Nothing is taken from outside the measured settings. Of ours the best family counts.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

Row = dict[str, Any]
Rows = dict[str, Row]
Winner = Literal["ours", "peer", "tie", "none"]

CONTINUOUS = ("S3Dc widths", "S3Dc bound", "zerobit")
"""Families of ours whose parameter may have any value."""

TIE_DB, TIE_BITS, TIE_RATE = 0.1, 0.01, 0.1
"""Differences that count as none: dB, and shares of bits and of rates (of a shared machine)."""

_SAME_SIZE = 1.005
"""Headers may make a code so much larger than the size that was asked for."""

BOUND_FAMILIES = ("zfp accuracy", "NanoVDB FpN")
# Not NanoVDB, whose tool is a process on files.
RATE_PAIRS = (
    ("S3Dc fixed 4", "zfp rate 4"),
    ("S3Dc widths 4", "zfp rate 4"),
    ("S3Dc bound 1 %", "zfp ~1 %"),
    ("S3Dc bound 0 %", "zstd 3"),
    ("S3Dc bound 0 %", "blosc2 zstd bitshuffle"),
    ("lossless, zstd 3", "zstd 3"),
)


@dataclass(frozen=True, slots=True)
class Verdict:
    """One comparison on one volume.

    Attributes:
        rule: what was compared.
        peer: the row it was compared with.
        winner: "none" where one of them has no figure.
        ours: our figure; None where we have no code of that size or error.
        theirs: the peer's; None where it failed, and for PSNR without loss infinite.
        unit: of both.
    """

    rule: str
    peer: str
    winner: Winner
    ours: float | None
    theirs: float | None
    unit: str
    note: str = ""


def verdicts(rows: Rows) -> list[Verdict]:
    """All comparisons on one volume."""
    found: list[Verdict] = []
    peers = {name: row for name, row in rows.items() if not row["is_ours"]}
    for name, row in peers.items():
        if "failed" in row:
            if row["kind"] != "not possible":
                found.append(Verdict("all", name, "none", None, None, "", row["failed"]))
            continue
        if row["is_lossless"]:
            keys = ("resident_bits", "disk_bits") if row["is_sampled"] else ("disk_bits",)
            found += [_lossless(key, name, row, rows) for key in keys]
            continue
        if row["is_sampled"]:
            found.append(_equal_bits("resident_bits", name, row, rows))
        found.append(_equal_bits("disk_bits", name, row, rows))
        if row["family"] in BOUND_FAMILIES:
            found.append(_equal_error(name, row, rows))
    return found + list(_rates(rows))


def summary(found: Iterable[Verdict]) -> dict[str, int]:
    """How often who is ahead."""
    winners = [verdict.winner for verdict in found]
    return {who: winners.count(who) for who in ("ours", "peer", "tie", "none")}


def _equal_bits(key: str, name: str, row: Row, rows: Rows) -> Verdict:
    """PSNR at the peer's size; of resident sizes only codes that can be sampled count."""
    ours = best_psnr(rows, key, row[key])
    theirs = row["psnr_db"]
    rule = "PSNR at equal resident bits" if key == "resident_bits" else "PSNR at equal disk bits"
    return Verdict(rule, name, _higher(ours, theirs, TIE_DB), ours, theirs, "dB", _at(row[key]))


def _at(bits: float) -> str:
    return f"at {bits:.2f} bits"


def _equal_error(name: str, row: Row, rows: Rows) -> Verdict:
    """Bits on disk at the peer's greatest error."""
    ours = least_bits(rows, row["max_error_percent"])
    winner = _lower(ours, row["disk_bits"], TIE_BITS)
    note = f"at {row['max_error_percent']:.3g} % error"
    return Verdict("disk bits at equal greatest error", name, winner, ours, row["disk_bits"],
                   "bits", note)  # fmt: skip


def _lossless(key: str, name: str, row: Row, rows: Rows) -> Verdict:
    own = [r for r in _own(rows) if r["is_lossless"]]
    if key == "resident_bits":
        own = [r for r in own if r["is_sampled"]]
    ours = min((r[key] for r in own), default=None)
    rule = f"{key.partition('_')[0]} bits without loss"
    return Verdict(rule, name, _lower(ours, row[key], TIE_BITS), ours, row[key], "bits")


def _rates(rows: Rows) -> Iterator[Verdict]:
    for own, peer in RATE_PAIRS:
        for way in ("encode", "decode"):
            key = f"{way}_mvoxels_per_second"
            if own not in rows or peer not in rows:
                continue
            ours, theirs = rows[own].get(key), rows[peer].get(key)
            if ours is None or theirs is None:
                continue
            winner: Winner = "tie"
            if abs(ours - theirs) > TIE_RATE * max(ours, theirs):
                winner = "ours" if ours > theirs else "peer"
            yield Verdict(f"{way} rate", peer, winner, ours, theirs, "Mvoxel/s", f"by {own}")


def best_psnr(rows: Rows, key: str, bits: float) -> float | None:
    """The highest PSNR of ours at a size; infinite without loss, None where nothing is so small."""
    families: dict[str, list[tuple[float, float]]] = {}
    for row in _own(rows):
        if key == "disk_bits" or row["is_sampled"]:
            psnr = math.inf if row["is_lossless"] else row["psnr_db"]
            families.setdefault(row["family"], []).append((row[key], psnr))
    limit = bits * _SAME_SIZE
    best = [_psnr_within(family, points, limit) for family, points in families.items()]
    return max((psnr for psnr in best if psnr is not None), default=None)


def _psnr_within(family: str, points: list[tuple[float, float]], limit: float) -> float | None:
    """The PSNR of a family at a size: of the best code within it, or between its neighbours."""
    points = sorted(points)
    found = max((psnr for bits, psnr in points if bits <= limit), default=None)
    if found is None or family not in CONTINUOUS:
        return found
    for (low, psnr_low), (high, psnr_high) in pairwise(points):
        if low <= limit < high and math.isfinite(psnr_high):
            share = (limit - low) / (high - low)
            found = max(found, psnr_low + share * (psnr_high - psnr_low))
    return found


def least_bits(rows: Rows, error_percent: float) -> float | None:
    """The fewest bits on disk with which a bound of ours keeps such an error."""
    points = sorted(
        (row["max_error_percent"], row["disk_bits"])
        for row in _own(rows)
        if row["family"] == "S3Dc bound"
    )
    limit = error_percent * (1 + 1e-9)
    found = min((bits for error, bits in points if error <= limit), default=None)
    for (low, bits_low), (high, bits_high) in pairwise(points):
        if 0 < low <= limit < high:
            share = math.log(limit / low) / math.log(high / low)
            between = bits_low + share * (bits_high - bits_low)
            found = between if found is None else min(found, between)
    return found


def _own(rows: Rows) -> Iterator[Row]:
    return (row for row in rows.values() if row["is_ours"] and "failed" not in row)


def _higher(ours: float | None, theirs: float, tie: float) -> Winner:
    if ours is None:
        return "peer"
    if ours == theirs or abs(ours - theirs) < tie:
        return "tie"
    return "ours" if ours > theirs else "peer"


def _lower(ours: float | None, theirs: float, tie: float) -> Winner:
    if ours is None:
        return "peer"
    if abs(ours - theirs) <= tie * theirs:
        return "tie"
    return "ours" if ours < theirs else "peer"
