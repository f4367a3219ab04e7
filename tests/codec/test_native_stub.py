"""Type checkers read the committed stub, Python runs the module: they must say the same."""

from __future__ import annotations

import runpy
from pathlib import Path

CODEC = Path(__file__).parents[2] / "codec"


def test_committed_stub_is_what_the_module_says() -> None:
    make_stub = runpy.run_path(str(CODEC / "bindings/make_stub.py"))
    committed = (CODEC / "octobrick/codec/_native.pyi").read_text()
    assert committed == make_stub["stub_text"](), "run codec/bindings/make_stub.py"
