from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from octobrick.store import ingest, open_volume
from octobrick.store.destination import partial_path, staged
from octobrick.store.errors import DestinationBusyError, DestinationExistsError, SourceError

from .conftest import smooth


@pytest.fixture
def source(tmp_path: Path) -> Path:
    path = tmp_path / "v.npy"
    np.save(path, smooth((20, 30, 40)))
    return path


def test_an_existing_volume_is_kept_unless_told_to_overwrite(source: Path, tmp_path: Path) -> None:
    dest = tmp_path / "v.zarr"
    ingest(source, dest)
    before = open_volume(dest).revision
    np.save(source, smooth((20, 30, 40), seed=1))
    with pytest.raises(DestinationExistsError, match=r"v\.zarr.*already exists"):
        ingest(source, dest)
    assert open_volume(dest).revision == before
    ingest(source, dest, overwrite=True)
    assert open_volume(dest).revision != before
    assert sorted(p.name for p in tmp_path.iterdir()) == ["v.npy", "v.zarr"]


def test_a_failed_overwrite_keeps_the_old_volume(source: Path, tmp_path: Path) -> None:
    dest = tmp_path / "v.zarr"
    ingest(source, dest)
    before = open_volume(dest).revision
    source.write_bytes(source.read_bytes()[:-1000])
    with pytest.raises(SourceError):
        ingest(source, dest, overwrite=True)
    assert open_volume(dest).revision == before
    assert not partial_path(dest).exists()


@pytest.mark.parametrize("kind", ["file", "folder", "link"])
def test_what_is_no_volume_is_never_overwritten(source: Path, tmp_path: Path, kind: str) -> None:
    dest = tmp_path / "precious"
    if kind == "file":
        dest.write_text("thesis")
    elif kind == "folder":
        dest.mkdir()
        (dest / "thesis").write_text("thesis")
    else:
        dest.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(DestinationExistsError):
        ingest(source, dest, overwrite=True)
    assert dest.exists() or dest.is_symlink()


def test_two_ingests_into_one_destination_do_not_mix(source: Path, tmp_path: Path) -> None:
    dest = tmp_path / "v.zarr"
    with staged(dest, overwrite=False) as folder:
        assert folder == partial_path(dest)
        with pytest.raises(DestinationBusyError, match="another ingest"):
            ingest(source, dest)


def test_a_failure_leaves_nothing_behind(tmp_path: Path) -> None:
    def interrupted() -> None:
        with staged(tmp_path / "v.zarr", overwrite=False) as folder:
            (folder / "half").write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert list(tmp_path.iterdir()) == []


LIMITED = """
import resource, signal, sys
from octobrick.codec.errors import OctobrickError
from octobrick.store import ingest
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
try:
    ingest(sys.argv[1], sys.argv[2])
except OctobrickError as error:
    print(error.kind, error.message)
"""


def test_a_destination_that_takes_no_more_bytes_is_explained_and_left_clean(
    tmp_path: Path,
) -> None:
    np.save(tmp_path / "v.npy", smooth((64, 64, 64)))
    command = [sys.executable, "-c", LIMITED, tmp_path / "v.npy", tmp_path / "v.zarr"]
    out = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    assert out.startswith("destination ")
    assert "v.zarr" in out
    assert "Nothing was left behind" in out
    assert [p.name for p in tmp_path.iterdir()] == ["v.npy"]


UNPRIVILEGED = """
import os, sys
from octobrick.codec.errors import OctobrickError
from octobrick.store import ingest
if os.getuid() == 0:
    os.setgid(65534); os.setuid(65534)
try:
    ingest(sys.argv[1], sys.argv[2])
except OctobrickError as error:
    print(error.kind, error.message)
"""


def test_an_unwritable_destination_is_explained(tmp_path: Path, source: Path) -> None:
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o555)
    for folder in (tmp_path, *tmp_path.parents):
        if folder.owner() == source.owner() and folder != Path("/tmp"):
            folder.chmod(folder.stat().st_mode | 0o005)
    command = [sys.executable, "-c", UNPRIVILEGED, source, closed / "v.zarr"]
    out = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    assert out.startswith("destination ")
    assert str(closed / "v.zarr") in out
    assert list(closed.iterdir()) == []
