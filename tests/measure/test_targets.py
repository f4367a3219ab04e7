"""What is recommended for a target, and that it holds when it is ingested for real."""

from __future__ import annotations

import itertools
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from octobrick.codec.errors import InvalidInputError
from octobrick.measure import Measurement, measure
from octobrick.measure.target import Target
from octobrick.server.cli import main
from octobrick.store import Volume, open_volume

from .conftest import StandInPictures, mostly_air

Saved = Callable[..., Path]
TARGETS = ("psnr=40", "psnr=50", "max-error=3", "ratio=12", "bits=2.5")


@pytest.fixture(scope="module")
def advised(tmp_path_factory: pytest.TempPathFactory) -> Measurement:
    path = tmp_path_factory.mktemp("targets") / "a volume's.npy"
    np.save(path, mostly_air((66, 64, 90)))
    return measure(path, targets=TARGETS, pictures=False, seconds=600)


def few(seconds: float = 30) -> dict[str, Any]:
    """Time for a few codes and a search, by a clock that goes on whenever it is read."""
    ticks = itertools.count()
    return {"seconds": seconds, "clock": lambda: float(next(ticks))}


def made(command: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Volume:
    """Run a recommended command in a folder, as a shell would."""
    monkeypatch.chdir(folder)
    program, *arguments = shlex.split(command)
    assert program == "octobrick"
    result = CliRunner().invoke(main, [*arguments, "--quiet"])
    assert result.exit_code == 0, result.output
    return open_volume(folder / arguments[-1])


@pytest.mark.parametrize("asked", TARGETS)
def test_the_recommended_ingest_meets_its_target(
    advised: Measurement, asked: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = advised.recommendations[TARGETS.index(asked)]
    assert (one.target, one.met) == (asked, True)
    kind, value = asked.split("=")
    with made(one.ingest_command, tmp_path, monkeypatch) as volume:
        level = volume.levels[0]
        if kind == "psnr":
            assert level.psnr_db == pytest.approx(float(value), abs=0.5)
        elif kind == "max-error":
            assert 0 < level.max_error <= float(value)
        elif kind == "ratio":
            assert level.nbytes / level.stored_nbytes == pytest.approx(float(value), rel=0.1)
        else:
            bricks = np.ndindex(level.grid_zyx)
            codes = [volume.brick_code(0, (z, y, x)) for z, y, x in bricks]
            assert sum(len(code or b"") for code in codes) * 8 <= float(value) * level.nbytes


def test_no_measured_setting_with_the_bound_is_cheaper(advised: Measurement) -> None:
    one = advised.recommendations[TARGETS.index("max-error=3")]
    bits = {row.setting.label: row.disk_bits for row in advised.codes}
    promised = [r for r in advised.codes if r.setting.family.startswith("S3Dc, error bound")]
    promised = [r for r in promised if r.max_error <= 3 and "at most 3" in r.setting.label]
    assert bits[one.setting.label] <= min(row.disk_bits for row in promised)


def test_the_reason_has_the_figures_that_decided(advised: Measurement) -> None:
    rows = {row.setting.label: row for row in advised.codes}
    for one in advised.recommendations:
        row = rows[one.setting.label]
        assert f"{row.disk_bits:.2f} bits a voxel on disk" in one.reason
        assert f"{row.resident_bits:.2f} in memory" in one.reason


def test_a_ratio_that_nothing_reaches_is_not_met_and_says_what_is_nearest(saved: Saved) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (40, 40, 40)).astype(np.uint8)
    (one,) = measure(saved(noise), targets=["ratio=5000"], pictures=False, **few()).recommendations
    assert not one.met
    assert "nothing that was measured is smaller" in one.reason


def test_without_time_a_rate_is_read_off_the_curve(saved: Saved) -> None:
    found = measure(
        saved(mostly_air((64, 64, 64))),
        targets=["psnr=45", "ratio=10"],
        pictures=False,
        **few(12),
    )
    assert any("time limit left out" in note for note in found.skipped)
    for one in found.recommendations:
        assert "time was over before its rate was found" in one.reason
        assert one.met


def test_labels_are_kept_exactly_whatever_is_asked(saved: Saved) -> None:
    names = (mostly_air((40, 40, 40)) // 60).astype(np.uint8)
    found = measure(
        saved(names),
        labels=True,
        targets=["psnr=30", "ratio=2", "ratio=100000"],
        seconds=60,
        picture_sweep=StandInPictures(),
    )
    assert [row.setting.label for row in found.codes] == ["lossless"]
    assert [one.met for one in found.recommendations] == [True, True, False]
    assert all("--codec lossless --" not in one.ingest_command for one in found.recommendations)
    assert all("--labels --codec lossless" in one.ingest_command for one in found.recommendations)
    assert not found.pictures
    assert any("labels" in note for note in found.skipped)


def test_frames_a_second_take_the_best_picture_that_is_drawn_in_time(saved: Saved) -> None:
    path = saved(mostly_air((40, 40, 40)))
    found = measure(path, targets=["fps=9", "fps=1000"], picture_sweep=StandInPictures(), **few())
    quick, impossible = found.recommendations
    in_time = [row for row in found.pictures if row.frame_seconds <= 1 / 9]
    assert quick.met
    assert quick.setting == in_time[0].setting  # lossless, which is the best
    assert quick.render_command == "octobrick render volume.zarr -o volume.png --no-deblock"
    assert not impossible.met
    assert "nothing is drawn in time" in impossible.reason


def test_without_pictures_nothing_is_claimed_of_frames(saved: Saved) -> None:
    path = saved(mostly_air((30, 30, 30)))
    (one,) = measure(path, targets=["fps=10"], pictures=False, **few()).recommendations
    assert not one.met
    assert "no picture was drawn" in one.reason


@pytest.mark.parametrize(
    "text",
    ["psnr", "psnr=", "psnr=-1", "psnr=nan", "psnr=inf", "ratio=0.5", "bits=0", "max-error=-2",
     "fps=0", "speed=3", "", "=3", "psnr=45=3"],
)  # fmt: skip
def test_a_target_that_makes_no_sense_is_refused(text: str) -> None:
    with pytest.raises(InvalidInputError, match="target"):
        Target.parse(text)


@pytest.mark.parametrize("text", ["psnr=45", "max-error=0", "ratio=1", "bits=2.5", "fps=10"])
def test_a_target_is_written_as_it_was_read(text: str) -> None:
    assert str(Target.parse(text)) == text
