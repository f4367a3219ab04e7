"""Where the first voxel lies, in LPS, from the headers that say it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import nibabel
import nrrd
import numpy as np
import pytest

from octobrick.store.sources import open_source

VOXELS = np.zeros((3, 4, 5), np.uint8)


def origin_of(path: Path) -> Any:
    with open_source(path) as source:
        return source.origin_xyz, source.warnings


@pytest.mark.parametrize("form", ["sform", "qform"])
def test_nifti_is_turned_from_ras(tmp_path: Path, form: str) -> None:
    affine = np.diag([2.0, 2, 2, 1])
    affine[:3, 3] = (10.5, -20, 30)
    image = nibabel.Nifti1Image(VOXELS, affine)
    image.set_sform(affine, int(form == "sform"))
    image.set_qform(affine, int(form == "qform"))
    nibabel.save(image, tmp_path / "v.nii")
    assert origin_of(tmp_path / "v.nii") == ((-10.5, 20.0, 30.0), ())


def test_nifti_without_an_affine_has_none(tmp_path: Path) -> None:
    nibabel.save(nibabel.Nifti1Image(VOXELS, None), tmp_path / "v.nii")
    assert origin_of(tmp_path / "v.nii") == ((0.0, 0.0, 0.0), ())


@pytest.mark.parametrize(
    ("space", "signs"),
    [
        ("left-posterior-superior", (1, 1, 1)),
        ("right-anterior-superior", (-1, -1, 1)),
        ("LAS", (1, -1, 1)),
        (None, (1, 1, 1)),
    ],
)
def test_nrrd_is_turned_from_its_space(
    tmp_path: Path, space: str | None, signs: tuple[int, int, int]
) -> None:
    given = (10.5, -20.0, 30.0)
    header: dict[str, Any] = {"space directions": np.eye(3), "space origin": given}
    header |= {"space": space} if space else {"space dimension": 3}
    nrrd.write(str(tmp_path / "v.nrrd"), VOXELS, header)
    expected = tuple(sign * size for sign, size in zip(signs, given, strict=True))
    assert origin_of(tmp_path / "v.nrrd") == (expected, ())


@pytest.mark.parametrize("key", ["Offset", "Position", "Origin"])
def test_metaimage_is_in_lps(tmp_path: Path, key: str) -> None:
    path = tmp_path / "v.mha"
    _write_metaimage(path, f"{key} = 10.5 -20 30")
    assert origin_of(path) == ((10.5, -20.0, 30.0), ())


def test_what_is_no_position_is_noted(tmp_path: Path) -> None:
    path = tmp_path / "v.mha"
    _write_metaimage(path, "Offset = 1 nan 3")
    origin_xyz, (note,) = origin_of(path)
    assert origin_xyz == (0.0, 0.0, 0.0)
    assert "origin" in note


def _write_metaimage(path: Path, line: str) -> None:
    head = f"NDims = 3\nDimSize = 5 4 3\nElementType = MET_UCHAR\n{line}\nElementDataFile = LOCAL\n"
    path.write_bytes(head.encode() + VOXELS.tobytes())
