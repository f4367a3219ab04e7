"""Type checkers read the committed stubs, Python runs the modules: they must say the same."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

MAKER = Path(__file__).parents[2] / "script/lib/make_stubs.py"
MADE = runpy.run_path(str(MAKER))


@pytest.mark.parametrize("module", MADE["STUBS"])
def test_committed_stub_is_what_the_module_says(module: str) -> None:
    if not MADE["is_built"](module):
        pytest.skip(f"{module} is not built")
    committed = MADE["STUBS"][module].read_text()
    assert committed == MADE["stub_text"](module), f"run {MAKER.name}"
