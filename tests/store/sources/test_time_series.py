"""Patterns of files as time steps: order, what must be alike, and how many are open."""

from __future__ import annotations

import sys
import threading
from pathlib import Path

import nibabel
import nrrd
import numpy as np
import pytest
import tifffile

from octobrick.codec.errors import InvalidInputError
from octobrick.store.box import Box
from octobrick.store.errors import (
    SourceError,
    SourceNotFoundError,
    TruncatedSourceError,
    UnsupportedSourceError,
)
from octobrick.store.sources import open_source
from octobrick.store.sources.base import Source

DATA = Path(__file__).resolve().parents[4] / "shared" / "data"


def steps(*shape: int) -> np.ndarray:
    return np.random.default_rng(4).integers(0, 60000, shape).astype(np.uint16)


def write_npy(folder: Path, voxels: np.ndarray) -> Path:
    for t, step in enumerate(voxels):
        np.save(folder / f"t{t + 8}.npy", step)
    return folder / "t*.npy"


def write_nrrd(folder: Path, voxels: np.ndarray) -> Path:
    for t, step in enumerate(voxels):
        header = {"spacings": [0.5, 0.75, 2.5], "encoding": "gzip"}
        nrrd.write(str(folder / f"t{t + 8}.nrrd"), step.T, header)
    return folder / "t?*.nrrd"


def write_tiff(folder: Path, voxels: np.ndarray) -> Path:
    for t, step in enumerate(voxels):
        how = {"photometric": "minisblack", "compression": "zlib"}
        tifffile.imwrite(folder / f"t{t + 8}.tif", step, **how)
    return folder / "t*.tif"


@pytest.mark.parametrize("write", [write_npy, write_nrrd, write_tiff])
def test_steps_of_any_format_in_natural_order(tmp_path, write):
    voxels = steps(5, 3, 6, 7)
    with open_source(write(tmp_path, voxels)) as source:
        assert source.nt == 5
        assert source.shape_zyx == (3, 6, 7)
        assert source.format.endswith(" time series")
        numbers = [int(file.stem[1:]) for file in source.files]
        assert numbers == [8, 9, 10, 11, 12]
        box = Box((1, 2, 3), (3, 5, 7))
        for t in (4, 0, 3, 1, 2, 4):
            np.testing.assert_array_equal(source.read(box, t), voxels[t][box.slices])
            np.testing.assert_array_equal(source.read_channels(box, t)[0], voxels[t][box.slices])
        with pytest.raises(InvalidInputError, match="no time step 5"):
            source.read(box, 5)


def test_spacing_of_the_steps_is_kept_and_may_be_corrected(tmp_path):
    pattern = write_nrrd(tmp_path, steps(2, 3, 6, 7))
    with open_source(pattern) as source:
        assert source.spacing_zyx == (2.5, 0.75, 0.5)
    with open_source(pattern, spacing_zyx=(3, 2, 1)) as source:
        assert source.spacing_zyx == (3, 2, 1)


def test_raw_steps_are_described_once(tmp_path):
    voxels = steps(3, 3, 6, 7)
    for t, step in enumerate(voxels):
        (tmp_path / f"{t}.raw").write_bytes(step.tobytes())
    with open_source(tmp_path / "*.raw", shape_zyx=(3, 6, 7), dtype="uint16") as source:
        np.testing.assert_array_equal(source.read(Box.of_shape((3, 6, 7)), 2), voxels[2])


@pytest.mark.parametrize(
    ("step", "message"),
    [
        (np.zeros((3, 6, 8), np.uint16), r"\(3, 6, 8\) voxels.*t8\.npy has \(3, 6, 7\)"),
        (np.zeros((3, 6, 7), np.int16), r"1 int16,.*t8\.npy has .* 1 uint16,"),
    ],
    ids=["shape", "type"],
)
def test_step_unlike_the_first_is_named(tmp_path, step, message):
    pattern = write_npy(tmp_path, steps(3, 3, 6, 7))
    np.save(tmp_path / "t99.npy", step)
    with pytest.raises(SourceError, match=rf"t99\.npy: has .*{message}"):
        open_source(pattern)


def test_step_of_another_spacing_is_named(tmp_path):
    pattern = write_nrrd(tmp_path, steps(3, 3, 6, 7))
    nrrd.write(str(tmp_path / "t99.nrrd"), steps(3, 6, 7).T, {"spacings": [1, 0.75, 2.5]})
    with pytest.raises(SourceError, match=r"t99\.nrrd: has .*2\.5, 0\.75, 1 .*2\.5, 0\.75, 0\.5"):
        open_source(pattern)


def test_step_of_another_rescale_is_named(tmp_path):
    for t in range(2):
        image = nibabel.Nifti1Image(steps(3, 6, 7).T, np.eye(4))
        image.header.set_slope_inter(t + 1, 0)
        nibabel.save(image, tmp_path / f"{t}.nii")
    with pytest.raises(SourceError, match=r"1\.nii: has .*rescaled by \(2\.0, 0\.0\)"):
        open_source(tmp_path / "*.nii")


def test_damaged_step_is_named(tmp_path):
    pattern = write_npy(tmp_path, steps(3, 3, 6, 7))
    path = tmp_path / "t9.npy"
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(TruncatedSourceError, match=r"t9\.npy"):
        open_source(pattern)


def test_file_of_no_format_among_the_steps_is_named(tmp_path):
    write_npy(tmp_path, steps(2, 3, 6, 7))
    (tmp_path / "t9.txt").write_text("notes")
    with pytest.raises(UnsupportedSourceError, match=r"t9\.txt"):
        open_source(tmp_path / "t*")


def test_file_of_several_steps_among_the_steps_is_refused(tmp_path):
    for t in range(2):
        metadata = {"axes": "TZYX"}
        tifffile.imwrite(tmp_path / f"{t}.ome.tif", steps(2, 3, 6, 7), metadata=metadata)
    with pytest.raises(UnsupportedSourceError, match="2 time steps of its own"):
        open_source(tmp_path / "*.tif")


def test_step_that_changes_or_goes_is_refused(tmp_path):
    box = Box.of_shape((3, 6, 7))
    with open_source(write_npy(tmp_path, steps(3, 3, 6, 7))) as source:
        np.save(tmp_path / "t9.npy", np.zeros((3, 6, 8), np.uint16))
        (tmp_path / "t10.npy").unlink()
        source.read(box, 0)
        with pytest.raises(SourceError, match="now, but"):
            source.read(box, 1)
        with pytest.raises(SourceNotFoundError, match=r"t10\.npy"):
            source.read(box, 2)


def test_few_files_are_open_and_none_afterwards(tmp_path):
    descriptors = Path("/proc/self/fd")
    before = len(list(descriptors.iterdir()))
    voxels = steps(30, 3, 6, 7)
    with open_source(write_npy(tmp_path, voxels)) as source:
        for t in range(30):
            source.read(Box((0, 0, 0), (1, 6, 7)), t)
            assert len(list(descriptors.iterdir())) <= before + 4
    assert len(list(descriptors.iterdir())) == before


def test_threads_read_steps_of_their_own(tmp_path):
    voxels = steps(12, 3, 6, 7)
    wrong: list[int] = []

    def read(source, order):
        box = Box.of_shape((3, 6, 7))
        wrong.extend(t for t in order if not np.array_equal(source.read(box, t), voxels[t]))

    with open_source(write_nrrd(tmp_path, voxels)) as source:
        orders = [list(range(12)) * 3, list(reversed(range(12))) * 3, [5] * 36]
        threads = [threading.Thread(target=read, args=(source, order)) for order in orders]
        interval = sys.getswitchinterval()
        sys.setswitchinterval(1e-6)  # a hundred times as many ways to meet
        try:
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
        finally:
            sys.setswitchinterval(interval)
    assert wrong == []


def test_steps_are_read_while_one_that_was_idle_is_in_use(tmp_path, monkeypatch):
    voxels = steps(7, 3, 6, 7)
    box = Box.of_shape((3, 6, 7))
    with open_source(write_npy(tmp_path, voxels)) as source:
        source.read(box, 0)
        read, meanwhile = Source.read, list(range(1, 7))

        def read_and_be_overtaken(step, box, t=0, c=0):
            while meanwhile and step is not source:
                other = meanwhile.pop()
                np.testing.assert_array_equal(read(source, box, other), voxels[other])
            return read(step, box, t, c)

        monkeypatch.setattr(Source, "read", read_and_be_overtaken)
        np.testing.assert_array_equal(source.read(box, 0), voxels[0])
        assert meanwhile == []


@pytest.mark.shared
@pytest.mark.skipif(not DATA.is_dir(), reason="no real volumes beside the checkout")
def test_real_steps_equal_each_file_on_its_own():
    folder = DATA / "tv_viscous_run01"
    box = Box((10, 0, 0), (20, 64, 64))
    with open_source(folder / "*.raw.gz") as source:
        assert (source.nt, source.dtype) == (9, np.float32)
        for t in range(9):
            with open_source(folder / f"t{t + 1:02}0.raw.gz") as step:
                np.testing.assert_array_equal(source.read(box, t), step.read(box))
