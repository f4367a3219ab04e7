"""What octobrick promises by name changes on purpose only."""

from __future__ import annotations

import difflib
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
SNAPSHOT = ROOT / "tests" / "house" / "public_names.txt"
COMMAND = "script/lib/public_names.py"


def test_public_names_are_those_of_the_snapshot() -> None:
    command = [sys.executable, str(ROOT / COMMAND)]
    found = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    difference = list(
        difflib.unified_diff(
            SNAPSHOT.read_text().splitlines(), found.splitlines(), "promised", "found", lineterm=""
        )
    )
    assert not difference, (
        "\n".join(difference)
        + f"\nIf that is meant: .venv/bin/python {COMMAND} > {SNAPSHOT.relative_to(ROOT)}"
    )


def test_snapshot_covers_every_component() -> None:
    components = {line.split(".")[1].split("(")[0] for line in SNAPSHOT.read_text().splitlines()}
    assert components == {"codec", "store", "renderer", "measure", "server"}
