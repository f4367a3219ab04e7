"""Directions of gradients stored beside the levels."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import zarr

from octobrick.codec import gradients
from octobrick.codec.errors import InvalidInputError
from octobrick.store import Box, Volume, ingest, open_volume
from octobrick.store.window import SCRATCH_PREFIX

from .conftest import smooth
from .test_resume import digests

Ingested = Callable[..., Volume]


@pytest.mark.parametrize("dtype", ["uint8", "int16", "float32"])
def test_each_coarser_level_has_the_directions_of_reduced_gradients(
    tmp_path: Path, dtype: str
) -> None:
    voxels = smooth((50, 37, 70), dtype)
    np.save(tmp_path / "v.npy", voxels)
    spacing = (2.0, 0.5, 1.0)
    options = {"brick": 16, "shard": 2, "spacing": spacing, "gradients": True}
    result = ingest(tmp_path / "v.npy", tmp_path / "v.zarr", **options)
    field = gradients.central_differences(voxels, spacing)
    with open_volume(tmp_path / "v.zarr") as volume:
        stored = volume.gradients
        assert stored is not None
        assert stored.levels == tuple(range(1, len(volume.levels)))
        root = zarr.open_group(tmp_path / "v.zarr", mode="r")
        for level in stored.levels:
            field = gradients.reduce(field)
            codes = gradients.encode_directions(field)
            np.testing.assert_array_equal(stored.read(level), codes)
            np.testing.assert_array_equal(root[f"gradient/{level}"][0, 0], codes)
            z, y, x = volume.levels[level].shape_zyx
            box = Box((z // 3, y // 2, 0), (z, y // 2 + 1, max(x // 2, 1)))
            np.testing.assert_array_equal(stored.read(level, box), codes[box.slices])
            nbytes = sum(
                n
                for path, (n, _) in volume.shard_entries.items()
                if path.startswith(f"gradient/{level}/")
            )
            assert result.levels[level].gradient_nbytes == nbytes > 0
    assert result.levels[0].gradient_nbytes is None


def test_without_being_asked_for_there_are_none(ingested: Ingested) -> None:
    volume = ingested(smooth((20, 20, 20)), brick=8)
    assert volume.gradients is None
    assert not (volume.path / "gradient").exists()


def test_a_volume_of_one_level_says_that_it_has_none(tmp_path: Path) -> None:
    np.save(tmp_path / "v.npy", smooth((20, 20, 20)))
    result = ingest(tmp_path / "v.npy", tmp_path / "v.zarr", gradients=True)
    assert open_volume(tmp_path / "v.zarr").gradients is None
    assert ["no gradients" in warning for warning in result.warnings] == [True]


def test_flat_bricks_are_absent_and_have_no_direction(ingested: Ingested) -> None:
    voxels = np.zeros((32, 32, 64), np.uint8)
    voxels[:, :, 60] = 9
    volume = ingested(voxels, brick=8, shard=1, gradients=True)
    assert volume.gradients is not None
    assert volume.gradients.code(1, (0, 0, 0)) is None
    assert not gradients.decode_directions(volume.gradients.brick(1, (0, 0, 0))).any()
    found = gradients.decode_directions(volume.gradients.brick(1, (0, 0, 3)))
    assert found[0, 0, 5, 0] > 0.999
    constant = ingested(np.full((32, 32, 32), 7, np.uint8), "c", brick=8, gradients=True)
    assert not [path for path in constant.shard_entries if path.startswith("gradient")]
    assert constant.gradients is not None
    assert not gradients.decode_directions(constant.gradients.read(1)).any()


def test_a_level_or_brick_without_gradients_is_refused(ingested: Ingested) -> None:
    stored = ingested(smooth((20, 20, 20)), brick=8, gradients=True).gradients
    assert stored is not None
    with pytest.raises(InvalidInputError, match="level 0 has no gradients"):
        stored.read(0)
    with pytest.raises(InvalidInputError, match="no brick"):
        stored.brick(1, (0, 0, 2))


def test_memory_that_is_short_changes_no_byte(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("octobrick.store.piece_reader.READ_NBYTES", 7 * 2 * 20)  # seven rows
    np.save(tmp_path / "v.npy", smooth((40, 300, 20)))
    options = {"brick": 16, "shard": 2, "gradients": True}
    ingest(tmp_path / "v.npy", tmp_path / "v.zarr", **options)
    with pytest.raises(InvalidInputError, match=r"at least (\d+) bytes") as refused:
        ingest(tmp_path / "v.npy", tmp_path / "short" / "v.zarr", memory=1, **options)
    least = refused.value.facts["least_nbytes"]
    assert isinstance(least, int)
    scratch: list[int] = []
    ingest(
        tmp_path / "v.npy",
        tmp_path / "short" / "v.zarr",
        memory=least,
        checkpoint_seconds=0,
        progress=lambda _: scratch.append(open_scratch_files()),
        **options,
    )
    assert max(scratch) > 0
    assert digests(tmp_path / "short" / "v.zarr") == digests(tmp_path / "v.zarr")


def open_scratch_files() -> int:
    names = []
    for descriptor in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):  # that of the listing itself
            names.append(str(descriptor.readlink()))
    return sum(SCRATCH_PREFIX in name for name in names)
