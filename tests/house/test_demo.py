"""The demo itself, as its user runs it, on a volume that takes no time."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

DEMO = Path(__file__).parents[2] / "script" / "lib" / "demo.py"


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A soft ball of 40 x 44 x 48 voxels."""
    z, y, x = np.ogrid[-1:1:40j, -1:1:44j, -1:1:48j]
    ball = np.clip(1.2 - np.sqrt(z * z + y * y + x * x), 0, 1)
    path = tmp_path_factory.mktemp("source") / "ball.npy"
    np.save(path, (ball * 255).astype(np.uint8))
    return path


def start(source: Path, out: Path, *options: str) -> subprocess.Popen[str]:
    # In the background of a script, where a test run can be, Ctrl-C is ignored: here it counts.
    command = ["env", "--default-signal=INT", sys.executable, str(DEMO)]
    command += ["--source", str(source), "--out", str(out)]
    command += ["--preset", "ct-bone", "--size", "64x48", *options]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, start_new_session=True)


def finish(demo: subprocess.Popen[str]) -> tuple[int, str, str]:
    """Status, stdout and stderr; and proof that no child of the demo is left."""
    stdout, stderr = demo.communicate(timeout=120)
    with pytest.raises(ProcessLookupError):
        os.killpg(demo.pid, 0)  # its process group is empty
    return demo.returncode, stdout, stderr


@pytest.mark.gl
def test_demo_shows_the_volume_and_leaves_no_server(source: Path, tmp_path: Path) -> None:
    status, stdout, stderr = finish(start(source, tmp_path))
    assert status == 0, stdout + stderr
    assert "$ octobrick ingest" in stdout
    assert "1 of 1 bricks" in stdout
    for name in ("ct-bone.png", "over-http.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")

    # Again: the good volume is kept.
    written = (tmp_path / "ball.zarr" / "zarr.json").stat().st_mtime_ns
    status, stdout, stderr = finish(start(source, tmp_path))
    assert status == 0, stdout + stderr
    assert "is there and undamaged" in stdout
    assert (tmp_path / "ball.zarr" / "zarr.json").stat().st_mtime_ns == written

    # And again, after a byte of a shard has changed: the damage is found, and the volume made anew.
    shard = next(path for path in (tmp_path / "ball.zarr" / "0").rglob("0") if path.is_file())
    good = shard.read_bytes()
    shard.write_bytes(good[:40] + bytes([good[40] ^ 1]) + good[41:])
    status, stdout, stderr = finish(start(source, tmp_path))
    assert status == 0, stdout + stderr
    assert "is damaged: making it again" in stdout
    assert shard.read_bytes() == good


@pytest.mark.gl
def test_serving_demo_ends_with_ctrl_c_and_takes_its_server_along(
    source: Path, tmp_path: Path
) -> None:
    demo = start(source, tmp_path, "--serve")
    assert demo.stdout is not None
    for line in demo.stdout:
        if line.startswith("Ctrl-C"):
            break
    os.killpg(demo.pid, signal.SIGINT)  # as a terminal does
    status, _, stderr = finish(demo)
    assert status == 0, stderr


def test_demo_without_its_source_says_so(tmp_path: Path) -> None:
    status, _, stderr = finish(start(tmp_path / "gone.npy", tmp_path / "out"))
    assert status == 1
    assert "gone.npy" in stderr
    assert "The demo failed" in stderr
