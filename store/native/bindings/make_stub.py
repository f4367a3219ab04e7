"""Writes store/octobrick/store/_vdb.pyi from the built module.

    python store/native/bindings/make_stub.py

The stub is committed, because type checkers work from plain paths without a build, and most builds
are without OpenVDB. Where the module is there, a test makes it afresh and compares.
"""

from __future__ import annotations

import importlib
import subprocess
import sys
from pathlib import Path

from nanobind.stubgen import StubGen  # type: ignore[import-untyped]

STUB = Path(__file__).parents[2] / "octobrick/store/_vdb.pyi"


def stub_text() -> str:
    """The stub of the built module, in the style of this repository."""
    generator = StubGen(importlib.import_module("octobrick.store._vdb"))
    generator.put(generator.module)
    text = str(generator.get())
    for style in (["check", "--select=I", "--fix-only"], ["format"]):
        command = [sys.executable, "-m", "ruff", *style, "--stdin-filename", str(STUB), "-"]
        text = subprocess.run(  # noqa: S603  # our own command line
            command, input=text, capture_output=True, text=True, check=True
        ).stdout
    return text


if __name__ == "__main__":
    STUB.write_text(stub_text())
