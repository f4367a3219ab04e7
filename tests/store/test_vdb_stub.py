"""Type checkers read the committed stub of _vdb, Python runs the module: they must say the same."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

STORE = Path(__file__).parents[2] / "store"


def test_committed_stub_is_what_the_module_says() -> None:
    pytest.importorskip("octobrick.store._vdb")
    make_stub = runpy.run_path(str(STORE / "native/bindings/make_stub.py"))
    committed = (STORE / "octobrick/store/_vdb.pyi").read_text()
    assert committed == make_stub["stub_text"](), "run store/native/bindings/make_stub.py"
