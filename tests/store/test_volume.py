from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from octobrick.codec.errors import CorruptBrickError, InvalidInputError, OctobrickError
from octobrick.store import Box, Volume, open_volume
from octobrick.store.errors import VolumeFormatError, VolumeNotFoundError
from octobrick.store.shard import slot_of

from .conftest import smooth

Ingested = Callable[..., Volume]
SHAPE = (37, 50, 41)


@pytest.fixture
def volume(ingested: Ingested) -> Volume:
    return ingested(smooth(SHAPE), brick=16, shard=2)


boxes = st.tuples(
    *(st.tuples(st.integers(0, n - 1), st.integers(1, n)).map(sorted) for n in SHAPE)
).filter(lambda axes: all(a < b for a, b in axes))


@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(axes=boxes)
def test_reading_a_box_equals_cutting_it_from_the_level(
    volume: Volume, axes: list[list[int]]
) -> None:
    (z0, z1), (y0, y1), (x0, x1) = axes
    whole = volume.read(0)
    part = volume.read(0, Box((z0, y0, x0), (z1, y1, x1)))
    np.testing.assert_array_equal(part, whole[z0:z1, y0:y1, x0:x1])


def test_many_threads_read_the_same_bricks(volume: Volume) -> None:
    bricks = [tuple(b) for b in np.ndindex(*volume.level(0).grid_zyx)] * 3
    with ThreadPoolExecutor(8) as pool:
        read = list(pool.map(lambda b: volume.brick(0, b), bricks))
    for zyx, brick in zip(bricks, read, strict=True):
        np.testing.assert_array_equal(brick, volume.brick(0, zyx))


@pytest.mark.parametrize(
    "box", [((0, 0, 0), (38, 1, 1)), ((-1, 0, 0), (1, 1, 1)), ((5, 5, 5), (5, 6, 6))]
)
def test_a_box_outside_the_level_or_empty_is_refused(
    volume: Volume, box: tuple[tuple[int, int, int], tuple[int, int, int]]
) -> None:
    with pytest.raises(InvalidInputError, match="box"):
        volume.read(0, Box(*box))


@pytest.mark.parametrize(
    ("level", "zyx", "t", "c"),
    [(3, (0, 0, 0), 0, 0), (-1, (0, 0, 0), 0, 0), (0, (3, 0, 0), 0, 0), (0, (0, -1, 0), 0, 0),
     (0, (0, 0, 0), 1, 0), (0, (0, 0, 0), 0, -1)],
)  # fmt: skip
def test_a_brick_that_does_not_exist_is_refused_with_what_does(
    volume: Volume, level: int, zyx: tuple[int, int, int], t: int, c: int
) -> None:
    with pytest.raises(InvalidInputError, match="level"):
        volume.stored_brick(level, zyx, t, c)


def test_a_damaged_brick_is_named_and_all_others_still_read(volume: Volume) -> None:
    path = volume.path / "0" / "c/0/0/0/0/0"
    shard = bytearray(path.read_bytes())
    index = np.frombuffer(shard[-8 * 16 - 4 : -4], "<u8").reshape(8, 2)
    offset, nbytes = (int(n) for n in index[slot_of((0, 1, 1), (2, 2, 2))])
    shard[offset + nbytes // 2] ^= 0x10
    path.write_bytes(shard)
    with pytest.raises(CorruptBrickError) as caught:
        volume.brick(0, (0, 1, 1))
    assert str(path) in caught.value.message
    assert "(0, 0, 0, 1, 1)" in caught.value.message
    assert caught.value.facts["brick"] == [0, 0, 0, 1, 1]
    others = [b for b in np.ndindex(*volume.level(0).grid_zyx) if b != (0, 1, 1)]
    assert all(volume.brick(0, b).shape == (16, 16, 16) for b in others)


def test_a_path_without_a_volume_says_so(tmp_path: Path) -> None:
    with pytest.raises(VolumeNotFoundError, match="no such volume"):
        open_volume(tmp_path / "none.zarr")
    (tmp_path / "folder").mkdir()
    with pytest.raises(VolumeFormatError, match="no volume of octobrick"):
        open_volume(tmp_path / "folder")
    (tmp_path / "file").write_text("x")
    with pytest.raises(VolumeFormatError):
        open_volume(tmp_path / "file")


def edited(volume: Volume, change: Callable[[dict[str, object]], object]) -> None:
    file = volume.path / "zarr.json"
    root = json.loads(file.read_text())
    change(root["attributes"]["octobrick"])
    file.write_text(json.dumps(root))


def test_attributes_that_do_not_match_the_revision_are_damage(volume: Volume) -> None:
    edited(volume, lambda fields: fields.update(window=[0, 1]))
    with pytest.raises(VolumeFormatError, match="revision"):
        open_volume(volume.path)


def test_a_manifest_that_does_not_match_the_revision_is_damage(volume: Volume) -> None:
    file = volume.path / "manifest.json"
    file.write_text(file.read_text().replace('"nbytes": ', '"nbytes": 1', 1))
    with pytest.raises(VolumeFormatError, match="revision"):
        open_volume(volume.path)


def test_another_format_version_says_to_install_another_octobrick(volume: Volume) -> None:
    edited(volume, lambda fields: fields.update(version=2))
    with pytest.raises(VolumeFormatError, match=r"version 2.*install"):
        open_volume(volume.path)


json_values = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**70), 2**70) | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=6,
)


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_hostile_attributes_are_refused_by_name_and_never_crash(
    volume: Volume, data: st.DataObject
) -> None:
    file = volume.path / "zarr.json"
    original = file.read_text()
    root = json.loads(original)
    field = data.draw(st.sampled_from(sorted(root["attributes"]["octobrick"])))
    value = data.draw(json_values)
    if value == root["attributes"]["octobrick"][field]:
        return
    root["attributes"]["octobrick"][field] = value
    try:
        file.write_text(json.dumps(root))
        with pytest.raises(OctobrickError):
            open_volume(volume.path)
    finally:
        file.write_text(original)


def test_damaged_ranges_are_named(volume: Volume) -> None:
    (volume.path / "range" / "0" / "zarr.json").write_text("{}")
    with pytest.raises(VolumeFormatError, match="range"):
        volume.ranges(0)


def test_metadata_is_json_and_tells_levels_codec_and_revision(volume: Volume) -> None:
    metadata = json.loads(json.dumps(volume.metadata(), allow_nan=False))
    assert metadata["revision"] == volume.revision
    assert metadata["codec"]["name"] == "octobrick.s3dc"
    assert metadata["levels"][0]["grid"] == [3, 4, 3]
    assert metadata["levels"][1]["translation"] == [0.5, 0.5, 0.5]


def test_sizes_of_stored_bricks_come_from_the_indexes_in_any_order(ingested: Ingested) -> None:
    voxels = smooth(SHAPE)
    voxels[:16, :16, :16] = 0
    volume = ingested(voxels, brick=16, shard=2)
    bricks = np.argwhere(np.ones(volume.levels[0].grid_zyx, bool))
    bricks = np.random.default_rng(5).permutation(bricks)
    bricks = np.concatenate([bricks, bricks[:3]])
    sizes = volume.stored_nbytes(0, bricks)
    frames = [volume.stored_brick(0, (z, y, x)) or b"" for z, y, x in bricks.tolist()]
    assert sizes.tolist() == [len(frame) for frame in frames]
    assert 0 in sizes
    assert volume.stored_nbytes(0, np.empty((0, 3), np.intp)).shape == (0,)
    with pytest.raises(InvalidInputError):
        volume.stored_nbytes(0, np.array([[0, 0, 0], [0, 99, 0]]))


def test_attributes_are_those_of_the_metadata(volume: Volume) -> None:
    written = json.loads((volume.path / "zarr.json").read_text())["attributes"]["octobrick"]
    assert json.loads(json.dumps(volume.attributes())) == written
