"""``octobrick light-field``, and the options that make a light field."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from PIL import Image

from octobrick.server.cli import main


def run(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def view(row: int, column: int) -> np.ndarray:
    return np.random.default_rng([row, column]).integers(0, 256, (12, 16, 3), np.uint8)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Views, and the light field that the command made of them."""
    folder = tmp_path_factory.mktemp("light_field")
    (folder / "views").mkdir()
    for row in range(4):
        for column in range(4):
            Image.fromarray(view(row, column)).save(folder / "views" / f"view_{row}_{column}.png")
    result = run(
        *("ingest", folder / "views", folder / "lf.zarr", "--light-field", "--codec", "lossless"),
        *("--camera-step", "30.77,15.5", "--camera-unit", "millimeter", "--brick", "8"),
    )
    assert result.exit_code == 0, result.stderr
    assert "light field of 4 × 4 png views" in result.stdout
    return folder


def test_a_picture_at_a_camera_is_its_view(folder: Path, tmp_path: Path) -> None:
    result = run("light-field", folder / "lf.zarr", "-o", tmp_path / "a.png", "--eye", "2,1")
    assert result.exit_code == 0, result.stderr
    assert "16×12 pixels, max error 0" in result.stdout
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "a.png")), view(1, 2))


def test_info_and_verify_know_the_cameras(folder: Path) -> None:
    told = run("info", folder / "lf.zarr").stdout
    assert "4 × 4" in told
    assert "30.77, 15.5 millimeter" in told
    checked = run("verify", folder / "lf.zarr", "--source", folder / "views", "--light-field")
    assert checked.exit_code == 0, checked.stderr


def test_a_path_of_eyes_is_a_frame_each(folder: Path, tmp_path: Path) -> None:
    result = run(
        *("light-field", folder / "lf.zarr", "-o", tmp_path / "f_%02d.png", "--stats"),
        *("--eye", "0,0", "--to", "3,2", "--frames", "3", "--interpolation", "nearest"),
    )
    assert result.exit_code == 0, result.stderr
    assert json.loads(result.stdout)["frames"] == 3
    frames = [np.asarray(Image.open(tmp_path / f"f_0{i}.png")) for i in (1, 3)]
    np.testing.assert_array_equal(frames, [view(0, 0), view(2, 3)])


@pytest.mark.parametrize(
    ("options", "code", "message"),
    [
        (("--eye", "4,0"), 2, "0 to 3 along u and 0 to 3 along v"),
        (("--eye", "4"), 2, "7.5,7.5"),
        (("--frames", "3"), 2, "--to"),
        (("--to", "9,9"), 2, "outside of the cameras"),
        (("--spread", "-1"), 2, "spread"),
    ],
)
def test_a_wrong_call_says_what_is_wrong(
    folder: Path, tmp_path: Path, options: tuple[str, ...], code: int, message: str
) -> None:
    name = "f_%d.png" if "--to" in options else "a.png"
    result = run("light-field", folder / "lf.zarr", "-o", tmp_path / name, *options)
    assert (result.exit_code, message in result.stderr) == (code, True), result.stderr
    assert list(tmp_path.iterdir()) == []


def test_cameras_are_of_a_light_field(folder: Path, tmp_path: Path) -> None:
    result = run("ingest", folder / "views", tmp_path / "v.zarr", "--camera-step", "1,1")
    assert result.exit_code == 2
    assert "--light-field" in result.stderr
    flat = run("ingest", folder / "views", tmp_path / "v.zarr", "--brick", "16")
    assert flat.exit_code == 0, flat.stderr
    refused = run("light-field", tmp_path / "v.zarr", "-o", tmp_path / "a.png")
    assert refused.exit_code == 1
    assert "no light field" in refused.stderr
