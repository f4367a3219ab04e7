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
from octobrick.store import ingest

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
        ("--preset", "microscopy"),
        ("--window", "500,1500"),
        ("--distance", 80),
        ("--fov", 50, "--distance", 150),
        ("--level", 1),
        ("--background", "#336699"),
        ("--step", 3),
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
