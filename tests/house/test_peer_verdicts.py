"""The rules by which script/bench peers says who is ahead."""

from __future__ import annotations

import importlib
import math
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

BENCH = Path(__file__).parents[2] / "bench"


@pytest.fixture(scope="module")
def rules() -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(BENCH))
        return importlib.import_module("_peers_verdicts")


def row(
    bits: float,
    psnr_db: float = 40.0,
    error_percent: float = 1.0,
    *,
    family: str = "S3Dc widths",
    ours: bool = True,
    **fields: Any,
) -> dict[str, Any]:
    """A code of a volume; as large in memory as on disk."""
    return {
        "is_ours": ours, "family": family, "kind": "lossy", "is_lossless": False,
        "is_sampled": True, "resident_bits": bits, "disk_bits": bits, "psnr_db": psnr_db,
        "max_error_percent": error_percent, **fields,
    }  # fmt: skip


def peer(bits: float, psnr_db: float = 40.0, **fields: Any) -> dict[str, Any]:
    return row(bits, psnr_db, ours=False, family="zfp rate", **fields)


def winners(rules: ModuleType, rows: dict[str, Any], rule: str) -> list[str]:
    return [verdict.winner for verdict in rules.verdicts(rows) if verdict.rule == rule]


DISK, RESIDENT = "PSNR at equal disk bits", "PSNR at equal resident bits"


@pytest.mark.parametrize(
    ("ours_db", "winner"), [(40.2, "ours"), (40.05, "tie"), (39.95, "tie"), (39.8, "peer")]
)
def test_more_db_at_the_same_size_win_beyond_a_tenth(
    rules: ModuleType, ours_db: float, winner: str
) -> None:
    rows = {"zfp": peer(2.0), "ours": row(2.0, ours_db)}
    assert winners(rules, rows, DISK) == winners(rules, rows, RESIDENT) == [winner]


def test_between_settings_a_continuous_family_is_interpolated_and_others_are_not(
    rules: ModuleType,
) -> None:
    for family, winner in (("S3Dc widths", "ours"), ("S3Dc fixed", "peer")):
        rows = {
            "zfp": peer(3.0, 44.0),
            "small": row(2.0, 40.0, family=family),
            "large": row(4.0, 50.0, family=family),
        }
        assert winners(rules, rows, DISK) == [winner]


def test_what_is_larger_or_cannot_be_sampled_does_not_count(rules: ModuleType) -> None:
    rows = {"zfp": peer(2.0), "ours": row(2.1, 90.0)}
    assert winners(rules, rows, DISK) == ["peer"]  # nothing of ours is so small
    rows = {"zfp": peer(2.0), "ours": row(2.0, 90.0, is_sampled=False)}
    assert winners(rules, rows, DISK) == ["ours"]
    assert winners(rules, rows, RESIDENT) == ["peer"]


def test_a_code_without_loss_has_infinite_psnr_but_lifts_no_code_below_its_size(
    rules: ModuleType,
) -> None:
    rows = {"low": row(2.0, 40.0), "all": row(6.0, math.inf, is_lossless=True)}
    assert rules.best_psnr(rows, "disk_bits", 6.0) == math.inf
    assert rules.best_psnr(rows, "disk_bits", 5.9) == 40.0


def test_bits_at_equal_error_are_interpolated_over_its_logarithm(rules: ModuleType) -> None:
    bound = {"family": "S3Dc bound"}
    rows = {
        "fine": row(8.0, error_percent=0.01, **bound),
        "rough": row(2.0, error_percent=1.0, **bound),
    }
    assert rules.least_bits(rows, 0.1) == pytest.approx(5.0)
    assert rules.least_bits(rows, 1.0) == rules.least_bits(rows, 5.0) == 2.0
    assert rules.least_bits(rows, 0.001) is None
    rows["zfp"] = row(4.9, error_percent=0.1, ours=False, family="zfp accuracy")
    assert winners(rules, rows, "disk bits at equal greatest error") == ["peer"]
    rows["zfp"]["disk_bits"] = 5.01
    assert winners(rules, rows, "disk bits at equal greatest error") == ["tie"]


def test_lossless_codes_are_compared_with_lossless_ones_alone(rules: ModuleType) -> None:
    rows = {
        "blosc": peer(7.0, math.inf, is_lossless=True, is_sampled=False),
        "lossy": row(1.0),
        "ours": row(6.0, math.inf, is_lossless=True),
    }
    assert winners(rules, rows, "disk bits without loss") == ["ours"]
    assert winners(rules, rows, "resident bits without loss") == []
    del rows["ours"]
    assert winners(rules, rows, "disk bits without loss") == ["peer"]


def test_what_failed_wins_nothing_and_what_is_not_possible_is_not_counted(
    rules: ModuleType,
) -> None:
    rows = {
        "ours": row(2.0),
        "broken": peer(1.0, failed="out of memory"),
        "never": peer(1.0, failed="no such type", kind="not possible"),
    }
    (only,) = rules.verdicts(rows)
    assert (only.peer, only.winner, only.note) == ("broken", "none", "out of memory")
    rows["ours"]["failed"] = "no code"
    rows["zfp"] = peer(2.0)
    assert winners(rules, rows, DISK) == ["peer"]


@pytest.mark.parametrize(
    ("ours", "winner"), [(120, "ours"), (105, "tie"), (95, "tie"), (80, "peer")]
)
def test_rates_are_equal_within_a_tenth(rules: ModuleType, ours: float, winner: str) -> None:
    rows = {
        "S3Dc fixed 4": row(4.0, decode_mvoxels_per_second=ours),
        "zfp rate 4": peer(4.0, decode_mvoxels_per_second=100.0),
    }
    assert winners(rules, rows, "decode rate") == [winner]
    assert winners(rules, rows, "encode rate") == []  # not measured


codes = st.tuples(st.floats(0.1, 16), st.floats(10, 100))


@given(st.lists(codes, min_size=1, max_size=6), st.lists(codes, max_size=4), st.floats(0.1, 16))
def test_a_larger_size_or_another_code_never_lowers_the_best_psnr(
    rules: ModuleType,
    found: list[tuple[float, float]],
    more: list[tuple[float, float]],
    bits: float,
) -> None:
    def best(codes: list[tuple[float, float]], bits: float) -> float:
        rows = {str(i): row(*code, family="S3Dc fixed") for i, code in enumerate(codes)}
        psnr = rules.best_psnr(rows, "disk_bits", bits)
        return -math.inf if psnr is None else float(psnr)

    assert best(found, bits) <= best(found, bits * 1.5)
    assert best(found, bits) <= best(found + more, bits)


def test_all_verdicts_are_counted(rules: ModuleType) -> None:
    rows = {"zfp": peer(2.0), "other": peer(1.0), "ours": row(2.0, 50.0)}
    found = rules.verdicts(rows)
    assert rules.summary(found) == {"ours": 2, "peer": 2, "tie": 0, "none": 0}
