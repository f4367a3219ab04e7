"""An ingest that was stopped goes on where it was and ends with the bytes of one that was not."""

from __future__ import annotations

import hashlib
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from octobrick.codec import S3dc
from octobrick.codec.errors import InvalidInputError, NotFiniteError
from octobrick.store import Box, ingest, open_volume
from octobrick.store.destination import partial_path
from octobrick.store.errors import (
    DestinationError,
    DestinationExistsError,
    IncompleteVolumeError,
    IngestCancelledError,
    ResumeError,
)
from octobrick.store.progress import Progress

SHAPE = (90, 60, 70)
OPTIONS = {"brick": 16, "shard": 2, "checkpoint_seconds": 0.0, "gradients": True}


def digests(folder: Path) -> dict[str, str]:
    """What is in a folder, hidden files too: path and digest of each file."""
    return {
        str(path.relative_to(folder)): hashlib.blake2b(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.fixture
def source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A volume with detail, noise and a hole (absent bricks), read in pieces of four planes."""
    monkeypatch.setattr("octobrick.store.piece_reader.READ_NBYTES", 4 * 2 * SHAPE[1] * SHAPE[2])
    z, y, x = np.indices(SHAPE)
    noise = np.random.default_rng(5).integers(0, 200, SHAPE)
    voxels = (2000 + 900 * np.sin(z / 7) * np.cos(y / 9 + x / 5) + noise).astype(np.uint16)
    voxels[20:70, 10:50, 20:60] = 0
    np.save(tmp_path / "v.npy", voxels)
    return tmp_path / "v.npy"


@pytest.fixture
def undisturbed(source: Path, tmp_path: Path) -> dict[str, str]:
    ingest(source, tmp_path / "undisturbed" / "v.zarr", **OPTIONS)
    return digests(tmp_path / "undisturbed" / "v.zarr")


class Stop:
    """Cancels an ingest after so many pieces."""

    def __init__(self, after: int) -> None:
        self.event = threading.Event()
        self._left = after

    def __call__(self, _progress: Progress) -> None:
        self._left -= 1
        if self._left <= 0:
            self.event.set()


def test_an_ingest_cancelled_after_any_piece_goes_on_to_the_same_bytes(
    source: Path, undisturbed: dict[str, str], tmp_path: Path
) -> None:
    dest = tmp_path / "v.zarr"
    for after in range(1, 24, 3):
        stop = Stop(after)
        with pytest.raises(IngestCancelledError, match="run it again"):
            ingest(source, dest, progress=stop, cancel=stop.event, **OPTIONS)
        assert not dest.exists()
        with pytest.raises(IncompleteVolumeError):
            open_volume(dest)
        result = ingest(source, dest, overwrite=True, **OPTIONS)
        assert result.resumed_voxels == min(4 * after, SHAPE[0]) * SHAPE[1] * SHAPE[2]
        assert digests(dest) == undisturbed
        subprocess.run(["rm", "-r", dest], check=True)


def test_an_ingest_cancelled_after_every_piece_comes_to_its_end(
    source: Path, undisturbed: dict[str, str], tmp_path: Path
) -> None:
    dest = tmp_path / "v.zarr"
    for _ in range(-(-SHAPE[0] // 4)):
        stop = Stop(1)
        with pytest.raises(IngestCancelledError):
            ingest(source, dest, progress=stop, cancel=stop.event, **OPTIONS)
    ingest(source, dest, **OPTIONS)
    assert digests(dest) == undisturbed


KILLED = """
import sys
import octobrick.store.piece_reader
from octobrick.store import ingest

octobrick.store.piece_reader.READ_NBYTES = int(sys.argv[3])
print("ready", flush=True)
ingest(sys.argv[1], sys.argv[2], brick=16, shard=2, checkpoint_seconds=0, gradients=True)
"""


def test_an_ingest_killed_at_random_moments_goes_on_to_the_same_bytes(
    source: Path, undisturbed: dict[str, str], tmp_path: Path
) -> None:
    dest = tmp_path / "v.zarr"
    random = np.random.default_rng(int(os.environ.get("OCTOBRICK_KILL_SEED", "0")))
    kills = 0
    while not dest.exists() and kills < 12:
        command = [sys.executable, "-c", KILLED, source, dest, str(8 * SHAPE[1] * SHAPE[2])]
        with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
            assert process.stdout is not None
            assert process.stdout.readline() == b"ready\n"
            time.sleep(random.uniform(0, 0.3))
            process.send_signal(signal.SIGKILL)
        kills += 1
    if not dest.exists():
        ingest(source, dest, **OPTIONS)
    assert digests(dest) == undisturbed


def test_what_a_killed_run_was_writing_is_no_part_of_the_volume(
    source: Path, undisturbed: dict[str, str], tmp_path: Path
) -> None:
    dest, stop = tmp_path / "v.zarr", Stop(5)
    with pytest.raises(IngestCancelledError):
        ingest(source, dest, progress=stop, cancel=stop.event, **OPTIONS)
    partial = partial_path(dest)
    (partial / "gradient/1").mkdir(parents=True, exist_ok=True)
    for name in (".journal.part", ".scratch-1", "zarr.12.partial", "gradient/1/zarr.12.partial"):
        (partial / name).write_bytes(b"half")
    ingest(source, dest, **{**OPTIONS, "checkpoint_seconds": 1e9})
    assert digests(dest) == undisturbed


def test_another_source_is_refused_with_what_changed_until_told_to_restart(
    source: Path, tmp_path: Path
) -> None:
    dest, stop = tmp_path / "v.zarr", Stop(5)
    with pytest.raises(IngestCancelledError):
        ingest(source, dest, progress=stop, cancel=stop.event, **OPTIONS)
    np.save(source, np.ones((30, 40, 50), np.uint16))
    with pytest.raises(ResumeError, match=r"shape_zyx.*90, 60, 70.*30, 40, 50") as caught:
        ingest(source, dest, **OPTIONS)
    assert "source shape_zyx" in caught.value.facts["changed"]
    ingest(source, dest, restart=True, codec=None, **OPTIONS)
    assert (open_volume(dest).read(0) == 1).all()


def test_a_source_touched_since_is_refused(source: Path, tmp_path: Path) -> None:
    dest, stop = tmp_path / "v.zarr", Stop(5)
    with pytest.raises(IngestCancelledError):
        ingest(source, dest, progress=stop, cancel=stop.event, **OPTIONS)
    os.utime(source, ns=(1, 1))
    with pytest.raises(ResumeError, match=r"source modified was '2.* and is '1970-01-01"):
        ingest(source, dest, **OPTIONS)


def test_other_options_are_refused_by_name(source: Path, tmp_path: Path) -> None:
    dest, stop = tmp_path / "v.zarr", Stop(5)
    with pytest.raises(IngestCancelledError):
        ingest(source, dest, progress=stop, cancel=stop.event, **OPTIONS)
    with pytest.raises(ResumeError, match="options zstd_level was None and is 5"):
        ingest(source, dest, zstd_level=5, **OPTIONS)
    ingest(source, dest, workers=1, **OPTIONS)  # which changes no byte


@pytest.mark.parametrize("damage", ["cut", "empty", "text", "shard"])
def test_a_damaged_checkpoint_begins_again(
    source: Path, undisturbed: dict[str, str], tmp_path: Path, damage: str
) -> None:
    dest, stop = tmp_path / "v.zarr", Stop(13)
    with pytest.raises(IngestCancelledError):
        ingest(source, dest, progress=stop, cancel=stop.event, **OPTIONS)
    partial = tmp_path / "v.zarr.partial"
    journal = partial / ".journal"
    match damage:
        case "cut":
            journal.write_bytes(journal.read_bytes()[:-1000])
        case "empty":
            journal.write_bytes(b"")
        case "text":
            journal.write_text("hello")
        case "shard":
            part = next(partial.rglob("*.part"))
            part.write_bytes(part.read_bytes()[:-1])
    assert ingest(source, dest, **OPTIONS).resumed_voxels == 0
    assert digests(dest) == undisturbed


def test_a_full_disk_leaves_a_checkpoint_from_which_it_goes_on(
    source: Path, undisturbed: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from octobrick.store.shard import ShardWriter

    dest, append, calls = tmp_path / "v.zarr", ShardWriter.append, []

    def full(self: ShardWriter, slot: int, frame: bytes) -> None:
        calls.append(slot)
        if len(calls) > 70:
            raise OSError(28, "No space left on device", str(self.path))
        append(self, slot, frame)

    monkeypatch.setattr(ShardWriter, "append", full)
    with pytest.raises(DestinationError, match=r"free some space.*goes on from the last") as caught:
        ingest(source, dest, **OPTIONS)
    assert caught.value.facts["errno"] == 28
    monkeypatch.setattr(ShardWriter, "append", append)
    assert ingest(source, dest, **OPTIONS).resumed_voxels > 0
    assert digests(dest) == undisturbed


def test_a_source_that_vanishes_and_comes_back_is_gone_on_with(
    source: Path, undisturbed: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from octobrick.store.errors import SourceError

    dest, preadv, calls = tmp_path / "v.zarr", os.preadv, []

    def lost(*args: object) -> int:
        calls.append(args)
        if len(calls) > 10:
            raise OSError(5, "Input/output error")
        return preadv(*args)  # type: ignore[arg-type]

    monkeypatch.setattr(os, "preadv", lost)
    with pytest.raises(SourceError, match="Input/output error"):
        ingest(source, dest, **OPTIONS)
    monkeypatch.setattr(os, "preadv", preadv)
    assert ingest(source, dest, **OPTIONS).resumed_voxels > 0
    assert digests(dest) == undisturbed


def test_a_source_with_wrong_voxels_leaves_nothing_even_after_a_checkpoint(
    source: Path, tmp_path: Path
) -> None:
    voxels = np.ones(SHAPE, np.float32)
    voxels[-1, -1, -1] = np.nan
    np.save(source, voxels)
    with pytest.raises(NotFiniteError):
        ingest(source, tmp_path / "v.zarr", **OPTIONS)
    assert [path.name for path in tmp_path.iterdir()] == ["v.npy"]


@pytest.mark.parametrize(
    "slip",
    [
        {"region": Box((0, 0, 0), (91, 60, 70))},
        {"convert": "int128"},
        {"window": (3.0, 2.0), "convert": "uint8"},
        {"labels": True, "codec": S3dc(bits=8)},
        {"brick": 17},
    ],
)
def test_a_slip_of_the_pen_costs_nothing_of_what_an_earlier_run_has(
    source: Path, undisturbed: dict[str, str], tmp_path: Path, slip: dict[str, object]
) -> None:
    dest, stop = tmp_path / "v.zarr", Stop(13)
    with pytest.raises(IngestCancelledError):
        ingest(source, dest, progress=stop, cancel=stop.event, **OPTIONS)
    with pytest.raises(InvalidInputError):
        ingest(source, dest, **(OPTIONS | slip))  # type: ignore[arg-type]
    assert ingest(source, dest, **OPTIONS).resumed_voxels > 0
    assert digests(dest) == undisturbed


def test_something_that_appears_at_the_destination_costs_nothing(
    source: Path, undisturbed: dict[str, str], tmp_path: Path
) -> None:
    dest = tmp_path / "v.zarr"

    def appear(_: Progress) -> None:
        dest.write_text("mine")

    with pytest.raises(DestinationExistsError):
        ingest(source, dest, progress=appear, **OPTIONS)
    assert dest.read_text() == "mine"
    dest.unlink()
    assert ingest(source, dest, **OPTIONS).resumed_voxels > 0
    assert digests(dest) == undisturbed
