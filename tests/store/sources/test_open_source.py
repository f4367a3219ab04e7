"""How a file's format is found, and what is said of a file that has none."""

from __future__ import annotations

import gzip
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from octobrick.codec.errors import InvalidInputError, ResourceError
from octobrick.store.box import Box
from octobrick.store.errors import SourceError, SourceNotFoundError, UnsupportedSourceError
from octobrick.store.sources import open_source


def test_file_that_does_not_exist_is_named(tmp_path):
    with pytest.raises(SourceNotFoundError, match=r"gone\.nii: no such file"):
        open_source(tmp_path / "gone.nii")


def test_path_may_be_text(tmp_path, voxels):
    np.save(tmp_path / "a.npy", voxels)
    with open_source(str(tmp_path / "a.npy")) as source:
        assert source.shape_zyx == voxels.shape


def test_empty_folder_is_refused(tmp_path):
    with pytest.raises(SourceNotFoundError, match="holds no file"):
        open_source(tmp_path)


def test_pattern_that_matches_nothing_is_refused(tmp_path):
    with pytest.raises(SourceNotFoundError, match=r"t\*\.nii: the folder or pattern holds no file"):
        open_source(tmp_path / "t*.nii")


def test_folder_of_other_files_says_what_to_give(tmp_path, voxels):
    np.save(tmp_path / "a.npy", voxels)
    with pytest.raises(UnsupportedSourceError, match=r"a folder of 1 files.*\*\.npy"):
        open_source(tmp_path)


@pytest.mark.parametrize("marker", ["zarr.json", ".zgroup", ".zarray"])
def test_zarr_folder_without_metadata_in_its_files_is_an_error_of_the_source(tmp_path, marker):
    (tmp_path / marker).write_text("{}")
    with pytest.raises((UnsupportedSourceError, SourceError)):
        open_source(tmp_path)


def test_name_of_a_file_may_look_like_a_pattern(tmp_path, voxels):
    np.save(tmp_path / "a[1].npy", voxels)
    with open_source(tmp_path / "a[1].npy") as source:
        assert source.shape_zyx == voxels.shape


def test_pattern_of_one_file_is_that_file(tmp_path, voxels):
    np.save(tmp_path / "a1.npy", voxels)
    with open_source(tmp_path / "a?.npy") as source:
        assert source.path == tmp_path / "a1.npy"


def test_pipe_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "a.nii")
    with pytest.raises(UnsupportedSourceError, match="not a regular file"):
        open_source(tmp_path / "a.nii")


def test_file_that_may_not_be_opened_says_why(tmp_path, voxels, monkeypatch):
    np.save(tmp_path / "a.npy", voxels)

    def refuse(*args, **kwargs):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("pathlib.Path.open", refuse)
    with pytest.raises(ResourceError, match=r"a\.npy: cannot be read: Permission denied"):
        open_source(tmp_path / "a.npy")


@pytest.mark.parametrize("made", ["a.npy", "a.nrrd", "a.mha", "a.nii", "a.nii.gz"])
def test_format_is_found_without_its_suffix(tmp_path, voxels, made, request):
    writers = {writer.__name__: writer for writer in _writers(request)}
    by_name = {
        "a.npy": "npy_c_order",
        "a.nrrd": "nrrd_raw",
        "a.mha": "metaimage_local",
        "a.nii": "nifti1",
        "a.nii.gz": "nifti1_gzip",
    }
    writers[by_name[made]](tmp_path, voxels)
    other = tmp_path / ("b.gz" if made.endswith(".gz") else "b")
    shutil.copy(tmp_path / made, other)
    with open_source(other) as source:
        np.testing.assert_array_equal(source.read(Box.of_shape(source.shape_zyx)), voxels)


def _writers(request):
    return request.config.pluginmanager.get_plugin(str(request.path.parent / "conftest.py")).WRITERS


@pytest.mark.parametrize(
    ("name", "content", "format_name"),
    [
        ("a.raw.bz2", b"BZh9", "bzip2"),
    ],
)
def test_known_format_that_is_not_read_is_told_by_name(tmp_path, name, content, format_name):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(UnsupportedSourceError, match=rf"{format_name}.*those read are NIfTI"):
        open_source(tmp_path / name)


def test_unknown_format_lists_those_that_are_read(tmp_path):
    (tmp_path / "a.xyz").write_bytes(b"what is this")
    with pytest.raises(UnsupportedSourceError) as caught:
        open_source(tmp_path / "a.xyz")
    for word in ("NIfTI", "NRRD", "MetaImage", "npy", "--shape Z,Y,X --dtype uint16"):
        assert word in caught.value.message


def test_unknown_suffix_is_raw_once_it_is_described(tmp_path, voxels):
    (tmp_path / "a.xyz").write_bytes(voxels.tobytes())
    with open_source(tmp_path / "a.xyz", shape_zyx=(3, 4, 5), dtype="uint16") as source:
        np.testing.assert_array_equal(source.read(Box.of_shape(source.shape_zyx)), voxels)


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"shape_zyx": (3, 4, 5)}, "--shape"),
        ({"dtype": "uint16"}, "--dtype"),
        ({"offset_nbytes": 3}, "--offset"),
        ({"big_endian": True}, "--big-endian"),
    ],
)
def test_description_of_a_file_that_describes_itself_is_refused(tmp_path, voxels, options, named):
    np.save(tmp_path / "a.npy", voxels)
    with pytest.raises(InvalidInputError, match=f"describes itself; leave out {named}"):
        open_source(tmp_path / "a.npy", **options)


def test_raw_voxels_that_begin_like_gzip_are_not_taken_for_it(tmp_path):
    content = b"\x1f\x8b\x08" + bytes(range(24))
    (tmp_path / "a.raw").write_bytes(content)
    with open_source(tmp_path / "a.raw", shape_zyx=(3, 3, 3), dtype="uint8") as source:
        assert source.read(Box.of_shape((3, 3, 3))).tobytes() == content


def test_gzip_of_something_else_is_refused(tmp_path):
    (tmp_path / "a.txt.gz").write_bytes(gzip.compress(b"words"))
    with pytest.raises(UnsupportedSourceError, match="of no format that is read"):
        open_source(tmp_path / "a.txt.gz")


def test_no_source_is_left_open_by_a_refused_file(tmp_path, voxels):
    np.save(tmp_path / "a.npy", voxels)
    descriptors = Path("/proc/self/fd")
    before = len(list(descriptors.iterdir()))
    for _ in range(3):
        with pytest.raises(InvalidInputError):
            open_source(tmp_path / "a.npy", spacing_zyx=(0, 0, 0))
    assert len(list(descriptors.iterdir())) == before
