"""Zarr and OME-Zarr: what is found, what it says of itself, and what is refused."""

from __future__ import annotations

import os
import shutil

import numpy as np
import pytest
import zarr

from octobrick.codec.errors import InvalidInputError
from octobrick.store.box import Box
from octobrick.store.errors import SourceError, SourceNotFoundError, UnsupportedSourceError
from octobrick.store.sources import open_source
from octobrick.store.sources.base import Channel

from .writers_arrays import multiscales


@pytest.fixture(params=[2, 3])
def image(request, tmp_path):
    """An image of two levels, time and channels; 0.4 in Zarr 2 and 0.5 in Zarr 3."""
    group = zarr.create_group(tmp_path / "a.ome.zarr", zarr_format=request.param)
    array = np.random.default_rng(5).integers(0, 999, (2, 2, 3, 8, 10), np.uint16)
    levels = (array, array[..., ::2, ::2])
    for level, voxels in enumerate(levels):
        chunks = (1, 1, 1, 4, 5)
        made = group.create_array(str(level), shape=voxels.shape, dtype=voxels.dtype, chunks=chunks)
        made[:] = voxels
    described = multiscales("tczyx", ["0", "1"], (5, 1, 2.5, 0.5, 0.5), "0.4")
    for axis in described[0]["axes"][2:]:
        axis["unit"] = "micrometer"
    described[0]["datasets"][0]["coordinateTransformations"].append(
        {"type": "translation", "translation": [0, 0, 30, 20, 10]}
    )
    omero = {"channels": [{"label": "DAPI", "color": "0000FF"}, {"color": "no"}]}
    ome = {"multiscales": described, "omero": omero}
    group.attrs.update(ome if request.param == 2 else {"ome": ome | {"version": "0.5"}})
    return tmp_path / "a.ome.zarr", levels


def read_all(source, t=0, c=0):
    return source.read(Box.of_shape(source.shape_zyx), t, c)


def test_an_image_says_all_of_itself(image):
    path, (array, _) = image
    with open_source(path) as source:
        assert (source.format, source.nt, source.nc) == ("ome-zarr", 2, 2)
        assert source.shape_zyx == (3, 8, 10)
        assert source.chunk_zyx == (1, 4, 5)
        assert source.spacing_zyx == (2.5, 0.5, 0.5)
        assert source.origin_xyz == (10, 20, 30)
        assert source.unit == "micrometer"
        assert source.channels == (Channel("DAPI", "0000ff"), Channel())
        assert not source.labels
        assert source.warnings == ()
        np.testing.assert_array_equal(read_all(source, 1, 1), array[1, 1])
        box = Box((1, 2, 3), (3, 7, 9))
        np.testing.assert_array_equal(source.read_channels(box, 1), array[(1, ..., *box.slices)])


def test_another_level_has_its_own_scale(image):
    path, (_, half) = image
    with open_source(path, dataset="1") as source:
        assert source.spacing_zyx == (5, 1, 1)
        np.testing.assert_array_equal(read_all(source), half[0, 0])


def test_named_axes_are_not_to_be_given(image):
    with pytest.raises(InvalidInputError, match="its axes are tczyx"):
        open_source(image[0], axes="ctzyx")


@pytest.mark.parametrize("dataset", ["7", "../a.ome.zarr/0", "0/0"])
def test_a_dataset_that_is_not_there_is_refused(image, dataset):
    with pytest.raises((InvalidInputError, SourceError), match=r"a\.ome\.zarr"):
        open_source(image[0], dataset=dataset)


def test_label_images_are_labels_and_found_below_the_image(image):
    path, (array, _) = image
    group = zarr.open_group(path).create_group("labels/cells")
    made = group.create_array("0", shape=(3, 8, 10), dtype="uint32", chunks=(3, 8, 10))
    made[:] = array[0, 0]
    ome = {"multiscales": multiscales("zyx", ["0"], (1, 1, 1), None), "image-label": {}}
    group.attrs.update({"ome": ome})
    with open_source(path, dataset="labels/cells") as source:
        assert source.labels
        np.testing.assert_array_equal(read_all(source), array[0, 0])


def test_a_plane_has_z_of_one(tmp_path):
    group = zarr.create_group(tmp_path / "a.zarr")
    group.create_array("s", shape=(4, 5), dtype="uint8", chunks=(4, 5))[:] = 7
    group.attrs["ome"] = {"multiscales": multiscales("yx", ["s"], (3, 2), None)}
    with open_source(tmp_path / "a.zarr") as source:
        assert source.shape_zyx == (1, 4, 5)
        assert source.spacing_zyx == (1, 3, 2)
        assert (read_all(source) == 7).all()


def test_a_folder_is_known_by_what_is_in_it(tmp_path, voxels):
    zarr.save_array(tmp_path / "a.zarr", voxels)
    shutil.move(tmp_path / "a.zarr", tmp_path / "plain")
    with open_source(tmp_path / "plain") as source:
        assert source.format == "zarr"
        np.testing.assert_array_equal(read_all(source), voxels)


def test_axes_of_a_plain_array_come_from_its_dimension_names(tmp_path, voxels):
    array = zarr.create_array(
        tmp_path / "a.zarr", shape=(5, 4, 3), dtype="u2", dimension_names=["x", "y", "z"]
    )
    array[:] = voxels.T
    with open_source(tmp_path / "a.zarr") as source:
        np.testing.assert_array_equal(read_all(source), voxels)


def test_chunks_of_shards_are_those_inside(tmp_path):
    zarr.create_array(
        tmp_path / "a.zarr", shape=(8, 8, 8), dtype="u1", chunks=(2, 4, 4), shards=(8, 8, 8)
    )
    with open_source(tmp_path / "a.zarr") as source:
        assert source.chunk_zyx == (2, 4, 4)


@pytest.mark.parametrize("box", [(8, 8, 8), (4, 8, 8)], ids=["whole-shard", "part"])
def test_blosc_in_shards_that_is_longer_than_its_chunk_is_refused(tmp_path, box):
    array = zarr.create_array(
        tmp_path / "a.zarr",
        shape=(8, 8, 8),
        dtype="u2",
        chunks=(4, 8, 8),
        shards=(8, 8, 8),
        compressors=zarr.codecs.BloscCodec(),
    )
    voxels = np.random.default_rng(3).integers(0, 999, (8, 8, 8), np.uint16)
    array[:] = voxels
    shard = next(path for path in (tmp_path / "a.zarr" / "c").rglob("*") if path.is_file())
    with open_source(tmp_path / "a.zarr") as source:
        np.testing.assert_array_equal(read_all(source), voxels)
    content = bytearray(shard.read_bytes())
    content[12:16] = (10**6).to_bytes(4, "little")
    shard.write_bytes(content)
    with (
        open_source(tmp_path / "a.zarr") as source,
        pytest.raises(SourceError, match=r"\d+ bytes, its blosc header says 1000000"),
    ):
        source.read(Box((0, 0, 0), box))


def test_a_group_of_several_arrays_asks_for_one(tmp_path, voxels):
    group = zarr.create_group(tmp_path / "a.zarr")
    for name in ("one", "two"):
        group.create_array(name, data=voxels)
    with pytest.raises(InvalidInputError, match=r"one \[3, 4, 5\], two \[3, 4, 5\].*--dataset"):
        open_source(tmp_path / "a.zarr")
    with open_source(tmp_path / "a.zarr", dataset="two") as source:
        np.testing.assert_array_equal(read_all(source), voxels)


def test_an_empty_group_and_an_empty_folder_are_refused(tmp_path):
    zarr.create_group(tmp_path / "a.zarr")
    with pytest.raises(UnsupportedSourceError, match="group without arrays"):
        open_source(tmp_path / "a.zarr")
    (tmp_path / "b.zarr").mkdir()
    with pytest.raises(SourceNotFoundError, match=r"no Zarr array or group is here"):
        open_source(tmp_path / "b.zarr")


def test_a_file_with_the_name_of_a_folder_is_refused(tmp_path):
    (tmp_path / "a.zarr").write_bytes(b"x")
    with pytest.raises(UnsupportedSourceError, match="is no folder"):
        open_source(tmp_path / "a.zarr")


def test_chunks_that_are_not_there_are_the_fill_value(tmp_path):
    zarr.create_array(tmp_path / "a.zarr", shape=(4, 4, 4), dtype="i2", fill_value=-3)
    with open_source(tmp_path / "a.zarr") as source:
        assert (read_all(source) == -3).all()


def test_the_fingerprint_tells_of_a_chunk_that_has_changed(image):
    path, _ = image
    with open_source(path) as source:
        before = source.fingerprint()
        assert before == source.fingerprint()
        chunk = max(p for p in (path / "0").rglob("*") if p.is_file() and p.stat().st_size)
        os.utime(chunk, ns=(1, 1))
        assert source.fingerprint() != before


@pytest.mark.parametrize(
    "change",
    [
        {"axes": [{"name": "q"}]},
        {"axes": "zyx"},
        {"datasets": [{"path": "../.."}]},
        {"datasets": [{}]},
        {"datasets": []},
        {"coordinateTransformations": [{"type": "scale", "scale": [1, 2]}]},
        {"coordinateTransformations": [{"type": "scale", "scale": ["a"] * 3}]},
    ],
)
def test_attributes_that_are_not_as_specified_are_refused(tmp_path, voxels, change):
    group = zarr.create_group(tmp_path / "a.zarr")
    group.create_array("0", data=voxels)
    described = multiscales("zyx", ["0"], (1, 1, 1), None)[0]
    if change.get("axes") == "zyx":  # of version 0.3: as good as a list
        change = {"axes": 7}
    group.attrs["ome"] = {"multiscales": [described | change]}
    with pytest.raises((SourceError, InvalidInputError), match=r"a\.zarr"):
        open_source(tmp_path / "a.zarr")


def test_names_without_transformations_and_foreign_ones_leave_a_note(tmp_path, voxels):
    group = zarr.create_group(tmp_path / "a.zarr")
    group.create_array("0", data=voxels)
    described = multiscales("zyx", ["0"], (1, 1, 1), None)[0]
    described["coordinateTransformations"] = [{"type": "rotation", "rotation": [1]}]
    group.attrs["ome"] = {"multiscales": [described, described]}
    with open_source(tmp_path / "a.zarr") as source:
        assert "rotation" in source.warnings[1]
        assert "2 multiscale images" in source.warnings[0]
