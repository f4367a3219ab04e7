"""Volumes on disk at the extremes: damage stays where it is, and nothing half made is seen."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest

from octobrick.codec.errors import CorruptBrickError, OctobrickError
from octobrick.store import Box, ingest, open_volume

from .table import holds


@holds("renderer", "corrupt-step", "store")
def test_a_damaged_time_step_is_named_and_the_others_are_read(
    implementation: str, tmp_path: Path
) -> None:
    film = np.random.default_rng(1).integers(0, 4000, (3, 20, 18, 22)).astype(np.uint16)
    np.save(tmp_path / "film.npy", film)
    ingest(tmp_path / "film.npy", tmp_path / "film.zarr", codec=None, brick=16, axes="tzyx")
    with open_volume(tmp_path / "film.zarr") as volume:
        stored = volume.stored_brick(0, (0, 0, 0), t=1)
    assert stored is not None
    (shard,) = (
        path
        for path in (tmp_path / "film.zarr" / "0").rglob("*")
        if path.is_file() and stored in path.read_bytes()
    )
    content = bytearray(shard.read_bytes())
    content[content.index(stored) + len(stored) // 2] ^= 0xFF
    shard.write_bytes(content)
    box = Box.of_shape((20, 18, 22))
    with open_volume(tmp_path / "film.zarr") as volume:
        with pytest.raises(CorruptBrickError) as caught:
            volume.read(0, box, t=1)
        assert caught.value.facts["brick"] == [1, 0, 0, 0, 0]
        for t in (0, 2):
            np.testing.assert_array_equal(volume.read(0, box, t=t), film[t])


@holds("renderer", "read-while-writing", "store")
def test_a_volume_that_is_written_anew_is_seen_old_or_new_and_never_mixed(
    implementation: str, tmp_path: Path
) -> None:
    """Whoever opens gets one of both wholes, or is told that there is none at this moment."""
    shape, done, problems = (20, 18, 22), threading.Event(), []
    whole: set[int] = set()

    def read() -> None:
        while not done.is_set():
            try:
                with open_volume(tmp_path / "v.zarr") as volume:
                    found = np.unique(volume.read(0, Box.of_shape(shape)))
            except OctobrickError:
                continue
            except Exception as error:  # what the test is about
                problems.append(error)
                continue
            if len(found) != 1:
                problems.append(AssertionError(f"a mixture of {found}"))
            whole.add(int(found[0]))

    def write(value: int) -> None:
        np.save(tmp_path / f"{value}.npy", np.full(shape, value, np.uint16))
        ingest(
            tmp_path / f"{value}.npy", tmp_path / "v.zarr", codec=None, brick=16, workers=1,
            overwrite=True,
        )  # fmt: skip

    write(1)
    readers = [threading.Thread(target=read) for _ in range(2)]
    for reader in readers:
        reader.start()
    for value in (2, 3):
        write(value)
    done.set()
    for reader in readers:
        reader.join()
    assert not problems
    with open_volume(tmp_path / "v.zarr") as volume:
        assert int(volume.read(0, Box.of_shape(shape)).max()) == 3
    assert whole <= {1, 2, 3}
