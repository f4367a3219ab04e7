"""The command line between other programs."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np


def test_output_that_nobody_reads_is_no_error_to_report(tmp_path: Path) -> None:
    """`octobrick info … | head -1` once ended with an error about a broken pipe."""
    np.save(tmp_path / "v.npy", np.zeros((4, 4, 4), np.uint8))
    read_end, write_end = os.pipe()
    os.close(read_end)
    command = [sys.executable, "-m", "octobrick.server.cli", "info", tmp_path / "v.npy"]
    try:
        done = subprocess.run(
            command, stdout=write_end, stderr=subprocess.PIPE, text=True, check=False
        )
    finally:
        os.close(write_end)
    assert (done.returncode, done.stderr) == (1, "")
