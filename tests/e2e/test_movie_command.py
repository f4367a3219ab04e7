"""`octobrick movie`: frames that it makes, keeps, refuses, and never leaves half written."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result
from PIL import Image

from octobrick.renderer import Camera, Renderer
from octobrick.server.cli import main
from octobrick.server.views.view import View
from octobrick.store import ingest, open_volume

pytestmark = pytest.mark.gl


@pytest.fixture(scope="module")
def volume(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A ball that grows in four steps, off the middle, so that no two views are alike."""
    folder = tmp_path_factory.mktemp("volume")
    z, y, x = np.ogrid[-20:20, -24:24, -28:28]
    distance = np.sqrt(z * z + (y - 5) ** 2 + (x + 9) ** 2)
    balls = [np.clip(200 - 200 * distance / radius, 0, None) for radius in (6, 9, 12, 15)]
    np.save(folder / "ball.npy", np.stack(balls).astype(np.uint8))
    ingest(folder / "ball.npy", folder / "ball.zarr", brick=32, workers=1, axes="tzyx")
    return folder / "ball.zarr"


@pytest.fixture
def movie(volume: Path) -> Callable[..., Result]:
    def run(out: Path, *options: object) -> Result:
        arguments = ["movie", volume, out, "--preset", "mr", "--size", "40x32", *options]
        return CliRunner().invoke(main, [str(argument) for argument in arguments])

    return run


def frames(folder: Path) -> list[Any]:
    return [np.asarray(Image.open(file)) for file in sorted(folder.glob("*.png"))]


def render(volume: Path, out: Path, *options: object) -> Any:
    arguments = ["render", volume, "-o", out, "--preset", "mr", "--size", "40x32", *options]
    assert CliRunner().invoke(main, [str(argument) for argument in arguments]).exit_code == 0
    return np.asarray(Image.open(out))


def test_a_turntable_is_the_pictures_around_the_volume(
    movie: Callable[..., Result], volume: Path, tmp_path: Path
) -> None:
    options = ("--fit", "volume", "--t", 2)
    result = movie(tmp_path / "turn", "--frames", 4, "--azimuth", 10, *options)
    assert result.exit_code == 0, result.stderr
    assert f"{tmp_path / 'turn'}: 4 frames of 40×32 pixels, max error" in result.stdout
    found = frames(tmp_path / "turn")
    assert len(found) == 4
    for index, picture in enumerate(found):
        still = render(volume, tmp_path / "p.png", "--azimuth", 10 + 90 * index, *options)
        assert np.abs(picture.astype(int) - still).max() <= 2
    assert np.abs(found[0].astype(int) - found[1]).max() > 50


def test_time_steps_share_a_camera_that_sees_them_all(
    movie: Callable[..., Result], tmp_path: Path
) -> None:
    assert movie(tmp_path / "time", "--times", ":").exit_code == 0
    grown = frames(tmp_path / "time")
    lit = [int((picture.max(axis=-1) > 30).sum()) for picture in grown]
    assert lit == sorted(lit)
    assert lit[0] < lit[-1] / 3
    assert movie(tmp_path / "some", "--times", "1::2").exit_code == 0
    assert len(frames(tmp_path / "some")) == 2


def test_the_next_time_step_is_read_while_one_is_drawn(
    movie: Callable[..., Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps: list[tuple[str, int]] = []
    for name in ("prefetch", "render"):
        done = getattr(Renderer, name)

        def noted(
            self: Renderer, *args: Any, _name: str = name, _done: Any = done, **scene: Any
        ) -> Any:
            steps.append((_name, scene["t"]))
            return _done(self, *args, **scene)

        monkeypatch.setattr(Renderer, name, noted)
    result = movie(tmp_path / "time", "--times", ":2")
    assert result.exit_code == 0, result.stderr
    assert steps == [("prefetch", 1), ("render", 0), ("render", 1)]
    movie(tmp_path / "turn", "--frames", 2)
    assert [name for name, _ in steps[3:]] == ["render", "render"]


def test_cameras_come_from_a_file(
    movie: Callable[..., Result], volume: Path, tmp_path: Path
) -> None:
    with open_volume(volume) as opened:
        keys = [Camera.orbit(opened, azimuth) for azimuth in (0, 90)]
    (tmp_path / "keys.json").write_text(json.dumps([key.to_dict() for key in keys]))
    result = movie(tmp_path / "f_%03d.png", "--cameras", tmp_path / "keys.json", "--frames", 3)
    assert result.exit_code == 0, result.stderr
    assert [file.name for file in sorted(tmp_path.glob("f_*.png"))] == [
        "f_001.png",
        "f_002.png",
        "f_003.png",
    ]


@pytest.mark.parametrize("name", ["m.mp4", "m.webm", "m.webp", "m.gif"])
def test_movie_files_are_made_and_told_of_as_json(
    movie: Callable[..., Result], tmp_path: Path, name: str
) -> None:
    result = movie(tmp_path / name, "--frames", 2, "--json")
    assert result.exit_code == 0, result.stderr
    report = json.loads(result.stdout)
    assert report["frames"] == 2
    assert report["nbytes"] == (tmp_path / name).stat().st_size > 100


def test_resume_makes_what_is_missing_and_keeps_the_rest(
    movie: Callable[..., Result], tmp_path: Path
) -> None:
    out = tmp_path / "turn"
    assert movie(out, "--frames", 3).exit_code == 0
    whole = frames(out)
    (out / "frame_0002.png").unlink()
    before = (out / "frame_0001.png").stat().st_mtime_ns
    refused = movie(out, "--frames", 3)
    assert refused.exit_code == 1
    assert "--resume" in refused.stderr
    other = movie(out, "--frames", 3, "--azimuth", 31, "--resume")
    assert other.exit_code == 2
    assert "azimuth 30.0, now it is 31.0" in other.stderr
    result = movie(out, "--frames", 3, "--resume")
    assert "2 of them kept" in result.stdout
    assert (out / "frame_0001.png").stat().st_mtime_ns == before
    np.testing.assert_array_equal(frames(out), whole)
    assert movie(out, "--frames", 2, "--overwrite").exit_code == 0
    assert len(frames(out)) == 2


def test_ctrl_c_leaves_whole_frames_and_no_movie(
    movie: Callable[..., Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rendered = View.render
    calls = []

    def stopped(self: View, *arguments: Any, **options: Any) -> Any:
        calls.append(1)
        if len(calls) % 3 == 0:
            raise KeyboardInterrupt
        return rendered(self, *arguments, **options)

    monkeypatch.setattr(View, "render", stopped)
    result = movie(tmp_path / "m.mp4", "--frames", 5)
    assert (result.exit_code, result.stderr) == (130, "octobrick: interrupted\n")
    assert not list(tmp_path.iterdir())
    assert movie(tmp_path / "turn", "--frames", 5).exit_code == 130
    assert len(frames(tmp_path / "turn")) == 2


@pytest.mark.parametrize(
    ("name", "options", "exit_code", "says"),
    [
        ("m.avi", (), 2, "neither a movie"),
        ("m.png", (), 2, "neither a movie"),
        ("m_%d_%d.png", (), 2, "one number"),
        ("nowhere/m.mp4", (), 1, "no such folder"),
        ("nowhere/frames", (), 1, "no such folder"),
        ("m.mp4", ("--times", "0:2", "--turntable"), 2, "exclude one another"),
        ("m.mp4", ("--times", "0:2", "--frames", 5), 2, "leave --frames"),
        ("m.mp4", ("--times", "0:5"), 2, "which has 0:4"),
        ("m.mp4", ("--times", "2"), 2, "range of time steps"),
        ("m.mp4", ("--resume",), 2, "a movie file has none"),
        ("m.mp4", ("--fps", 0), 2, "above 0"),
        ("m.mp4", ("--background", "transparent"), 2, "no transparency"),
        ("f/%d.jpg", ("--background", "transparent"), 1, "no such folder"),
        ("f_%d.jpg", ("--background", "transparent"), 2, "no transparency"),
        ("f_%d.exr", ("--legend",), 2, "nothing is drawn"),
        ("m.mp4", ("--cameras", "nowhere.json"), 1, "no such file"),
    ],
)
def test_what_is_wrong_is_one_line_and_no_file(
    movie: Callable[..., Result],
    tmp_path: Path,
    name: str,
    options: Any,
    exit_code: int,
    says: str,
) -> None:
    result = movie(tmp_path / name, *options)
    assert result.exit_code == exit_code
    assert says in result.stderr
    assert result.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())
