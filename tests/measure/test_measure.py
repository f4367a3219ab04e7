"""A run as a whole: stages, time, what is said, and what is refused."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from octobrick.codec import S3dc
from octobrick.codec.errors import InvalidInputError, NotFiniteError, ResourceError
from octobrick.measure import Measurement, MeasureProgress, extremes, measure
from octobrick.measure.picture_stage import Drawn
from octobrick.server.cli import main
from octobrick.store import ingest, open_volume
from octobrick.store.errors import SourceNotFoundError

from .conftest import StandInPictures, mostly_air

Saved = Callable[..., Path]


def quick(path: Path, **options: Any) -> Measurement:
    """A run whose time, by a clock that goes on whenever it is read, is enough for a few codes."""
    defaults = {"picture_sweep": StandInPictures(), "seconds": 30, "clock": ticking()}
    return measure(path, **(defaults | options))


def ticking() -> Callable[[], float]:
    ticks = itertools.count()
    return lambda: float(next(ticks))


def test_a_run_has_all_of_its_parts_and_says_them_in_json(saved: Saved) -> None:
    pictures, moments = StandInPictures(), list[MeasureProgress]()
    voxels = mostly_air((40, 44, 48))
    options = {"seconds": 100, "picture_sweep": pictures, "progress": moments.append}
    found = quick(saved(voxels), **options)
    facts = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert facts["version"] == 1
    assert len(facts["codes"]) == len(found.codes) > 3
    assert facts["codes"][0]["errors"]["counts"] == [voxels.size]
    assert set(facts["front"]) <= {row["setting"]["label"] for row in facts["codes"]}
    assert facts["recommendations"][0]["target"] == "psnr=45"
    assert facts["images"] == ["view-0"]
    assert facts["skipped"][-1] == "pictures: one"
    assert facts["source"]["value_range"] == [0, int(voxels.max())]
    (seen,) = pictures.seen
    np.testing.assert_array_equal(seen["part"], voxels)
    assert seen["settings"][0].label == "lossless"
    assert seen["window"] == tuple(facts["source"]["window"])
    assert [m.done for m in moments] == sorted(m.done for m in moments)


def test_the_window_is_that_of_the_ingest(saved: Saved, tmp_path: Path) -> None:
    path = saved(mostly_air((40, 44, 48), "uint16"))
    ingest(path, tmp_path / "v.zarr")
    with open_volume(tmp_path / "v.zarr") as volume:
        assert quick(path, pictures=False).source["window"] == list(map(float, volume.window))


def test_what_the_time_limit_leaves_out_is_named(saved: Saved) -> None:
    pictures = StandInPictures()
    found = measure(
        saved(mostly_air((64, 64, 64))),
        seconds=1e-6,
        picture_sweep=pictures,
        clock=ticking(),
    )
    assert found.codes[0].setting.label == "lossless"
    (note,) = [note for note in found.skipped if "time limit" in note]
    assert "S3Dc 4 bits, 8³" in note
    assert pictures.seen[0]["late"]
    assert found.recommendations  # something is recommended all the same


def test_of_a_lossless_volume_figures_are_those_of_its_source(saved: Saved, tmp_path: Path) -> None:
    path = saved(mostly_air((66, 50, 40), "uint16"))
    ingest(path, tmp_path / "exact.zarr", codec=None, brick=32)
    of_source, of_volume = (quick(one, pictures=False) for one in (path, tmp_path / "exact.zarr"))
    for a, b in zip(of_source.codes, of_volume.codes, strict=True):
        assert (a.setting, a.disk_bits, a.rmse) == (b.setting, b.disk_bits, b.rmse)
    stored = of_volume.source["stored"]
    assert stored["lossless"]
    assert of_source.source["stored"] is None


def test_of_a_lossy_volume_the_reference_is_what_it_stores(saved: Saved, tmp_path: Path) -> None:
    path, dest = saved(mostly_air((40, 50, 40))), tmp_path / "lossy.zarr"
    ingest(path, dest, codec=S3dc(bits=3))
    found = quick(dest, pictures=False)
    with open_volume(dest) as volume:
        level = volume.levels[0]
    stored = found.source["stored"]
    assert stored["psnr_db"] == level.psnr_db
    assert (stored["max_error"], stored["rmse"]) == (level.max_error, level.rmse)
    assert not stored["lossless"]
    assert found.codes[0].max_error == 0
    assert found.source["reference"] == "voxels as the volume stores them"
    arguments = ["measure", str(dest), "--no-pictures", "--seconds", "1"]
    text = CliRunner().invoke(main, [*arguments, "-o", str(tmp_path / "r.json")]).stderr
    assert "the volume is lossy" in text


def test_all_channels_and_time_steps_are_measured(saved: Saved) -> None:
    rng = np.random.default_rng(0)
    voxels = rng.integers(0, 50, (2, 3, 20, 24, 28)).astype(np.uint8)
    found = quick(saved(voxels), axes="tczyx", seconds=60)
    assert found.sample["bricks"] == found.sample["bricks_of_level_0"] == 6
    assert found.codes[0].errors.total == voxels.size
    assert "--axes tczyx" in found.recommendations[0].ingest_command


@pytest.mark.parametrize(
    "voxels",
    [
        np.full((1, 1, 1), 7, np.uint8),
        np.full((20, 30, 40), -3.5, np.float32),
        np.zeros((70, 20, 20), np.int16),
        np.array([0, 1], np.uint8).reshape(1, 1, 2),
    ],
    ids=["one voxel", "constant", "zeros", "two voxels"],
)
def test_the_smallest_and_the_flattest_volumes_are_measured(saved: Saved, voxels: Any) -> None:
    found = quick(saved(voxels), targets=["psnr=45", "max-error=1", "ratio=2", "bits=3"])
    json.dumps(found.to_dict(), allow_nan=False)
    lossless = found.codes[0]
    assert (lossless.psnr_db, lossless.max_error) == (None, 0)
    assert len(found.recommendations) == 4
    assert found.recommendations[0].met


def test_nan_is_refused_with_its_place_unless_something_stands_for_it(saved: Saved) -> None:
    voxels = mostly_air((20, 20, 20), "float32")
    voxels[3, 4, 5] = np.nan
    path = saved(voxels)
    with pytest.raises(NotFiniteError, match=r"\(3, 4, 5\)"):
        quick(path)
    pictures = StandInPictures()
    found = quick(path, replace_nonfinite=-1.0, picture_sweep=pictures)
    assert "--replace-nonfinite=-1" in found.recommendations[0].ingest_command
    assert pictures.seen[0]["part"][3, 4, 5] == -1


@pytest.mark.parametrize(
    ("options", "what"),
    [
        ({"seconds": 0}, "seconds"),
        ({"seconds": float("nan")}, "seconds"),
        ({"seed": -1}, "seed"),
        ({"targets": ["psnr=-1"]}, "psnr"),
        ({"views": [(0, 91)]}, "view"),
        ({"size": (8, 8)}, "size"),
    ],
)
def test_options_that_make_no_sense_are_refused(
    saved: Saved, options: dict[str, Any], what: str
) -> None:
    with pytest.raises(InvalidInputError, match=what):
        quick(saved(mostly_air((8, 8, 8))), **options)


def test_what_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(SourceNotFoundError, match=r"gone\.npy"):
        quick(tmp_path / "gone.npy")


def test_without_opengl_codes_are_there_all_the_same(saved: Saved) -> None:
    def no_pictures(*_: Any) -> Drawn:
        raise ResourceError("no OpenGL context; install libEGL")

    found = quick(saved(mostly_air((20, 20, 20))), picture_sweep=no_pictures)
    assert found.codes
    assert found.skipped[-1] == "pictures: no OpenGL context; install libEGL"


def test_the_command_writes_json_and_ends_with_what_to_run(saved: Saved, tmp_path: Path) -> None:
    path, out = saved(mostly_air((20, 30, 40))), tmp_path / "figures.json"
    arguments = ["measure", str(path), "--no-pictures", "-o", str(out)]
    arguments += ["--target", "max-error=2", "--seconds", "1"]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.output
    facts = json.loads(out.read_text())
    assert facts["recommendations"][0]["ingest_command"] in result.stdout
    assert "octobrick ingest --codec" in result.stdout


@pytest.mark.parametrize(
    "arguments",
    [
        ["measure"],
        ["measure", "x.npy", "--target", "psnr"],
        ["measure", "x.npy", "-o", "report.pdf"],
        ["measure", "x.npy", "-o", "no-such-folder/report.html"],
        ["measure", "x.npy", "--view", "1"],
        ["measure", "x.npy", "--extremes"],
    ],
)
def test_the_command_refuses_what_it_cannot_do_at_once(arguments: list[str]) -> None:
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 2
    assert "octobrick: error [invalid-input]" in result.stderr


def test_the_command_tells_where_a_promise_broke(monkeypatch: pytest.MonkeyPatch) -> None:
    row = extremes.StressRow(
        system="scales", implementation="C++", parameter="load, kg", promise="the needle moves",
        tolerance=1.0, tested=(1.0, 64.0), held=(1.0, 8.0), worst=0.5, worst_at=4.0,
        first_failure="at 16: stuck", ntried=7,
    )  # fmt: skip
    monkeypatch.setattr(extremes, "stress", lambda seed: (row,))
    text = CliRunner().invoke(main, ["measure", "--extremes"]).stdout
    assert "scales (C++): the needle moves" in text
    assert "load, kg  1 … 8  0.5 at 4  of 1" in text
    assert "broken at 16: stuck" in text
    told = json.loads(CliRunner().invoke(main, ["measure", "--extremes", "--json"]).stdout)
    assert told == extremes.to_dict((row,), 0)
