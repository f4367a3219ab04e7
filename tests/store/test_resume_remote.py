"""An ingest that loses its server goes on when it is back, to the bytes of a local one."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import zarr

from octobrick.store import ingest
from octobrick.store.errors import ResumeError, SourceUnreachableError, UnsupportedSourceError

from .sources.web import Trick, Web, dead_after, fixed, status

SHAPE = (60, 50, 40)
OPTIONS = {"brick": 16, "shard": 2, "checkpoint_seconds": 0.0}


def digests(folder: Path) -> dict[str, str]:
    """What is in a folder, hidden files too: path and digest of each file."""
    return {
        str(path.relative_to(folder)): hashlib.blake2b(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.fixture(params=["chunks", "shards"])
def web(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Web]:
    """A server of ``a.zarr``: detail, noise and absent chunks, read in pieces of eight planes."""
    for name in list(os.environ):
        if name.startswith("AWS_") or name.lower().endswith("_proxy"):
            monkeypatch.delenv(name)
    monkeypatch.setattr("octobrick.store.piece_reader.READ_NBYTES", 8 * 2 * SHAPE[1] * SHAPE[2])
    monkeypatch.setattr("octobrick.store.sources.remote._BACKOFF_SECONDS", 0.001)
    monkeypatch.setattr("octobrick.store.sources.remote._RETRIES", 2)
    z, y, x = np.indices(SHAPE)
    noise = np.random.default_rng(5).integers(0, 200, SHAPE)
    voxels = (2000 + 900 * np.sin(z / 7) * np.cos(y / 9 + x / 5) + noise).astype(np.uint16)
    voxels[16:40, 16:48, 16:32] = 0
    shards = (24, 32, 32) if request.param == "shards" else None
    (tmp_path / "data").mkdir()
    zarr.create_array(tmp_path / "data" / "a.zarr", data=voxels, chunks=(8, 16, 16), shards=shards)
    with Web(tmp_path / "data").running() as web:
        yield web


def lose(web: Web, dest: Path, trick: Trick, text: str) -> None:
    web.trick = trick
    with pytest.raises(SourceUnreachableError, match=text):
        ingest(f"{web.url}/a.zarr", dest, **OPTIONS)
    web.trick = lambda handler: False
    assert not dest.exists()


def test_an_ingest_that_loses_its_server_again_and_again_ends_with_the_bytes_of_a_local_one(
    web: Web, tmp_path: Path
) -> None:
    ingest(web.folder / "a.zarr", tmp_path / "local" / "v.zarr", **OPTIONS)
    dest = tmp_path / "v.zarr"
    for count in (45, 35, 25):
        lose(web, dest, dead_after(count), "3 times")
    result = ingest(f"{web.url}/a.zarr", dest, **OPTIONS)
    assert result.resumed_voxels > SHAPE[1] * SHAPE[2] * 16
    assert digests(dest) == digests(tmp_path / "local" / "v.zarr")


def test_all_that_came_before_a_server_was_lost_is_kept_between_checkpoints(
    web: Web, tmp_path: Path
) -> None:
    dest, options = tmp_path / "v.zarr", OPTIONS | {"checkpoint_seconds": 600}
    web.trick = status(503, "c/2/1/1")
    with pytest.raises(SourceUnreachableError):
        ingest(f"{web.url}/a.zarr", dest, **options)
    web.trick = lambda handler: False
    result = ingest(f"{web.url}/a.zarr", dest, **options)
    array = zarr.open_array(web.folder / "a.zarr", mode="r")
    planes = 2 * (array.shards or array.chunks)[0]
    assert result.resumed_voxels == planes * SHAPE[1] * SHAPE[2]


@pytest.mark.parametrize(
    ("trick", "text"),
    [
        (status(503, "c/2/1/1"), "503"),
        (status(403, "c/2/1/1"), "403"),
        (fixed(200, b"<html>", {"Content-Type": "text/html"}, "c/2/1/1"), "web page|a login"),
    ],
    ids=["overloaded", "refused", "login"],
)
def test_a_server_that_fails_midway_costs_nothing_of_what_is_there(
    web: Web, tmp_path: Path, trick: Trick, text: str
) -> None:
    dest = tmp_path / "v.zarr"
    lose(web, dest, trick, text)
    assert ingest(f"{web.url}/a.zarr", dest, **OPTIONS).resumed_voxels > 0


def test_a_source_that_changed_while_it_was_away_is_refused(web: Web, tmp_path: Path) -> None:
    dest = tmp_path / "v.zarr"
    lose(web, dest, status(503, "c/2/1/1"), "503")
    os.utime(web.folder / "a.zarr" / "zarr.json", ns=(10**9, 10**9))
    with pytest.raises(ResumeError, match=r"source modified was '2.* and is '1970-01-01T00:00:01"):
        ingest(f"{web.url}/a.zarr", dest, **OPTIONS)
    assert ingest(f"{web.url}/a.zarr", dest, restart=True, **OPTIONS).resumed_voxels == 0


def test_a_server_without_ranges_leaves_nothing(web: Web, tmp_path: Path) -> None:
    web.ranges = False
    dest = tmp_path / "v.zarr"
    try:
        ingest(f"{web.url}/a.zarr", dest, **OPTIONS)
    except UnsupportedSourceError:
        assert [path.name for path in tmp_path.iterdir()] == ["data"]
    else:
        assert dest.is_dir()
