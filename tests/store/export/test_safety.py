"""What an export refuses, and what it leaves when it fails: nothing."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from octobrick.codec.errors import CorruptBrickError, InvalidInputError
from octobrick.store import Box, Progress, Volume
from octobrick.store.errors import (
    DestinationError,
    DestinationExistsError,
    VolumeNotFoundError,
)
from octobrick.store.export import export, npy

from .conftest import steps

Lossless = Callable[..., Volume]
SHAPE = (40, 30, 20)
ALL = ("v.npy", "v.nrrd", "v.nii", "v.nii.gz", "v.tif", "v.ome.zarr")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    path = tmp_path / "out"
    path.mkdir()
    return path


@pytest.fixture
def volume(lossless: Lossless) -> Volume:
    return lossless(steps(SHAPE))


@pytest.mark.parametrize("name", ALL)
def test_a_damaged_brick_leaves_nothing(folder: Path, volume: Volume, name: str) -> None:
    shard = max(p for p in (volume.path / "0").rglob("c/**/*") if p.is_file())
    content = bytearray(shard.read_bytes())
    content[len(content) // 3] ^= 0xFF
    shard.write_bytes(content)
    with pytest.raises(CorruptBrickError, match="damaged"):
        export(volume, folder / name)
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("name", ALL)
def test_an_interrupt_leaves_nothing_and_keeps_what_was_there(
    folder: Path, volume: Volume, name: str
) -> None:
    def stop(_: Progress) -> None:
        assert [path.name for path in folder.iterdir() if path.name == name] == [name]
        raise KeyboardInterrupt

    export(volume, folder / name, level=1)
    before = _content(folder / name)
    with pytest.raises(KeyboardInterrupt):
        export(volume, folder / name, overwrite=True, progress=stop)
    assert [path.name for path in folder.iterdir()] == [name]
    assert _content(folder / name) == before


@pytest.mark.parametrize("name", ALL)
def test_what_is_there_is_replaced_only_when_asked(folder: Path, volume: Volume, name: str) -> None:
    export(volume, folder / name, level=1)
    before = _content(folder / name)
    with pytest.raises(DestinationExistsError, match="--overwrite"):
        export(volume, folder / name)
    assert _content(folder / name) == before
    export(volume, folder / name, overwrite=True)
    assert _content(folder / name) != before
    assert [path.name for path in folder.iterdir()] == [name]


@pytest.mark.parametrize("name", ALL)
def test_something_of_another_kind_is_never_replaced(
    folder: Path, volume: Volume, name: str
) -> None:
    out = folder / name
    if name.endswith(".zarr"):
        out.write_text("precious")
    else:
        out.mkdir()
    with pytest.raises(DestinationExistsError, match="remove it yourself"):
        export(volume, out, overwrite=True)
    assert [path.name for path in folder.iterdir()] == [name]


def test_what_appears_meanwhile_is_not_replaced(folder: Path, volume: Volume) -> None:
    def appear(_: Progress) -> None:
        (folder / "v.npy").write_text("precious")

    with pytest.raises(DestinationExistsError, match="already exists"):
        export(volume, folder / "v.npy", progress=appear)
    assert (folder / "v.npy").read_text() == "precious"
    assert len(list(folder.iterdir())) == 1


def test_a_file_system_without_hard_links_is_written_to(
    folder: Path, volume: Volume, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(errno.EPERM, "no hard links")

    monkeypatch.setattr(os, "link", refuse)
    export(volume, folder / "v.npy")
    assert np.load(folder / "v.npy").shape == SHAPE


def test_no_space_is_told_and_leaves_nothing(
    folder: Path, volume: Volume, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(npy, "write_voxels", fail)
    with pytest.raises(DestinationError, match="free some space"):
        export(volume, folder / "v.npy")
    assert list(folder.iterdir()) == []


def test_files_have_the_permissions_of_any_other(folder: Path, volume: Volume) -> None:
    (folder / "plain").touch()
    (folder / "plain.d").mkdir()
    export(volume, folder / "v.npy")
    export(volume, folder / "v.ome.zarr")
    assert (folder / "v.npy").stat().st_mode == (folder / "plain").stat().st_mode
    assert (folder / "v.ome.zarr").stat().st_mode == (folder / "plain.d").stat().st_mode


@pytest.mark.parametrize("name", ["", "/inside.npy"])
def test_a_volume_is_not_exported_onto_itself(volume: Volume, name: str) -> None:
    with pytest.raises(InvalidInputError, match="the volume that is exported"):
        export(volume, f"{volume.path}{name}", overwrite=True)
    assert volume.read(0).shape == SHAPE


@pytest.mark.parametrize(
    ("name", "options", "word"),
    [
        ("v.xyz", {}, r"\.ome\.zarr"),
        ("v", {}, r"\.nrrd"),
        ("v.npy", {"level": 9}, "level 9"),
        ("v.npy", {"level": -1}, "level -1"),
        ("v.npy", {"box": Box((0, 0, 0), (41, 1, 1))}, "leaves"),
        ("v.npy", {"box": Box((3, 0, 0), (3, 1, 1))}, "empty"),
        ("v.npy", {"t": 1}, "time step 1"),
        ("v.ome.zarr", {"c": -1}, "channel -1"),
        ("v.npy", {"workers": 0}, "workers 0"),
        ("v.nii", {"compress": True}, r"\.nii\.gz"),
    ],
)
def test_wrong_arguments_are_told(
    folder: Path, volume: Volume, name: str, options: dict[str, object], word: str
) -> None:
    with pytest.raises(InvalidInputError, match=word):
        export(volume, folder / name, **options)  # type: ignore[arg-type]
    assert list(folder.iterdir()) == []


def test_a_volume_that_is_not_there_is_told(folder: Path) -> None:
    with pytest.raises(VolumeNotFoundError):
        export(folder / "no.zarr", folder / "v.npy")


def test_a_folder_that_is_not_there_is_told(folder: Path, volume: Volume) -> None:
    for name in ("v.npy", "v.ome.zarr"):
        with pytest.raises(DestinationError, match="folder that exists"):
            export(volume, folder / "no" / name)


def _content(path: Path) -> dict[str, bytes]:
    if path.is_file():
        return {path.name: path.read_bytes()}
    return {str(p.relative_to(path)): p.read_bytes() for p in path.rglob("*") if p.is_file()}
