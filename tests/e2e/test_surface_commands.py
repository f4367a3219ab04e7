"""The commands `ingest --surface` and `render --surface` make a solid texture and show it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from PIL import Image

from octobrick.server.cli import main
from octobrick.store import open_volume

pytestmark = pytest.mark.gl

TETRAHEDRON = "v 0 0 0\nv 2 0 0\nv 0 2 0\nv 0 0 2\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


def run(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("surface")
    colours = np.zeros((32, 32, 32, 3), np.uint8)
    colours[..., 0] = 200
    colours[..., 2] = 50
    np.save(path / "red.npy", colours)
    (path / "mesh.obj").write_text(TETRAHEDRON)
    (path / "other.obj").write_text(TETRAHEDRON.replace("2 0 0", "1 0 0"))
    made = run(
        *("ingest", path / "red.npy", path / "red.zarr", "--axes", "zyxs", "--codec", "zerobit"),
        *("--surface", path / "mesh.obj", "--surface-up", "y", "--brick", 16, "--quiet"),
    )
    assert made.exit_code == 0, made.stderr
    return path


def test_the_volume_keeps_where_the_mesh_lies_and_the_picture_has_its_colour(folder: Path) -> None:
    with open_volume(folder / "red.zarr") as volume:
        assert volume.surface is not None
        assert volume.surface.name == "mesh.obj"
    picture = folder / "p.png"
    shown = run(
        *("render", folder / "red.zarr", "--surface", folder / "mesh.obj", "-o", picture),
        *("--size", "60x50", "--no-shading", "--surface-sampling", "nearest", "--stats"),
    )
    assert shown.exit_code == 0, shown.stderr
    assert shown.stderr == ""
    pixels = np.asarray(Image.open(picture).convert("RGB")).reshape(-1, 3)
    inside = pixels[pixels[:, 0] == 200]
    assert len(inside) > 300
    assert set(map(tuple, inside.tolist())) == {(200, 0, 50)}
    assert json.loads(shown.stdout)["stats"]["bricks"]["sampled"] > 0


def test_another_mesh_than_the_volumes_is_said(folder: Path) -> None:
    shown = run(
        *("render", folder / "red.zarr", "--surface", folder / "other.obj"),
        *("-o", folder / "other.png", "--size", "20x20"),
    )
    assert shown.exit_code == 0, shown.stderr
    assert "another surface than other.obj" in shown.stderr


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--mode", "mip"), "mode: is that of rays"),
        (("--depth", "d.npy"), "depth"),
        (("--surface-placement", "1,2,3"), "12 numbers"),
        (("--surface-placement", ",".join("0" * 12)), "span space"),
    ],
    ids=lambda value: value[0],
)
def test_options_that_a_surface_has_no_use_for_are_refused(
    folder: Path, options: tuple[str, ...], message: str
) -> None:
    shown = run(
        *("render", folder / "red.zarr", "--surface", folder / "mesh.obj"),
        *("-o", folder / "refused.png", *options),
    )
    assert shown.exit_code == 2
    assert message in shown.stderr
    assert not (folder / "refused.png").exists()


def test_a_damaged_mesh_is_named_by_both_commands(folder: Path) -> None:
    bad = folder / "bad.ply"
    bad.write_text("ply\nformat ascii 1.0\nelement face 1000000000\nend_header\n")
    for command in (
        ("ingest", folder / "red.npy", folder / "bad.zarr", "--axes", "zyxs"),
        ("render", folder / "red.zarr", "-o", folder / "bad.png"),
    ):
        result = run(*command, "--surface", bad)
        assert result.exit_code == 1
        assert "bad.ply: its header announces 1000000000 of face" in result.stderr
