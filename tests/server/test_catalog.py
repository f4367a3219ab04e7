"""The catalog: what it finds, lends, replaces and survives."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from octobrick.codec.errors import CorruptBrickError, ResourceError
from octobrick.server.catalog import Catalog, OpenVolume
from octobrick.store import Volume, open_volume
from octobrick.store.errors import VolumeFormatError, VolumeNotFoundError


class Opener:
    """Opens volumes and remembers which were opened and closed."""

    def __init__(self) -> None:
        self.opened: list[Path] = []
        self.closed: list[str] = []

    def __call__(self, path: Path) -> Volume:
        self.opened.append(path)
        volume = open_volume(path)
        close = volume.close

        def note_and_close() -> None:
            self.closed.append(volume.revision)
            close()

        volume.close = note_and_close  # type: ignore[method-assign]
        return volume


@pytest.fixture
def opener() -> Opener:
    return Opener()


@pytest.fixture
def catalog(data_dir: Path, opener: Opener) -> Iterator[Catalog]:
    catalog = Catalog(data_dir, opener)
    yield catalog
    catalog.close()


def test_scan_finds_folders_with_good_names_and_opens_none(
    catalog: Catalog, opener: Opener
) -> None:
    assert catalog.scan() == ["exact", "head", "plain", "torn"]
    assert opener.opened == []


def test_a_volume_is_opened_once_for_many_borrowers(catalog: Catalog, opener: Opener) -> None:
    with catalog.borrow("head") as first, catalog.borrow("head") as second:
        assert first is second
    assert len(opener.opened) == 1
    assert opener.closed == []


def test_a_volume_that_appears_later_is_found(
    catalog: Catalog, data_dir: Path, volumes_template: Path
) -> None:
    catalog.scan()
    with pytest.raises(VolumeNotFoundError), catalog.borrow("late"):
        pass
    shutil.copytree(volumes_template / "head.zarr", data_dir / "late.zarr")
    with catalog.borrow("late") as lent:
        assert lent.volume.levels[0].shape_zyx == (40, 36, 50)


@pytest.mark.parametrize(
    "volume_id",
    [
        "",
        ".",
        "..",
        "../head",
        "head/../head",
        "head.zarr/..",
        "%2e%2e",
        "a\0b",
        "head\n",
        "a" * 129,
        "é",
    ],
)
def test_an_odd_id_reaches_no_file(catalog: Catalog, opener: Opener, volume_id: str) -> None:
    with (
        pytest.raises(VolumeNotFoundError, match="malformed") as caught,
        catalog.borrow(volume_id),
    ):
        pass
    assert opener.opened == []
    assert caught.value.facts == {"id_length": len(volume_id)}


def test_a_replaced_volume_is_opened_anew_and_the_old_one_closed_by_its_last_borrower(
    catalog: Catalog, opener: Opener, replace_volume: Callable[[str], None]
) -> None:
    with catalog.borrow("head") as old:
        before = old.volume.stored_brick(0, (1, 1, 1))
        replace_volume("head")
        assert not old.is_current()
        with catalog.borrow("head") as new:
            assert new.volume.revision != old.volume.revision
        assert opener.closed == []
        assert old.volume.stored_brick(0, (1, 1, 1)) == before
    assert opener.closed == [old.volume.revision]


def test_a_removed_volume_is_closed_and_unknown(
    catalog: Catalog, opener: Opener, data_dir: Path
) -> None:
    with catalog.borrow("head") as lent:
        revision = lent.volume.revision
    shutil.rmtree(data_dir / "head.zarr")
    with pytest.raises(VolumeNotFoundError), catalog.borrow("head"):
        pass
    assert "head" not in catalog.scan()
    assert opener.closed == [revision]


def test_a_broken_volume_is_an_error_until_it_is_repaired(
    catalog: Catalog, data_dir: Path, volumes_template: Path
) -> None:
    with pytest.raises(VolumeFormatError), catalog.borrow("torn"):
        pass
    shutil.rmtree(data_dir / "torn.zarr")
    shutil.copytree(volumes_template / "exact.zarr", data_dir / "torn.zarr")
    with catalog.borrow("torn") as lent:
        assert lent.volume.codec is None


def test_reading_begins_again_when_the_volume_was_replaced_meanwhile(
    catalog: Catalog, replace_volume: Callable[[str], None]
) -> None:
    """Else the new volume's bytes could go out, and be cached, under the old revision."""
    revisions = []

    def use(lent: OpenVolume) -> str:
        revisions.append(lent.volume.revision)
        if len(revisions) == 1:
            replace_volume("head")
            raise CorruptBrickError("the shard changed under our hands")
        return lent.volume.revision

    assert catalog.read("head", use) == revisions[1] != revisions[0]


def test_real_damage_is_not_read_again(catalog: Catalog) -> None:
    calls = []

    def use(_: OpenVolume) -> None:
        calls.append(1)
        raise CorruptBrickError("checksum mismatch")

    with pytest.raises(CorruptBrickError):
        catalog.read("head", use)
    assert calls == [1]


def test_closing_waits_for_borrowers(catalog: Catalog, opener: Opener) -> None:
    with catalog.borrow("head") as lent:
        catalog.close()
        assert opener.closed == []
        assert lent.volume.stored_brick(0, (1, 1, 1))
    assert len(opener.closed) == 1


def test_unknown_ids_do_not_list_a_folder_that_did_not_change(
    data_dir: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    os.utime(data_dir, (1e9, 1e9))  # long ago
    catalog = Catalog(data_dir)
    listed: list[object] = []
    scandir = os.scandir

    def counted(path: Any = ".") -> Any:
        if path == data_dir:
            listed.append(path)
        return scandir(path)

    monkeypatch.setattr(os, "scandir", counted)
    catalog.scan()
    for volume_id in ("nothing", "of", "these"):
        with pytest.raises(VolumeNotFoundError), catalog.borrow(volume_id):
            pass
    assert len(listed) == 1
    shutil.copytree(data_dir / "head.zarr", data_dir / "new.zarr")
    with catalog.borrow("new"), catalog.borrow("head"):
        assert len(listed) == 2
    monkeypatch.setattr("octobrick.server.catalog._RESCAN_SECONDS", 0)
    with pytest.raises(VolumeNotFoundError), catalog.borrow("nothing"):
        pass
    assert len(listed) == 3
    catalog.close()


def test_listed_volumes_are_lent_with_those_of_the_folder_and_before_them(
    data_dir: Path, tmp_path: Path
) -> None:
    other = tmp_path / "elsewhere"
    shutil.copytree(data_dir / "exact.zarr", other)
    catalog = Catalog(data_dir, listed={"head": other, "gone": tmp_path / "nothing"})
    assert {"exact", "gone", "head", "torn"} <= set(catalog.scan())
    with catalog.borrow("head") as lent, catalog.borrow("exact") as exact:
        assert lent.volume.path == other
        assert lent.volume.revision == exact.volume.revision
    with pytest.raises(VolumeNotFoundError), catalog.borrow("gone"):
        pass
    alone = Catalog(None, listed={"head": other})
    assert alone.scan() == ["head"]
    with pytest.raises(VolumeNotFoundError), alone.borrow("exact"):
        pass
    for each in (catalog, alone):
        each.close()


def test_a_folder_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(ResourceError, match="nowhere"):
        Catalog(tmp_path / "nowhere").scan()


def test_a_volume_that_the_system_refuses_to_read_is_an_error_of_ours(data_dir: Path) -> None:
    def refuse(path: Path) -> Volume:
        raise PermissionError(13, "Permission denied", str(path))

    catalog = Catalog(data_dir, refuse)
    with pytest.raises(ResourceError, match="Permission denied"), catalog.borrow("head"):
        pass
