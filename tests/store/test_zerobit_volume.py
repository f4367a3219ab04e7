"""Volumes of zerobit bricks: made, read, checked, mended, and safe from hostile bytes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import zarr
from hypothesis import given, settings
from hypothesis import strategies as st

from octobrick.codec import Zerobit
from octobrick.codec.errors import CorruptBrickError, InvalidInputError
from octobrick.store import Volume, ingest, open_volume
from octobrick.store import brick_codec as bc
from octobrick.store import frame as zstd_frame
from octobrick.store.repair import repair
from octobrick.store.sources import open_source
from octobrick.store.verify import verify
from octobrick.store.verify_source import verify_against

from .conftest import smooth

Ingested = Callable[..., Volume]
DTYPES = ["uint8", "int8", "uint16", "int16", "float32"]


@pytest.mark.parametrize("dtype", DTYPES)
def test_zarr_python_reads_every_level_as_we_do(ingested: Ingested, dtype: str) -> None:
    volume = ingested(smooth((37, 50, 41), dtype), codec=Zerobit(0.1), brick=16, shard=2)
    assert volume.codec == Zerobit(0.1)
    group = zarr.open_group(volume.path, mode="r")
    for level in volume.levels:
        array = group[str(level.index)]
        assert isinstance(array, zarr.Array)
        np.testing.assert_array_equal(array[0, 0], volume.read(level.index), strict=True)
        assert level.max_error > 0
    assert verify(volume.path).sound


def test_parameters_survive_in_the_attributes(ingested: Ingested) -> None:
    voxels = smooth((32, 32, 32), "uint8")
    codebook = Zerobit.train([voxels])
    codec = Zerobit(0.2, codebook, thresholds="block", background=7)
    volume = ingested(voxels, codec=codec, brick=16)
    assert volume.codec == codec
    assert "AAAA" not in repr(volume)  # nor is the codebook spelt out


def test_colours_are_bricks_of_a_channel_each(tmp_path: Path) -> None:
    voxels = np.stack([smooth((20, 20, 20), "uint8", seed) for seed in range(3)], axis=-1)
    np.save(tmp_path / "v.npy", voxels)
    ingest(tmp_path / "v.npy", tmp_path / "v.zarr", codec=Zerobit(0.3), brick=16, axes="zyxs")
    with open_volume(tmp_path / "v.zarr") as volume:
        assert volume.nc == 3
        assert volume.levels[0].psnr_db is not None
        assert volume.levels[0].psnr_db > 20
        assert verify(volume.path).sound


def test_a_background_outside_of_the_range_is_no_damage(ingested: Ingested) -> None:
    voxels = smooth((32, 32, 32), "uint8") // 2 + 100
    codec = Zerobit(0.01, count_averages=True, background=3)
    volume = ingested(voxels, codec=codec, brick=16)
    assert volume.read(0).min() == 3
    assert verify(volume.path).sound


def test_damage_is_found_and_mended(ingested: Ingested, tmp_path: Path) -> None:
    volume = ingested(smooth((40, 40, 40)), codec=Zerobit(), brick=16, shard=2)
    with open_source(tmp_path / "volume.npy") as source:
        assert verify_against(volume.path, source).sound
        shard = volume.path / "0/c/0/0/0/0/0"
        before = shard.read_bytes()
        shard.write_bytes(before[:100] + b"\x55" + before[101:])
        assert not verify(volume.path).sound
        repair(volume.path, source)
    assert shard.read_bytes() == before


@pytest.mark.parametrize("codec", [Zerobit(background=300), Zerobit(background=0.5)], ids=str)
def test_a_background_that_the_type_has_not_is_refused_before_anything_is_written(
    ingested: Ingested, tmp_path: Path, codec: Zerobit
) -> None:
    with pytest.raises(InvalidInputError, match="background"):
        ingested(smooth((8, 8, 8), "uint8"), codec=codec, brick=8)
    assert [path.name for path in tmp_path.iterdir()] == ["volume.npy"]


def test_a_codebook_of_another_type_is_refused_before_anything_is_written(
    ingested: Ingested, tmp_path: Path
) -> None:
    codebook = Zerobit.train([smooth((16, 16, 16), "uint16")])
    with pytest.raises(InvalidInputError, match="codebook"):
        ingested(smooth((8, 8, 8), "uint8"), codec=Zerobit(0.1, codebook), brick=8)
    assert [path.name for path in tmp_path.iterdir()] == ["volume.npy"]


def test_labels_are_not_coded_so(tmp_path: Path) -> None:
    np.save(tmp_path / "v.npy", smooth((8, 8, 8), "uint8"))
    with pytest.raises(InvalidInputError, match="labels are stored exactly, not by zerobit"):
        ingest(tmp_path / "v.npy", tmp_path / "v.zarr", codec=Zerobit(), labels=True, brick=8)


@settings(max_examples=30, deadline=None)
@given(
    dtype=st.sampled_from(DTYPES),
    shape=st.tuples(*[st.integers(1, 33)] * 3),
    ratio=st.sampled_from([0.0, 0.05, 1.0]),
    seed=st.integers(0, 99),
)
def test_no_code_is_longer_than_a_reader_allows(
    dtype: str, shape: tuple[int, int, int], ratio: float, seed: int
) -> None:
    bits = np.random.default_rng(seed).integers(0, 256, (*shape, np.dtype(dtype).itemsize))
    voxels = bits.astype(np.uint8).view(dtype)[..., 0]
    voxels = np.where(np.isfinite(voxels), voxels, 1).astype(dtype)
    codec = Zerobit(ratio)
    code = bc.encode(codec, voxels)
    assert len(code) <= bc.code_nbytes_max(codec, shape, np.dtype(dtype))


def test_a_frame_that_unpacks_to_more_than_a_code_is_refused(ingested: Ingested) -> None:
    volume = ingested(smooth((16, 16, 16)), codec=Zerobit(), brick=16)
    hostile = zstd_frame.compress(bytes(volume.code_nbytes_max(0) + 1), 3)
    with pytest.raises(CorruptBrickError, match="at most"):
        volume.decompressed(hostile, 0)
