"""The short form of bench/service_soak.py: load and faults at once, in CI."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

SOAK = Path(__file__).parents[2] / "bench" / "service_soak.py"


@pytest.mark.gl
def test_under_load_and_faults_no_byte_is_wrong_and_each_fault_is_told_by_its_kind(
    tmp_path: Path,
) -> None:
    command = [sys.executable, str(SOAK), "--seconds", "9", "--clients", "3"]
    done = subprocess.run(
        [*command, "--json", str(tmp_path / "soak.json")],
        capture_output=True,
        text=True,
        timeout=180,
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    figures = json.loads((tmp_path / "soak.json").read_text())
    assert figures["verified_bricks"] > 0
    assert not figures["wrong"]
    # A server that knows the shard's index meets a brick that is cut off; one that does not, a
    # shard without its index.
    kinds = set(figures["faults"]["shard cut short"]["kinds"])
    assert kinds
    assert kinds <= {"corrupt-brick", "corrupt-volume"}
    assert "revision-gone" in figures["faults"]["volume replaced"]["kinds"]
    assert figures["faults"]["client's cache full"]["injected"] == 1
    compared = {"client", "precomputed, chunk", "zarr, chunk", "zarr2, chunk", "gradients"}
    assert compared <= figures["requests"].keys()
