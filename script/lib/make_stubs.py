"""Writes the stubs of the native modules from those that are built.

    python script/lib/make_stubs.py

Stubs are committed, because type checkers work from plain paths without a build, and a build may be
without OpenVDB. Tests make them afresh and compare.
"""

from __future__ import annotations

import importlib
import importlib.util
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
STUBS = {
    "octobrick.codec._native": ROOT / "codec/octobrick/codec/_native.pyi",
    "octobrick.store._vdb": ROOT / "store/octobrick/store/_vdb.pyi",
}


def is_built(module: str) -> bool:
    """Whether a native module is there to make a stub of."""
    return importlib.util.find_spec(module) is not None


def stub_text(module: str) -> str:
    """The stub of a built module, in the style of this repository."""
    from nanobind.stubgen import StubGen  # type: ignore[import-untyped]

    generator = StubGen(importlib.import_module(module))
    generator.put(generator.module)
    text = str(generator.get())
    for style in (["check", "--select=I", "--fix-only"], ["format"]):
        name = str(STUBS[module])
        command = [sys.executable, "-m", "ruff", *style, "--stdin-filename", name, "-"]
        text = subprocess.run(
            command, input=text, capture_output=True, text=True, check=True
        ).stdout
    return text


if __name__ == "__main__":
    for name, stub in STUBS.items():
        if is_built(name):
            stub.write_text(stub_text(name))
