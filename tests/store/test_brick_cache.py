"""What is kept of volumes on servers: bounded, checked, shared, and never in the way."""

from __future__ import annotations

import errno
import logging
import os
import subprocess
import sys
from pathlib import Path

import pytest

from octobrick.codec.errors import InvalidInputError
from octobrick.store.brick_cache import BrickCache, Kept


def files(folder: Path) -> list[Path]:
    return [path for path in folder.rglob("*") if path.is_file() and path.name != "lock"]


def age(folder: Path) -> None:
    """Make what is kept look a day older."""
    for path in files(folder):
        seconds = path.stat().st_mtime - 86_400
        os.utime(path, (seconds, seconds))


def test_what_was_kept_is_found_by_its_key_alone(tmp_path: Path) -> None:
    BrickCache(tmp_path).put("a", b"payload")
    BrickCache(tmp_path).put("b", None)
    cache = BrickCache(tmp_path)
    assert cache.get("a") == Kept(b"payload")
    assert cache.get("b") == Kept(None)
    assert cache.get("c") is None
    assert cache.stats() == {"hits": 2, "misses": 1, "damaged": 0, "nbytes": 0}


@pytest.mark.parametrize("at", [0, 4, 5, 6, 8, 12, 25, -1, None])
def test_a_damaged_entry_is_dropped_and_counts_as_not_kept(tmp_path: Path, at: int | None) -> None:
    cache = BrickCache(tmp_path)
    cache.put("a", b"payload")
    (path,) = files(tmp_path)
    content = bytearray(path.read_bytes())
    if at is None:
        del content[-3:]
    else:
        content[at] ^= 0x41
    path.write_bytes(content)
    assert cache.get("a") is None
    assert not files(tmp_path)
    cache.put("a", b"payload")
    assert cache.get("a") == Kept(b"payload")


def test_the_bytes_on_disk_are_bounded_and_the_least_used_go_first(tmp_path: Path) -> None:
    cache = BrickCache(tmp_path, 20 * 4096)
    for number in range(18):
        cache.put(f"{number}", bytes(3000))
        age(tmp_path)
    cache.get("0")  # used now
    for number in range(18, 100):
        cache.put(f"{number}", bytes(3000))
        assert len(files(tmp_path)) <= 20
        if number < 30:
            assert cache.get("0") == Kept(bytes(3000))
        age(tmp_path)
        cache.get("0")
    assert cache.get("1") is None
    assert cache.get("99") == Kept(bytes(3000))


def test_a_limit_of_nothing_keeps_nothing(tmp_path: Path) -> None:
    cache = BrickCache(tmp_path / "none", 0)
    cache.put("a", b"x")
    assert cache.get("a") is None
    assert not (tmp_path / "none").exists()


def test_a_full_disk_is_one_warning_and_no_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    cache = BrickCache(tmp_path)
    cache.put("a", b"before")

    def full(self: Path, data: bytes) -> int:
        self.touch()
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with caplog.at_level(logging.WARNING):
        for key in "bcd":
            cache.put(key, b"after")
    assert [record.getMessage().count("No space left") for record in caplog.records] == [1]
    assert cache.get("a") == Kept(b"before")
    assert cache.get("b") is None
    assert len(files(tmp_path)) == 1


def test_a_folder_that_cannot_be_made_is_one_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("x")
    cache = BrickCache(tmp_path / "file" / "cache")
    with caplog.at_level(logging.WARNING):
        cache.put("a", b"x")
        cache.put("b", b"x")
    assert cache.get("a") is None
    assert len(caplog.records) == 1


WRITER = """
import sys
from pathlib import Path
from octobrick.store.brick_cache import BrickCache
cache = BrickCache(Path(sys.argv[1]), 40 * 4096)
for number in range(150):
    key = str(number % 60)
    kept = cache.get(key)
    assert kept is None or kept.payload == key.encode() * 500, key
    cache.put(key, key.encode() * 500)
assert cache.stats()["damaged"] == 0
"""


def test_two_processes_share_a_folder_and_see_whole_entries_only(tmp_path: Path) -> None:
    writers = [subprocess.Popen([sys.executable, "-c", WRITER, str(tmp_path)]) for _ in range(2)]
    assert [writer.wait(60) for writer in writers] == [0, 0]
    assert 0 < len(files(tmp_path)) <= 40 * 1.25  # each an eighth beyond, before it looks
    assert all(path.suffix != ".part" for path in files(tmp_path))


def test_the_usual_one_is_where_the_environment_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("OCTOBRICK_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    BrickCache.usual().put("a", b"x")
    assert files(tmp_path / "octobrick")
    monkeypatch.setenv("OCTOBRICK_CACHE_DIR", str(tmp_path / "own"))
    BrickCache.usual().put("a", b"x")
    assert files(tmp_path / "own")
    monkeypatch.setenv("OCTOBRICK_CACHE_NBYTES", "2GB")
    with pytest.raises(InvalidInputError, match="OCTOBRICK_CACHE_NBYTES"):
        BrickCache.usual()
