"""Every kind of damage is found and named; repair brings back the bytes that were there."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from octobrick.codec.errors import CorruptDataError
from octobrick.store import ingest, open_volume
from octobrick.store.errors import SourceMismatchError
from octobrick.store.repair import repair
from octobrick.store.sources import open_source
from octobrick.store.verify import verify
from octobrick.store.verify_source import verify_against

from .conftest import smooth
from .test_resume import digests


@pytest.fixture
def source(tmp_path: Path) -> Path:
    voxels = smooth((70, 50, 60), "uint16")
    voxels[:32, :32, :32] = 0  # an absent brick
    np.save(tmp_path / "v.npy", voxels)
    return tmp_path / "v.npy"


@pytest.fixture
def volume(source: Path, tmp_path: Path) -> Path:
    ingest(source, tmp_path / "v.zarr", brick=16, shard=2, gradients=True)
    return tmp_path / "v.zarr"


def flip(path: Path, at: int) -> None:
    content = bytearray(path.read_bytes())
    content[at] ^= 0x10
    path.write_bytes(content)


def test_a_sound_volume_has_no_problems_with_and_without_its_source(
    volume: Path, source: Path
) -> None:
    assert verify(volume).sound
    with open_source(source) as opened:
        report = verify_against(volume, opened)
    assert report.sound
    assert report.against_source
    grids = [np.prod(level.grid_zyx) for level in open_volume(volume).levels]
    assert report.bricks == sum(grids) + sum(grids[1:])  # of voxels, and of gradients
    assert report.shards == len(open_volume(volume).shard_entries)


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-7])


Damage = Callable[[Path], None]
SHARD = "0/c/0/0/2/1/1"
GRADIENTS = "gradient/1/c/0/0/1/0/0/0"


DAMAGES: dict[str, tuple[Damage, str, set[str]]] = {
    "bit in a brick": (lambda v: flip(v / SHARD, 40), SHARD, {"shard", "brick"}),
    "bit in an index": (lambda v: flip(v / SHARD, -9), SHARD, {"shard", "brick"}),
    "cut": (
        lambda v: cut(v / SHARD),
        SHARD,
        {"shard", "brick"},
    ),
    "missing": (lambda v: (v / SHARD).unlink(), SHARD, {"shard", "brick"}),
    "of another place": (
        lambda v: shutil.copy(v / "0/c/0/0/1/1/0", v / SHARD),
        SHARD,
        {"shard", "brick", "range"},
    ),
    "gradients": (lambda v: flip(v / GRADIENTS, 40), GRADIENTS, {"shard", "brick"}),
    "missing gradients": (lambda v: (v / GRADIENTS).unlink(), GRADIENTS, {"shard", "brick"}),
    "coarse level": (lambda v: flip(v / "1/c/0/0/0/0/0", 40), "1/c/0/0/0/0/0", {"shard", "brick"}),
}


@pytest.mark.parametrize("name", DAMAGES)
def test_damage_to_a_shard_is_named_and_repaired_to_the_same_bytes(
    volume: Path, source: Path, name: str
) -> None:
    before = digests(volume)
    damage, path, kinds = DAMAGES[name]
    damage(volume)
    problems = verify(volume).problems
    assert {p.path for p in problems} == {path}
    assert {p.kind for p in problems} <= kinds
    assert "shard" in {p.kind for p in problems}
    with open_source(source) as opened:
        result = repair(volume, opened)
    assert (result.repaired, result.removed, result.left) == ((path,), (), ())
    assert digests(volume) == before
    assert verify(volume).sound


def test_files_of_nobody_are_named_and_removed(volume: Path, source: Path) -> None:
    before = digests(volume)
    (volume / "0/c/0/0/2/1/7").write_bytes(b"mine")
    (volume / f"{SHARD}.part").write_bytes(b"half")
    assert {p.kind for p in verify(volume).problems} == {"stray"}
    with open_source(source) as opened:
        assert len(repair(volume, opened).removed) == 2
    assert digests(volume) == before


def test_a_damaged_table_of_ranges_is_named_and_left_to_a_new_ingest(
    volume: Path, source: Path
) -> None:
    chunk = next(path for path in (volume / "range" / "0" / "c").rglob("*") if path.is_file())
    flip(chunk, 12)
    (problem,) = verify(volume).problems
    assert (problem.kind, problem.path) == ("range", "range/0")
    with open_source(source) as opened:
        assert repair(volume, opened).left == (problem,)


def test_ranges_that_do_not_hold_the_voxels_are_found(
    volume: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from octobrick.store.volume import Volume

    ranges = Volume.ranges

    def narrow(self: Volume, level: int, t: int = 0, c: int = 0) -> np.ndarray:
        table = ranges(self, level, t, c).copy()
        if level == 0:
            table[2, 2, 2, 1] -= 1
        return table

    monkeypatch.setattr(Volume, "ranges", narrow)
    assert {(p.kind, p.brick) for p in verify(volume).problems} == {("range", (0, 0, 2, 2, 2))}


def test_damaged_metadata_are_an_error_that_says_what_to_do(volume: Path) -> None:
    flip(volume / "manifest.json", 30)
    with pytest.raises(CorruptDataError, match="ingest"):
        verify(volume)


def test_a_changed_voxel_of_the_source_is_found_in_all_levels(
    volume: Path, source: Path, tmp_path: Path
) -> None:
    voxels = np.load(source)
    voxels[40:44, 40:44, 40:44] = 65535
    np.save(tmp_path / "w.npy", voxels)
    with open_source(tmp_path / "w.npy") as opened:
        problems = verify_against(volume, opened).problems
    assert {p.level for p in problems if p.kind == "voxels"} == {0, 1, 2, 3}
    assert (0, 0, 2, 2, 2) in {p.brick for p in problems if p.kind == "range"}


@pytest.mark.parametrize("what", ["shape", "dtype"])
def test_a_source_of_another_shape_or_type_is_refused(
    volume: Path, source: Path, tmp_path: Path, what: str
) -> None:
    voxels = np.load(source)
    np.save(tmp_path / "w.npy", voxels[:-1] if what == "shape" else voxels.astype(np.int16))
    with open_source(tmp_path / "w.npy") as opened, pytest.raises(SourceMismatchError):
        verify_against(volume, opened)


def test_repair_from_another_source_changes_nothing(
    volume: Path, source: Path, tmp_path: Path
) -> None:
    flip(volume / SHARD, 40)
    damaged = digests(volume)
    np.save(tmp_path / "w.npy", np.load(source) + 1)
    with open_source(tmp_path / "w.npy") as opened, pytest.raises(SourceMismatchError, match=SHARD):
        repair(volume, opened)
    assert digests(volume) == damaged


def test_a_converted_region_is_compared_with_the_whole_source(tmp_path: Path) -> None:
    from octobrick.store import Box

    voxels = smooth((40, 50, 60), "uint16").astype(np.int32) * 3 - 500
    np.save(tmp_path / "v.npy", voxels)
    region = Box((3, 4, 5), (30, 40, 50))
    options = {"brick": 16, "region": region, "convert": "uint8", "window": (0.0, 3000.0)}
    ingest(tmp_path / "v.npy", tmp_path / "v.zarr", **options)  # type: ignore[arg-type]
    with open_source(tmp_path / "v.npy") as opened:
        assert verify_against(tmp_path / "v.zarr", opened).sound
