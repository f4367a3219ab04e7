"""docs/rendering.md tells the truth."""

from __future__ import annotations

import re
from importlib import resources
from pathlib import Path

from octobrick.renderer import TransferFunction

TEXT = (Path(__file__).parents[2] / "docs" / "rendering.md").read_text(encoding="utf-8")


def test_its_transfer_function_can_be_read() -> None:
    (block,) = re.findall(r"```json\n(.*?)```", TEXT, re.DOTALL)
    function = TransferFunction.from_json(block)
    assert function.opacity_unit == "extent"


def test_it_names_every_preset() -> None:
    (line,) = re.findall(r"Presets: ([^\n]*)\.\s", TEXT.replace("\n", " "))[:1] or [""]
    assert re.findall(r"`([a-z-]+)`", line.split(". ")[0]) == TransferFunction.preset_names()


def test_its_passes_are_files() -> None:
    package = resources.files("octobrick.renderer")
    names = {p.name for p in package.iterdir()} | {p.name for p in (package / "shaders").iterdir()}
    table = re.findall(r"^\| \d \| `([^`]+)`", TEXT, re.MULTILINE)
    assert len(table) == 9
    for name in table:
        pattern = re.compile(re.escape(name).replace(r"\*", ".*"))
        assert any(pattern.fullmatch(other) for other in names), name
