"""npz: which array is chosen, and what is refused. That boxes are read right is in the contract."""

from __future__ import annotations

import zipfile

import numpy as np
import pytest

from octobrick.codec.errors import InvalidInputError
from octobrick.store.box import Box
from octobrick.store.errors import SourceError, TruncatedSourceError, UnsupportedSourceError
from octobrick.store.sources import gzip_stream, open_source


@pytest.fixture
def two(tmp_path, voxels):
    np.savez(tmp_path / "a.npz", one=voxels, two=voxels + 1)
    return tmp_path / "a.npz"


def read_all(source):
    return source.read(Box.of_shape(source.shape_zyx))


@pytest.mark.parametrize("name", ["two", "two.npy"])
def test_an_array_is_chosen_by_name(two, voxels, name):
    with open_source(two, dataset=name) as source:
        np.testing.assert_array_equal(read_all(source), voxels + 1)


@pytest.mark.parametrize(("name", "message"), [(None, "2 arrays: one, two"), ("x", "one, two")])
def test_no_name_or_a_wrong_one_is_refused_with_those_there_are(two, name, message):
    with pytest.raises(InvalidInputError, match=message):
        open_source(two, dataset=name)


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_axes_are_named_as_for_npy(tmp_path, voxels, save):
    save(tmp_path / "a.npz", np.stack([voxels, voxels + 1], axis=-1))
    with open_source(tmp_path / "a.npz", axes="zyxc") as source:
        np.testing.assert_array_equal(
            source.read_channels(Box.of_shape(source.shape_zyx)), [voxels, voxels + 1]
        )


def test_other_zip_archives_and_compressions_are_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("notes.txt", "no array")
    with pytest.raises(UnsupportedSourceError, match="without arrays"):
        open_source(tmp_path / "a.npz")
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_BZIP2) as archive:
        archive.writestr("a.npy", "whatever")
    with pytest.raises(UnsupportedSourceError, match="compression 12"):
        open_source(tmp_path / "a.npz")


def test_deflated_bytes_that_do_not_fit_the_checksum_of_the_directory_are_found(tmp_path, voxels):
    path = tmp_path / "a.npz"
    np.savez_compressed(path, voxels)
    content = bytearray(path.read_bytes())
    content[content.rindex(b"PK\x01\x02") + 16] ^= 1
    path.write_bytes(content)
    with open_source(path) as source, pytest.raises(SourceError, match="CRC-32"):
        read_all(source)


def test_an_array_that_goes_on_behind_its_member_is_refused(tmp_path, voxels):
    np.save(tmp_path / "a.npy", voxels)
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("a.npy", (tmp_path / "a.npy").read_bytes()[:-2])
        archive.writestr("z.txt", b"0" * 99)
    with pytest.raises(TruncatedSourceError, match=r"a\.npy ends after 246 of 248"):
        open_source(tmp_path / "a.npz")


def test_going_back_in_a_deflated_array_still_finds_the_checksum_right(tmp_path, monkeypatch):
    monkeypatch.setattr(gzip_stream, "_OUTPUT_NBYTES", 64)
    array = np.random.default_rng(1).integers(0, 9, (9, 16, 16), np.uint8)
    np.savez_compressed(tmp_path / "a.npz", array)
    with open_source(tmp_path / "a.npz") as source:
        for z in (8, 3, 5, 0, 8):
            plane = source.read(Box((z, 0, 0), (z + 1, 16, 16)))
            np.testing.assert_array_equal(plane[0], array[z])
