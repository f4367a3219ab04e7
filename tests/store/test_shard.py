from __future__ import annotations

from pathlib import Path

import google_crc32c
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from octobrick.codec.errors import CorruptBrickError
from octobrick.store.errors import VolumeFormatError
from octobrick.store.shard import ShardCache, ShardReader, ShardWriter, shard_key, slot_of

FRAMES = {5: b"five", 0: b"zero", 7: b"", 3: b"three" * 100}


def write_shard(path: Path) -> tuple[int, str]:
    writer = ShardWriter(path, nslots=8)
    for slot, frame in FRAMES.items():
        writer.append(slot, frame)
    return writer.finish()


def test_a_shard_gives_back_its_bricks_and_none_for_absent_ones(tmp_path: Path) -> None:
    write_shard(tmp_path / "shard")
    reader = ShardReader(tmp_path / "shard", nslots=8)
    assert {slot: reader.read(slot) for slot in range(8)} == {
        slot: FRAMES.get(slot) for slot in range(8)
    }


def test_nothing_is_visible_under_the_shards_name_before_it_is_finished(tmp_path: Path) -> None:
    writer = ShardWriter(tmp_path / "shard", nslots=8)
    writer.append(0, b"zero")
    assert not (tmp_path / "shard").exists()
    nbytes, _ = writer.finish()
    assert [p.name for p in tmp_path.iterdir()] == ["shard"]
    assert (tmp_path / "shard").stat().st_size == nbytes


def test_the_digest_names_the_content(tmp_path: Path) -> None:
    assert write_shard(tmp_path / "a") == write_shard(tmp_path / "b")


def test_a_damaged_index_names_the_file_and_both_checksums(tmp_path: Path) -> None:
    path = tmp_path / "shard"
    write_shard(path)
    damaged = bytearray(path.read_bytes())
    damaged[-20] ^= 1
    path.write_bytes(damaged)
    index = bytes(damaged[-8 * 16 - 4 : -4])
    with pytest.raises(VolumeFormatError, match="checksum") as caught:
        ShardReader(path, nslots=8)
    assert str(path) in caught.value.message
    assert f"{google_crc32c.value(index):08x}" in caught.value.message
    assert damaged[-4:][::-1].hex() in caught.value.message


def test_an_index_that_points_outside_the_file_is_refused(tmp_path: Path) -> None:
    for offset, nbytes in [(0, 1000), (2**63, 1), (10, 2**64 - 2), (2**64 - 2, 3)]:
        index = np.full((8, 2), 2**64 - 1, "<u8")
        index[2] = (offset, nbytes)
        crc = google_crc32c.value(index.tobytes()).to_bytes(4, "little")
        path = tmp_path / "shard"
        path.write_bytes(b"x" * 20 + index.tobytes() + crc)
        with pytest.raises(VolumeFormatError, match="outside"):
            ShardReader(path, nslots=8)


@given(cut=st.integers(0, 8 * 16 + 3))
def test_a_file_too_short_for_its_index_is_refused(
    tmp_path_factory: pytest.TempPathFactory, cut: int
) -> None:
    path = tmp_path_factory.mktemp("shard") / "shard"
    path.write_bytes(bytes(cut))
    with pytest.raises(VolumeFormatError, match="too few"):
        ShardReader(path, nslots=8)


def test_a_shard_cut_short_while_open_is_a_corrupt_brick(tmp_path: Path) -> None:
    path = tmp_path / "shard"
    write_shard(path)
    reader = ShardReader(path, nslots=8)
    with path.open("r+b") as file:
        file.truncate(6)
    with pytest.raises(CorruptBrickError, match="of 500 bytes"):
        reader.read(3)


def test_a_listed_shard_that_is_missing_or_cut_is_damage_and_an_unlisted_one_is_absent(
    tmp_path: Path,
) -> None:
    nbytes, _ = write_shard(tmp_path / shard_key((0, 0, 0), (2, 2, 2), 0, 0))
    listed = {"c/0/0/0/0/0": nbytes, "c/0/0/0/0/1": 10}
    cache = ShardCache(tmp_path, (2, 2, 2), listed)
    assert cache.read((1, 0, 1), 0, 0) == b"five"
    assert cache.read((9, 9, 9), 0, 0) is None
    with pytest.raises(VolumeFormatError, match="missing"):
        cache.read((0, 0, 2), 0, 0)
    cut = ShardCache(tmp_path, (2, 2, 2), {"c/0/0/0/0/0": nbytes + 1})
    with pytest.raises(VolumeFormatError, match=f"has {nbytes} bytes"):
        cut.read((0, 0, 0), 0, 0)


def test_slots_run_z_slowest_x_fastest_within_the_shard() -> None:
    assert slot_of((4, 4, 5), (4, 4, 4)) == 1
    assert slot_of((4, 5, 4), (4, 4, 4)) == 4
    assert slot_of((5, 4, 4), (4, 4, 4)) == 16
    assert shard_key((7, 8, 3), (4, 4, 4), 2, 1) == "c/2/1/1/2/0"
