"""The table of extremes is complete: each row has its tests, and what it points at is there."""

from __future__ import annotations

import ast
import importlib
import re
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from .table import EXTREMES, IMPLEMENTATIONS

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
LIMITATIONS = ROOT / "docs" / "limitations.md"


def functions_here() -> dict[str, Any]:
    """Every test function of this folder, by module and name."""
    found = {}
    for path in sorted(HERE.glob("test_*.py")):
        module = importlib.import_module(f".{path.stem}", __package__)
        for name in vars(module):
            if name.startswith("test_"):
                found[f"{path.stem}.{name}"] = getattr(module, name)
    return found


def places_of(function: Any) -> list[str]:
    """The ids system-extreme-implementation that a test runs under."""
    return [
        str(parameter.id)
        for mark in getattr(function, "pytestmark", [])
        if mark.name == "parametrize" and mark.args[0] == "implementation"
        for parameter in mark.args[1]
    ]


def rows() -> set[str]:
    return {
        f"{system}-{row.name}-{implementation}"
        for row in EXTREMES
        for system, implementations in row.systems.items()
        for implementation in implementations
    }


def headings() -> list[str]:
    return re.findall(r"^## (.+)$", LIMITATIONS.read_text(encoding="utf-8"), re.MULTILINE)


def test_every_row_has_a_test_for_each_system_and_implementation() -> None:
    held = {place for function in functions_here().values() for place in places_of(function)}
    held |= {
        f"{place.split('-')[0]}-{row.name}-{place.split('-')[1]}"
        for row in EXTREMES
        for place in row.elsewhere
    }
    assert sorted(rows() - held) == []


def test_every_test_holds_a_place_of_the_table() -> None:
    for name, function in functions_here().items():
        places = places_of(function)
        if not name.startswith("test_table."):
            assert places, f"{name} holds nothing"
        assert set(places) <= rows(), name


def test_rows_are_told_apart_and_say_what_is_expected() -> None:
    assert max(Counter(row.name for row in EXTREMES).values()) == 1
    for row in EXTREMES:
        assert row.title
        assert row.expected
        assert {i for each in row.systems.values() for i in each} <= set(IMPLEMENTATIONS)


@pytest.mark.parametrize(
    "node", sorted({node for row in EXTREMES for node in row.elsewhere.values()})
)
def test_a_test_elsewhere_that_a_row_points_at_is_there(node: str) -> None:
    path, name = node.split("::")
    tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    (function,) = (n for n in tree.body if isinstance(n, ast.FunctionDef) and n.name == name)
    marks = " ".join(ast.unparse(decorator) for decorator in function.decorator_list)
    assert not re.search(r"mark\.(skip|xfail)\b", marks)


def test_rows_point_at_places_that_they_have() -> None:
    for row in EXTREMES:
        for place in row.elsewhere:
            system, implementation = place.split("-")
            assert implementation in row.systems[system], row.name


def test_no_test_is_skipped_or_expected_to_fail_without_a_limitation() -> None:
    limited = {row.name for row in EXTREMES if row.limitation}
    for name, function in functions_here().items():
        marks = {mark.name for mark in getattr(function, "pytestmark", [])}
        if marks & {"skip", "skipif", "xfail"}:
            assert all(place.split("-", 1)[1].rsplit("-", 1)[0] in limited
                       for place in places_of(function)), name  # fmt: skip


def test_limitations_of_rows_have_their_heading() -> None:
    known = headings()
    assert len(known) == len(set(known))
    for row in EXTREMES:
        assert row.limitation is None or row.limitation in known, row.name


def test_every_limitation_says_how_to_recognise_it_and_what_to_do() -> None:
    text = LIMITATIONS.read_text(encoding="utf-8")
    for section in re.split(r"^## ", text, flags=re.MULTILINE)[1:]:
        assert "**Recognise it:**" in section, section.splitlines()[0]
        assert "**Do:**" in section, section.splitlines()[0]
