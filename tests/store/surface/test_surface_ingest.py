"""A volume made for a surface holds what the surface touches, says so, and nothing else."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from octobrick.codec import S3dc, Zerobit
from octobrick.codec.errors import InvalidInputError, UnsupportedError
from octobrick.store import Mesh, Placement, ingest, open_volume
from octobrick.store.errors import VolumeFormatError
from octobrick.store.sources import open_source
from octobrick.store.surface.selection import voxel_places
from octobrick.store.verify import verify
from octobrick.store.verify_source import verify_against

SHAPE = (40, 48, 52)
BRICK = 16


@pytest.fixture(scope="module")
def octahedron() -> Mesh:
    corners = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
    faces = [[a, b, c] for a in (0, 1) for b in (2, 3) for c in (4, 5)]
    return Mesh(corners, np.array(faces), name="octahedron")


@pytest.fixture(scope="module")
def colours() -> NDArray[np.uint8]:
    """(c, z, y, x), never 0, so that what is kept shows."""
    axes = np.meshgrid(*(np.arange(n) for n in SHAPE), indexing="ij")
    return (np.stack(axes[::-1]) * 4 + 30).astype(np.uint8)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, colours: NDArray[np.uint8]) -> Path:
    path = tmp_path_factory.mktemp("surface")
    np.save(path / "colours.npy", colours)
    return path


def make(folder: Path, name: str, **options: Any) -> Path:
    options = {"codec": None, "brick": BRICK, "axes": "czyx", "workers": 1} | options
    ingest(folder / "colours.npy", folder / name, **options)
    return folder / name


@pytest.fixture(scope="module")
def exact(folder: Path, octahedron: Mesh) -> Path:
    return make(folder, "exact.zarr", surface=octahedron)


def test_what_the_surface_touches_is_exact_and_all_else_is_0(
    exact: Path, folder: Path, octahedron: Mesh
) -> None:
    whole = make(folder, "whole.zarr")
    rng = np.random.default_rng(2)
    with open_volume(exact) as volume, open_volume(whole) as original:
        assert volume.surface is not None
        for level in range(len(volume.levels)):
            places = voxel_places(octahedron, volume.surface.placement, (1, 1, 1), level)
            weights = rng.dirichlet([0.7] * 3, (8, 2000))
            points = (weights @ places[octahedron.faces]).reshape(-1, 3)
            needed = np.floor(points + rng.uniform(-0.5, 0.5, points.shape)).astype(int)
            last = np.array(volume.levels[level].shape_zyx) - 1
            at = tuple(np.clip(needed, 0, last).T)
            for c in range(3):
                kept, voxels = volume.read(level, c=c), original.read(level, c=c)
                np.testing.assert_array_equal(kept[at], voxels[at])
                assert set(np.unique(kept[kept != voxels])) <= {0}
                cells = np.add.reduceat(
                    np.add.reduceat(
                        np.add.reduceat((kept > 0).astype(int), range(0, last[0] + 1, 4), 0),
                        range(0, last[1] + 1, 4),
                        1,
                    ),
                    range(0, last[2] + 1, 4),
                    2,
                )
                assert np.count_nonzero(cells) == volume.surface.ncells[level]
        assert volume.brick_code(0, (0, 0, 3)) is None  # beyond it


def test_null_cells_cost_nothing_and_details_are_those_of_kept_cells(
    folder: Path, octahedron: Mesh, colours: NDArray[np.uint8]
) -> None:
    path = make(folder, "zerobit.zarr", codec=Zerobit(0.1), surface=octahedron, brick=64, levels=1)
    with open_volume(path) as volume:
        code = volume.brick_code(0, (0, 0, 0), c=2)
        assert code is not None
        assert volume.surface is not None
        stats = Zerobit().stats(code)
        assert stats.cells == volume.surface.ncells[0]
        assert stats.background == (0.0,)
        assert stats.details <= 0.2 * 64 * stats.cells
        kept = volume.read(0, c=2)
        level = volume.levels[0]
        errors = np.abs(kept[kept > 0].astype(int) - colours[2][kept > 0])
        assert errors.max() <= level.max_error < 30


@pytest.mark.parametrize("codec", [None, Zerobit(0.05)], ids=["lossless", "zerobit"])
def test_verify_finds_nothing_wrong(folder: Path, octahedron: Mesh, codec: Any) -> None:
    path = make(folder, f"verify-{codec is None}.zarr", codec=codec, surface=octahedron)
    assert verify(path).problems == ()


def test_the_same_surface_gives_the_same_bytes_and_another_place_another_revision(
    exact: Path, folder: Path, octahedron: Mesh
) -> None:
    again = make(folder, "again.zarr", surface=octahedron, workers=2)
    moved = make(
        folder,
        "moved.zarr",
        surface=octahedron,
        surface_placement=Placement.of_numbers((9, 0, 0, 20, 0, 9, 0, 20, 0, 0, 9, 20)),
    )
    with open_volume(exact) as a, open_volume(again) as b, open_volume(moved) as c:
        assert a.revision == b.revision != c.revision


def test_by_default_the_mesh_is_fitted_in_and_turned(folder: Path) -> None:
    slab = Mesh(np.array([[0, 0, 0], [8, 0, 0], [0, 4, 2.0]]), np.array([[0, 1, 2]]), name="slab")
    path = make(folder, "turned.zarr", surface=slab, surface_up="y")
    with open_volume(path) as volume:
        assert volume.surface is not None
        # The mesh's y is up: x, y and z of the world are its z, x and y.
        places = volume.surface.placement.places(slab.vertices_xyz)
    np.testing.assert_allclose(places.max(axis=0) - places.min(axis=0), [12, 48, 24])
    np.testing.assert_allclose((places.max(axis=0) + places.min(axis=0)) / 2, [25.5, 23.5, 19.5])


def test_a_surface_that_sticks_out_is_said(folder: Path, octahedron: Mesh) -> None:
    result = ingest(
        folder / "colours.npy",
        folder / "out.zarr",
        codec=None,
        brick=BRICK,
        axes="czyx",
        surface=octahedron,
        surface_placement=Placement.of_numbers((30, 0, 0, 25, 0, 9, 0, 20, 0, 0, 9, 20)),
    )
    assert any("33.3% of the surface's vertices lie outside" in text for text in result.warnings)


FAR = Placement.of_numbers((9, 0, 0, 999, 0, 9, 0, 20, 0, 0, 9, 20))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"codec": S3dc()}, "choose zerobit"),
        ({"codec": Zerobit(background=7)}, "background"),
        ({"brick": 10}, "multiple of 4"),
        ({"gradients": True}, "gradients"),
        ({"codec": Zerobit(), "psnr": 40}, "whole volumes"),
        ({"surface_placement": FAR}, "does not touch"),
        ({"surface_up": "w"}, "x, y, z"),
    ],
    ids=str,
)
def test_what_does_not_go_with_a_surface_is_refused(
    folder: Path, octahedron: Mesh, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InvalidInputError, match=message):
        make(folder, "refused.zarr", surface=octahedron, **options)
    assert not (folder / "refused.zarr").exists()


def test_a_point_cannot_be_fitted_and_a_placement_needs_a_surface(folder: Path) -> None:
    point = Mesh(np.ones((3, 3)), np.array([[0, 1, 2]]))
    with pytest.raises(InvalidInputError, match="nothing to fit"):
        make(folder, "refused.zarr", surface=point)
    with pytest.raises(InvalidInputError, match="give one"):
        make(folder, "refused.zarr", surface_placement=FAR)
    with pytest.raises(InvalidInputError, match="span"):
        Placement.of_numbers((1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0))


def test_its_source_cannot_tell_what_is_missing(exact: Path, folder: Path) -> None:
    with (
        open_source(folder / "colours.npy", axes="czyx") as source,
        pytest.raises(UnsupportedError, match="octahedron"),
    ):
        verify_against(exact, source)


@pytest.mark.parametrize(
    "change",
    [
        {"placement": [[1, 0, 0, 0]] * 3},
        {"placement": [[1, 0, 0, 1e999], [0, 1, 0, 0], [0, 0, 1, 0]]},
        {"cells": [-1]},
        {"name": 7},
    ],
    ids=str,
)
def test_attributes_that_make_no_sense_are_refused(
    exact: Path, tmp_path: Path, change: dict[str, Any]
) -> None:
    document = json.loads((exact / "zarr.json").read_text())
    document["attributes"]["octobrick"]["surface"] |= change
    (tmp_path / "zarr.json").write_text(json.dumps(document))
    (tmp_path / "manifest.json").write_bytes((exact / "manifest.json").read_bytes())
    with pytest.raises(VolumeFormatError):
        open_volume(tmp_path)
