"""``octobrick info`` and ``ingest`` of an address."""

from __future__ import annotations

import functools
import http.server
import os
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import zarr
from click.testing import CliRunner

from octobrick.server.cli import main
from octobrick.store import open_volume

VOXELS = np.random.default_rng(3).integers(0, 999, (20, 18, 16), np.uint16)


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *args: object) -> None:
        pass


@pytest.fixture
def url(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """The address of an array that ``python -m http.server`` has, which knows no Range."""
    for name in list(os.environ):
        if name.lower().endswith("_proxy"):
            monkeypatch.delenv(name)
    zarr.create_array(tmp_path / "data" / "a.zarr", data=VOXELS, chunks=(8, 8, 8))
    handler = functools.partial(Quiet, directory=tmp_path / "data")
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{server.server_address[1]}/a.zarr"
        server.shutdown()
        thread.join()


def test_info_tells_of_an_address(url: str) -> None:
    result = CliRunner().invoke(main, ["info", url], catch_exceptions=False)
    assert result.exit_code == 0
    assert "a.zarr" in result.output
    assert "[20, 18, 16]" in result.output


def test_ingest_and_verify_take_an_address(url: str, tmp_path: Path) -> None:
    dest = str(tmp_path / "v.zarr")
    run = functools.partial(CliRunner().invoke, main, catch_exceptions=False)
    result = run(["ingest", url, dest, "--codec", "lossless"])
    assert result.exit_code == 0
    np.testing.assert_array_equal(open_volume(dest).read(0), VOXELS)
    result = run(["verify", dest, "--source", url])
    assert result.exit_code == 0
    assert "equal to the source" in result.output


def test_an_address_without_a_source_is_one_line_of_error(url: str) -> None:
    result = CliRunner().invoke(main, ["info", url + "x"], catch_exceptions=False)
    assert result.exit_code == 1
    assert f"error [source-not-found]: {url}x: no Zarr array or group is here" in result.output
    assert len(result.output.splitlines()) == 1
