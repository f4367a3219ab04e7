"""The sweep over settings and paths: what it compares with, in which order, and when it stops."""

from __future__ import annotations

import io
import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from octobrick.codec import S3dc, metrics
from octobrick.codec.errors import InvalidInputError
from octobrick.measure.measurement import PictureRow, Setting
from octobrick.measure.pictures import PictureOptions, PictureResult, ViewChoice, sweep_pictures
from octobrick.measure.pictures.difference_picture import difference_picture

pytestmark = pytest.mark.gl

LOSSLESS = Setting("lossless", "lossless", None, ())
FIXED = Setting("S3Dc 2 bits", "S3Dc", S3dc((8, 8, 8), 2), ())
BOUNDED = Setting("S3Dc ±3", "S3Dc, bounded", S3dc((4, 4, 4), max_error=3), ())
SETTINGS = (LOSSLESS, BOUNDED, FIXED)
VIEWS = (ViewChoice(30, 15), ViewChoice(200, -40, 2))


def ball() -> NDArray[np.uint8]:
    """A ball with ripples that codes cannot keep, off the middle."""
    z, y, x = np.ogrid[-20:20, -16:24, -18:18]
    value = 255 - 7 * np.sqrt(z * z + y * y + (1.5 * x) ** 2) + 20 * np.sin(x * 2.0) * np.cos(y)
    return value.clip(0, 255).astype(np.uint8)


def swept(
    folder: Path,
    settings: tuple[Setting, ...] = SETTINGS,
    part: NDArray[Any] | None = None,
    deadline: Callable[[], bool] = lambda: False,
    report: Callable[[str, float], None] = lambda what, share: None,
    **options: Any,
) -> PictureResult:
    given = {"views": VIEWS, "size": (32, 24), "repeats": 1, "preset": "mr"} | options
    voxels = ball() if part is None else part
    return sweep_pictures(
        voxels, (1.0, 2.0, 1.5), None, settings, PictureOptions(**given), folder, deadline, report
    )


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> PictureResult:
    return swept(tmp_path_factory.mktemp("sweep"))


def row(result: PictureResult, setting: Setting, path: str) -> PictureRow:
    (found,) = (r for r in result.rows if (r.setting, r.path) == (setting, path))
    return found


def rgb(png: bytes) -> NDArray[np.uint8]:
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))


def test_the_reference_differs_in_nothing_from_itself(result: PictureResult) -> None:
    found = row(result, LOSSLESS, "slab")
    assert found.psnr_db is None
    assert found.ssim == 1
    assert found.psnr_db_by_view == (None, None)


def test_each_setting_is_drawn_by_the_paths_that_it_has(result: PictureResult) -> None:
    paths = {s: {r.path for r in result.rows if r.setting is s} for s in SETTINGS}
    levels = {f"level {n}, {how}" for n in (1, 2) for how in ("stored gradients", "differences")}
    direct = {"direct, nearest", "direct, linear", "direct, shared"}
    assert paths[LOSSLESS] == {"slab"} | levels
    assert paths[BOUNDED] == {"slab", "slab, deblocked"} | levels
    assert paths[FIXED] == {"slab", "slab, deblocked"} | levels | direct
    assert result.skipped == ()
    assert len(result.rows) == len({(r.setting.label, r.path) for r in result.rows})


def test_slabs_of_all_settings_come_first(result: PictureResult) -> None:
    assert [r.path for r in result.rows[: len(SETTINGS)]] == ["slab"] * len(SETTINGS)
    assert [r.setting for r in result.rows[: len(SETTINGS)]] == list(SETTINGS)


def test_figures_are_those_of_the_pictures_that_are_kept(result: PictureResult) -> None:
    found = row(result, FIXED, "slab")
    wanted, own = rgb(result.images["view-0"]), rgb(result.images["2-s3dc-2-bits-slab-view-0"])
    assert found.psnr_db_by_view[0] == metrics.psnr(wanted, own, peak=255)
    assert found.psnr_db is not None
    assert found.ssim < 1
    difference = rgb(result.images[found.differences[0]])
    assert np.array_equal(difference, difference_picture(wanted, own))
    both = [db for db in found.psnr_db_by_view if db is not None]
    assert min(both) <= found.psnr_db <= max(both)


def test_direct_linear_paths_agree_and_nearest_is_farther_from_the_reference(
    result: PictureResult,
) -> None:
    nearest, linear, shared = (
        row(result, FIXED, f"direct, {how}").psnr_db for how in ("nearest", "linear", "shared")
    )
    assert nearest is not None
    assert linear is not None
    assert linear == pytest.approx(shared, abs=0.05)
    assert linear == pytest.approx(row(result, FIXED, "slab").psnr_db, abs=0.05)
    assert nearest < linear


def test_the_coarser_a_level_the_farther_from_the_reference(result: PictureResult) -> None:
    first, second = (row(result, LOSSLESS, f"level {n}, differences").psnr_db for n in (1, 2))
    assert first is not None
    assert second is not None
    assert second < first


def test_frames_take_time_and_the_median_lies_between_the_quartiles(result: PictureResult) -> None:
    for found in result.rows:
        low, high = found.frame_seconds_quartiles
        assert 0 < low <= found.frame_seconds <= high


def test_differences_are_of_the_slab_path_of_all_and_of_all_paths_of_one(
    result: PictureResult,
) -> None:
    for found in result.rows:
        lossless = found.setting is LOSSLESS
        kept = (found.path == "slab" and not lossless) or found.setting is FIXED
        kept |= lossless and found.path != "slab"
        assert len(found.differences) == (len(VIEWS) if kept else 0)
        assert set(found.differences) <= set(result.images)


def test_what_time_leaves_out_is_named_and_what_was_begun_in_time_is_whole(tmp_path: Path) -> None:
    names: list[str] = []
    late = swept(
        tmp_path,
        (LOSSLESS, FIXED),
        deadline=lambda: "pictures: S3Dc 2 bits: slab, deblocked" in names,
        report=lambda what, share: names.append(what),
    )
    assert [(r.setting, r.path) for r in late.rows] == [(LOSSLESS, "slab"), (FIXED, "slab")]
    (of_fixed,) = (line for line in late.skipped if FIXED.label in line)
    for path in ("slab, deblocked", "direct, nearest", "direct, linear", "direct, shared"):
        assert path in of_fixed
    assert any("lossless" in line and "level 2, stored gradients" in line for line in late.skipped)
    assert not any("deblocked" in key for key in late.images)


def test_a_row_that_time_cuts_is_left_out(tmp_path: Path) -> None:
    asked = itertools.count()
    late = swept(tmp_path, (LOSSLESS,), deadline=lambda: next(asked) > 2)
    assert late.rows == ()
    assert "lossless by slab" in late.skipped[0]


def test_without_any_time_nothing_is_ingested(tmp_path: Path) -> None:
    late = swept(tmp_path, (LOSSLESS, FIXED), deadline=lambda: True)
    assert (late.rows, late.images, len(late.skipped)) == ((), {}, 2)
    assert not list(tmp_path.glob("*.zarr"))


def test_progress_goes_from_nothing_to_all(tmp_path: Path) -> None:
    told: list[float] = []
    swept(tmp_path, (LOSSLESS,), report=lambda what, share: told.append(share))
    assert told == sorted(told)
    assert (told[0], told[-1]) == (0.0, 1.0)


@pytest.mark.parametrize(
    "part",
    [
        np.full((9, 8, 7), 40, np.uint8),
        np.arange(24 * 12, dtype=np.int16).reshape(24, 12, 1) - 100,
        np.random.default_rng(1).normal(size=(12, 16, 20)).astype(np.float32),
        np.ones((1, 1, 1), np.uint16),
    ],
    ids=["constant", "a wall of int16", "float32", "one voxel"],
)
def test_any_part_is_drawn_without_a_preset(part: NDArray[Any], tmp_path: Path) -> None:
    # Without direct rendering, whose shaders a software driver compiles for seconds.
    found = swept(tmp_path, (LOSSLESS, BOUNDED), part, preset=None, views=VIEWS[:1])
    assert found.rows[0].psnr_db is None
    assert found.skipped == ()


@pytest.mark.parametrize(
    ("settings", "part", "options", "message"),
    [
        ((LOSSLESS, LOSSLESS), None, {}, "two have one label"),
        ((LOSSLESS,), np.zeros((0, 4, 4), np.uint8), {}, "none of them 0"),
        ((LOSSLESS,), np.zeros((4, 4), np.uint8), {}, r"\(z, y, x\)"),
        ((LOSSLESS,), None, {"views": ()}, "at least one"),
        ((LOSSLESS,), None, {"size": (8, 64)}, "16 pixels"),
        ((LOSSLESS,), None, {"repeats": 0}, "one frame"),
    ],
)
def test_what_cannot_be_drawn_is_refused(
    settings: tuple[Setting, ...],
    part: NDArray[Any] | None,
    options: dict[str, Any],
    message: str,
    tmp_path: Path,
) -> None:
    with pytest.raises(InvalidInputError, match=message):
        swept(tmp_path, settings, part, **options)
