"""Movie files hold the frames that went in, in order and on time, or are not there."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from octobrick.codec.errors import InvalidInputError, ResourceError
from octobrick.renderer import RenderedImage, movie_file, movie_files, save_movie
from octobrick.store.errors import DestinationExistsError

from .pictures import ramp

SUFFIXES = ["mp4", "webm", "webp", "gif"]


def rolling(nframes: int, size: tuple[int, int] = (41, 27)) -> list[RenderedImage]:
    """Frames that all differ, of odd sides."""
    image = ramp(size)
    return [replace(image, rgba=np.roll(image.rgba, 3 * i, axis=1)) for i in range(nframes)]


def read(file: Path) -> tuple[list[Any], float]:
    """The frames as RGB, and how many seconds they take."""
    if file.suffix in (".mp4", ".webm"):
        av = pytest.importorskip("av")
        with av.open(str(file)) as movie:
            stream = movie.streams.video[0]
            frames = [frame.to_ndarray(format="rgb24") for frame in movie.decode(stream)]
            return frames, len(frames) / float(stream.average_rate)
    with Image.open(file) as movie:
        frames, milliseconds = [], 0
        for index in range(movie.n_frames):  # type: ignore[attr-defined]
            movie.seek(index)
            movie.load()
            milliseconds += movie.info["duration"]
            frames.append(np.asarray(movie.convert("RGB")))
        return frames, milliseconds / 1000


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_frames_come_back_in_order_and_on_time(tmp_path: Path, suffix: str) -> None:
    frames = rolling(12)
    save_movie(iter(frames), tmp_path / f"a.{suffix}", fps=24, quality=None)
    found, seconds = read(tmp_path / f"a.{suffix}")
    assert len(found) == 12
    assert seconds == pytest.approx(0.5, abs=0.006)
    for index, pixels in enumerate(found):
        errors = [
            np.abs(pixels[:27, :41].astype(int) - frame.rgba[..., :3]).mean() for frame in frames
        ]
        assert np.argmin(errors) == index
        assert errors[index] < 12
    assert [path.name for path in tmp_path.iterdir()] == [f"a.{suffix}"]


@pytest.mark.parametrize("suffix", ["mp4", "webm"])
def test_odd_sides_grow_by_their_last_pixels(tmp_path: Path, suffix: str) -> None:
    save_movie(rolling(2), tmp_path / f"a.{suffix}")
    pixels = read(tmp_path / f"a.{suffix}")[0][0].astype(int)
    assert pixels.shape == (28, 42, 3)
    assert np.abs(pixels[27] - pixels[26]).mean() < 6


@pytest.mark.parametrize("suffix", ["mp4", "webm", "webp"])
def test_quality_costs_bytes(tmp_path: Path, suffix: str) -> None:
    sizes = []
    for quality in (10, 95):
        save_movie(rolling(4), tmp_path / f"{quality}.{suffix}", quality=quality)
        sizes.append((tmp_path / f"{quality}.{suffix}").stat().st_size)
    assert sizes[0] < sizes[1]


def test_a_webp_may_be_transparent(tmp_path: Path) -> None:
    save_movie([ramp(background=None)] * 2, tmp_path / "a.webp")
    with Image.open(tmp_path / "a.webp") as movie:
        assert np.asarray(movie.convert("RGBA"))[..., 3].min() == 0


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("nframes", [0, 1, 3])
def test_an_interrupted_movie_leaves_nothing(tmp_path: Path, suffix: str, nframes: int) -> None:
    def film() -> None:
        with movie_file(tmp_path / f"a.{suffix}") as add:
            for frame in rolling(nframes):
                add(frame)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        film()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "frames", "options", "says"),
    [
        ("a.avi", rolling(1), {}, r"\.mp4, \.webm, \.webp, \.gif"),
        ("a.mp4", [], {}, "no frames"),
        ("a.mp4", [ramp(background=None)], {}, "background"),
        ("a.gif", [ramp(background=None)], {}, "background"),
        ("a.webp", [ramp((40, 24)), ramp((40, 26))], {}, "one size"),
        ("a.mp4", rolling(1), {"fps": 0}, "above 0"),
        ("a.gif", rolling(1), {"fps": 60}, "up to 50"),
        ("a.gif", rolling(1), {"quality": 80}, r"none for \.gif"),
        ("a.webm", rolling(1), {"quality": 101}, "1 to 100"),
    ],
)
def test_what_makes_no_movie_is_refused(
    tmp_path: Path, name: str, frames: Any, options: Any, says: str
) -> None:
    with pytest.raises(InvalidInputError, match=says):
        save_movie(frames, tmp_path / name, **options)
    assert not list(tmp_path.iterdir())


def test_an_animation_too_large_for_memory_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(movie_files, "HELD_NBYTES_MAX", 41 * 27 * 3 * 2)
    save_movie(rolling(2), tmp_path / "a.webp")
    with pytest.raises(InvalidInputError, match=r"choose \.mp4"):
        save_movie(rolling(3), tmp_path / "b.webp")


def test_a_file_that_is_there_is_replaced_only_on_demand(tmp_path: Path) -> None:
    file = tmp_path / "a.gif"
    save_movie(rolling(1), file)
    with pytest.raises(DestinationExistsError):
        save_movie(rolling(2), file)
    save_movie(rolling(2), file, overwrite=True)
    assert len(read(file)[0]) == 2


def test_a_missing_package_is_named_with_its_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(ResourceError, match=r"octobrick\[movie\]"):
        save_movie(rolling(1), tmp_path / "a.mp4")
    assert not list(tmp_path.iterdir())
