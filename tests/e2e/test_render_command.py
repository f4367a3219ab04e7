"""`octobrick render`: its options reach the picture, and what goes wrong is said in one line."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result
from PIL import Image

from octobrick.renderer import TransferFunction
from octobrick.server.cli import main
from octobrick.server.views.view import View
from octobrick.store import ingest, open_volume

pytestmark = pytest.mark.gl


@pytest.fixture(scope="module")
def volume(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("volume")
    z, y, x = np.ogrid[-20:20, -24:24, -28:28]
    np.save(
        folder / "ball.npy",
        np.clip(2000 - 4 * (z * z + y * y + x * x), 0, None, dtype=int).astype(np.uint16),
    )
    ingest(folder / "ball.npy", folder / "ball.zarr", brick=32, workers=1)
    return folder / "ball.zarr"


@pytest.fixture
def render(volume: Path, tmp_path: Path) -> Callable[..., Result]:
    """Run the command on the ball, into p.png."""

    def run(*options: object) -> Result:
        arguments = ["render", volume, "-o", tmp_path / "p.png", "--size", "48x32", *options]
        return CliRunner().invoke(main, [str(argument) for argument in arguments])

    return run


@pytest.fixture
def pixels(render: Callable[..., Result], tmp_path: Path) -> Callable[..., Any]:
    """The picture that options give."""

    def run(*options: object) -> Any:
        result = render(*options)
        assert result.exit_code == 0, result.stderr
        return np.asarray(Image.open(tmp_path / "p.png"))

    return run


def test_it_says_what_it_wrote(render: Callable[..., Result], tmp_path: Path) -> None:
    result = render("--preset", "mr", "--level", 0)
    assert result.exit_code == 0, result.stderr
    assert f"{tmp_path / 'p.png'}: 48×32 pixels, level 0, max error" in result.stdout


def test_stats_are_json(render: Callable[..., Result]) -> None:
    report = json.loads(render("--preset", "mr", "--level", 0, "--stats").stdout)
    assert report["fidelity"]["converged"] is True
    assert report["stats"]["bricks"]["total"] == 8


@pytest.mark.parametrize(
    "options",
    [
        ("--no-shading",),
        ("--projection", "orthographic"),
        ("--window", "500,1500"),
        ("--distance", 80),
        ("--fov", 50, "--distance", 150),
        ("--level", 1),
        ("--background", "#336699"),
        ("--step", 3),
        ("--mode", "mip"),
        ("--mode", "minip"),
        ("--mode", "average"),
        ("--mode", "isosurface", "--iso", 1000),
        ("--mode", "isosurface", "--iso", 1000, "--iso-opacity", 0.3),
        ("--mode", "slice"),
        ("--mode", "slice", "--slice-normal", "1,1,0", "--slice-point", "28,24,9"),
        ("--clip-box", ",,20,,,"),
        ("--clip-plane", "0,0,1,-25", "--clip-plane", "1,0,0,-25"),
        ("--light", "0,0,1:#ff0000", "--light", "eye:0000ff"),
        ("--edges", "0.001,0.2"),
        ("--deblock",),
    ],
)
def test_every_option_changes_the_picture(pixels: Callable[..., Any], options: Any) -> None:
    plain = pixels("--preset", "mr", "--level", 0)
    assert plain.shape == (32, 48, 3)
    assert plain.std() > 5
    assert not np.array_equal(pixels("--preset", "mr", "--level", 0, *options), plain)


def test_a_transparent_background_has_alpha(pixels: Callable[..., Any]) -> None:
    picture = pixels("--preset", "mr", "--background", "transparent")
    assert picture.shape == (32, 48, 4)
    assert picture[0, 0, 3] == 0
    assert picture[16, 24, 3] > 0


def test_a_transfer_function_comes_from_a_file(pixels: Callable[..., Any], tmp_path: Path) -> None:
    file = tmp_path / "function.json"
    file.write_text(TransferFunction.preset("microscopy").to_json())
    own = pixels("--transfer-function", file)
    np.testing.assert_array_equal(own, pixels("--preset", "microscopy"))
    assert not np.array_equal(own, pixels("--preset", "mr"))


def test_a_slice_faces_the_camera_and_an_isosurface_is_ivory_unless_told_otherwise(
    pixels: Callable[..., Any],
) -> None:
    front = ("--level", 0, "--azimuth", 0, "--elevation", 0, "--mode")
    np.testing.assert_array_equal(
        pixels(*front, "slice"), pixels(*front, "slice", "--slice-normal", "0,1,0")
    )
    surface = pixels(*front, "isosurface", "--iso", 1000, "--no-shading")
    np.testing.assert_array_equal(surface[16, 24], (237, 227, 209))


def test_no_deblock_is_the_default_and_4_the_usual_strength(pixels: Callable[..., Any]) -> None:
    ball = ("--preset", "mr", "--level", 0)
    np.testing.assert_array_equal(pixels(*ball, "--no-deblock"), pixels(*ball))
    np.testing.assert_array_equal(pixels(*ball, "--deblock"), pixels(*ball, "--deblock", 4))


@pytest.fixture(scope="module")
def channels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three channels of 16³: the first in the left half, the second in the right one."""
    folder = tmp_path_factory.mktemp("channels")
    voxels = np.zeros((3, 16, 16, 16), np.uint8)
    voxels[0, ..., :8], voxels[1, ..., 8:], voxels[2] = 200, 100, 50
    np.save(folder / "three.npy", voxels)
    ingest(folder / "three.npy", folder / "three.zarr", brick=16, workers=1, axes="czyx")
    return folder / "three.zarr"


def test_channels_have_colours_functions_and_windows_of_their_own(
    channels: Path, tmp_path: Path
) -> None:
    front = ("--azimuth", 0, "--elevation", 0, "--no-shading", "--size", "32x32")

    def sides(*options: object) -> Any:
        arguments = ["render", channels, "-o", tmp_path / "p.png", *front, *options]
        result = CliRunner().invoke(main, [str(argument) for argument in arguments])
        assert result.exit_code == 0, result.stderr
        picture = np.asarray(Image.open(tmp_path / "p.png")).astype(int)
        return picture[16, 11], picture[16, 20]

    left, right = sides("--c", "0,1")
    assert left[1] > 100 > 5 > left[0]  # green, and magenta
    assert right[0] == right[2] > 20 > right[1]
    left, right = sides("--c", "0,1", "--window", "0,200", "--window", "0,100")
    assert left[1] == pytest.approx(right[0], abs=2)
    (tmp_path / "red.json").write_text(
        '{"colors": [[0, 1, 0, 0]], "opacities": [[0, 0], [1, 0.2]]}'
    )
    red = ("--transfer-function", tmp_path / "red.json")
    left, right = sides("--c", "0,1", *red)
    assert left[0] > right[0] > 100 > left[1] == right[2] == 0
    left, right = sides("--rgb", *red, "--window", "0,200")
    assert left[0] / left[2] == pytest.approx(4, abs=0.1)
    assert right[1] / right[2] == pytest.approx(2, abs=0.1)


def test_depth_is_written_beside_the_picture(render: Callable[..., Result], tmp_path: Path) -> None:
    surface = ("--mode", "isosurface", "--iso", 1000, "--distance", 100, "--fit", "volume")
    result = render(*surface, "--depth", tmp_path / "d.npy")
    assert result.exit_code == 0, result.stderr
    depth = np.load(tmp_path / "d.npy")
    assert depth.shape == (32, 48)
    assert depth[16, 24] == pytest.approx(100 - np.sqrt(250), abs=1)
    assert depth[0, 0] == np.inf


def test_oriented_means_angles_in_the_space_of_the_source(tmp_path: Path) -> None:
    header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 8 8 8\nencoding: raw\n"
    header += "space: left-posterior-superior\nspace directions: (0,1,0) (-1,0,0) (0,0,1)\n\n"
    (tmp_path / "turned.nrrd").write_bytes(header.encode() + bytes(range(256)) * 2)
    ingest(tmp_path / "turned.nrrd", tmp_path / "turned.zarr", workers=1)
    with open_volume(tmp_path / "turned.zarr") as opened:
        camera = View(azimuth=20, fit="volume", oriented=True).camera(opened)
        wanted = View(azimuth=-70, fit="volume").camera(opened)
    assert camera.eye_world_xyz == pytest.approx(wanted.eye_world_xyz)
    assert camera.up_world_xyz == pytest.approx(wanted.up_world_xyz)


@pytest.mark.parametrize("option", ["--scale-bar", "--legend"])
def test_annotations_are_drawn_on_the_picture(pixels: Callable[..., Any], option: str) -> None:
    large = ("--preset", "mr", "--size", "160x128")
    changed = (pixels(*large, option) != pixels(*large)).any(axis=-1)
    assert 0.02 < changed.mean() < 0.5


@pytest.mark.parametrize("suffix", ["webp", "jpg", "exr", "npy"])
def test_the_suffix_says_what_is_written(
    render: Callable[..., Result], tmp_path: Path, suffix: str
) -> None:
    file = tmp_path / f"q.{suffix}"
    assert render("--preset", "mr", "-o", file).exit_code == 0
    assert file.stat().st_size > 100


@pytest.mark.parametrize(
    ("options", "exit_code", "kind"),
    [
        (("--preset", "nope"), 2, "invalid-input"),
        (("--fov", 200), 2, "invalid-input"),
        (("--level", 9), 2, "invalid-input"),
        (("--window", "9,1"), 2, "invalid-input"),
        (("--background", "pink"), 2, "invalid-input"),
        (("--elevation", 95), 2, "invalid-input"),
        (("--quality", 90), 2, "invalid-input"),
        (("-o", "p.exr", "--legend"), 2, "invalid-input"),
        (("-o", "p.tiff"), 2, "invalid-input"),
        (("-o", "p.jpg", "--background", "transparent"), 2, "invalid-input"),
        (("--scale-bar",), 2, "invalid-input"),
        (("--mode", "isosurface"), 2, "invalid-input"),
        (("--iso", 5), 2, "invalid-input"),
        (("--iso-opacity", 0.5), 2, "invalid-input"),
        (("--slice-normal", "1,0,0"), 2, "invalid-input"),
        (("--mode", "mip", "--light", "0,0,1"), 2, "invalid-input"),
        (("--no-shading", "--light", "0,0,1"), 2, "invalid-input"),
        (("--light", "up"), 2, "invalid-input"),
        (("--light", "1,2:#ffffff"), 2, "invalid-input"),
        (("--clip-box", "1,2,3"), 2, "invalid-input"),
        (("--clip-box", "9,,,1,,"), 2, "invalid-input"),
        (("--clip-plane", "0,0,0,1"), 2, "invalid-input"),
        (("--c", "0,1"), 2, "invalid-input"),
        (("--c", "0,x"), 2, "invalid-input"),
        (("--rgb",), 2, "invalid-input"),
        (("--rgb", "--legend"), 2, "invalid-input"),
        (("--preset", "mr", "--preset", "ct-bone"), 2, "invalid-input"),
        (("--preset", "mr", "--transfer-function", "f.json"), 2, "invalid-input"),
        (("--gradients", "stored"), 2, "invalid-input"),
        (("--deblock", "--no-deblock"), 2, "invalid-input"),
        (("--oriented",), 2, "invalid-input"),
        (("--depth", "d.txt"), 2, "invalid-input"),
        (("--depth", "nowhere/d.npy"), 1, "not-found"),
        (("--transfer-function", "nowhere.json"), 1, "not-found"),
    ],
)
def test_what_is_wrong_is_one_line_and_no_picture(
    render: Callable[..., Result], tmp_path: Path, options: Any, exit_code: int, kind: str
) -> None:
    result = render(*options)
    assert result.exit_code == exit_code
    assert result.stderr.startswith(f"octobrick: error [{kind}]: ")
    assert result.stderr.count("\n") == 1
    assert not (tmp_path / "p.png").exists()
