"""script/bench lists what it can run, in the folder and in those of papers."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

LIST = Path(__file__).parents[2] / "script" / "lib" / "list_benches.py"


def test_names_are_those_that_script_bench_takes_and_shared_modules_are_left_out(
    tmp_path: Path,
) -> None:
    (tmp_path / "papers").mkdir()
    for name in ("render", "_shared", "papers/table", "papers/_shared"):
        (tmp_path / f"{name}.py").write_text(f'"""What {name} measures.\n\nMore."""\n')
    command = [sys.executable, str(LIST), str(tmp_path)]
    listed = subprocess.run(command, capture_output=True, text=True, check=True)
    assert listed.stdout.splitlines() == [
        "render        What render measures.",
        "papers/table  What papers/table measures.",
    ]
