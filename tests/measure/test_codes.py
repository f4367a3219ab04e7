"""Figures of codes are those of the ingest; none is beaten on the front."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from octobrick.codec import metrics, reduce
from octobrick.measure import CodeRow, LevelRow, Measurement, Setting, measure
from octobrick.measure.code_sweep import CodeSweep, front, psnr_of
from octobrick.measure.levels import LevelTally
from octobrick.measure.options import SourceOptions
from octobrick.measure.reference import open_reference
from octobrick.measure.sample import Sample
from octobrick.measure.scan import scan
from octobrick.measure.settings import is_found, swept
from octobrick.server.cli import main
from octobrick.store import open_volume

from .conftest import Voxels, mostly_air

Saved = Callable[..., Path]


def measured(path: Path, **options: object) -> Measurement:
    given_: dict[str, object] = {"full": True, "pictures": False, "seconds": 600.0}
    return measure(path, **(given_ | options))  # type: ignore[arg-type]


def rows_of(
    path: Path, *labels: str, full: bool = True
) -> tuple[dict[str, CodeRow], tuple[LevelRow, ...]]:
    """Rows of some settings only, and of levels."""
    with (
        ThreadPoolExecutor(2) as executor,
        open_reference(str(path), SourceOptions()) as reference,
    ):
        seen = scan(reference, executor, full=full, over=lambda: False, report=lambda _: None)
        sample = Sample.of(seen, 0, full=full)
        groups = list(sample.groups(reference, seen, executor))
        settings = swept(reference.source.dtype, seen.peak, labels=False)
        sweep = CodeSweep(seen.peak, 0, executor, lambda _: None)
        rows, notes = sweep.rows(
            [setting for setting in settings if setting.label in labels],
            groups,
            over=lambda: False,
            report=lambda *_: None,
        )
        levels = LevelTally(reference.source.shape_zyx)
        levels.add(brick for group in groups for brick in group)
    assert not notes
    return {row.setting.label: row for row in rows}, levels.rows(seen.peak)


@pytest.fixture(scope="module")
def volume(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Voxels, Measurement]:
    """Bricks do not divide it, one is absent, and one of each kind of end is there."""
    voxels = mostly_air((70, 64, 130), "int16") - 7
    voxels[64:, :, 64:128] = 0
    path = tmp_path_factory.mktemp("codes") / "volume.npy"
    np.save(path, voxels)
    return path, voxels, measured(path)


KINDS = ("--bits", "--max-error", "--bits-per-voxel", "--details", "lossless")


@pytest.mark.parametrize("kind", KINDS)
def test_figures_of_all_bricks_are_what_an_ingest_reports(
    volume: tuple[Path, Voxels, Measurement], kind: str, tmp_path: Path
) -> None:
    path, voxels, found = volume
    row = next(row for row in found.codes if kind in row.setting.flags and row.psnr_db != 0)
    dest = tmp_path / "volume.zarr"
    arguments = ["ingest", str(path), str(dest), *row.setting.flags, "--quiet"]
    assert CliRunner().invoke(main, arguments).exit_code == 0
    with open_volume(dest) as made:
        level = made.levels[0]
        assert made.codec == row.setting.codec
    assert row.psnr_db == level.psnr_db
    assert row.max_error == level.max_error
    assert row.rmse == level.rmse
    # To the byte: the indexes of shards are part of both.
    assert row.disk_bits * voxels.size / 8 == pytest.approx(level.stored_nbytes, abs=1e-6)


def test_the_histogram_of_errors_counts_every_voxel_once(
    volume: tuple[Path, Voxels, Measurement],
) -> None:
    _, voxels, found = volume
    for row in found.codes:
        assert row.errors.total == voxels.size
        assert row.errors.low >= 0
        assert row.errors.low <= row.max_error or row.max_error == 0


def test_a_float_volume_has_the_figures_of_the_ingest_too(saved: Saved, tmp_path: Path) -> None:
    voxels = (mostly_air((40, 50, 66), "int16") / 7).astype(np.float32)
    path = saved(voxels)
    row = rows_of(path, "S3Dc 4 bits, 8³")[0]["S3Dc 4 bits, 8³"]
    dest = tmp_path / "floats.zarr"
    CliRunner().invoke(main, ["ingest", str(path), str(dest), *row.setting.flags, "--quiet"])
    with open_volume(dest) as made:
        level = made.levels[0]
    assert (row.max_error, row.psnr_db) == (level.max_error, pytest.approx(level.psnr_db))


def test_levels_are_those_of_the_whole_volume(saved: Saved) -> None:
    voxels = mostly_air((61, 50, 44))  # one brick, so no voxel is left out
    _, rows = rows_of(saved(voxels))
    first = reduce.mean2(voxels)
    second = reduce.mean2(first)
    for row, shown in zip(
        rows,
        (
            reduce.upsample2(first, voxels.shape),
            reduce.upsample2(reduce.upsample2(second, first.shape), voxels.shape),
        ),
        strict=False,
    ):
        errors = metrics.compare(voxels, shown)
        assert (row.max_error, row.rmse) == (errors.max_abs, errors.rmse)
    assert [row.level for row in rows] == [1, 2, 3]


def test_inner_voxels_of_a_brick_are_shown_as_in_the_whole(saved: Saved) -> None:
    voxels = mostly_air((64, 64, 128))
    _, rows = rows_of(saved(voxels))
    coarse, shapes = voxels, [voxels.shape]
    for row in rows:
        coarse = reduce.mean2(coarse)
        shown = coarse
        for shape in reversed(shapes):
            shown = reduce.upsample2(shown, shape)
        shapes.append(coarse.shape)
        keep = np.r_[0:56, 72:128]  # without eight voxels on either side of the border
        errors = metrics.compare(voxels[:, :, keep], shown[:, :, keep])
        assert row.rmse == pytest.approx(errors.rmse)
        assert row.max_error == errors.max_abs


@pytest.mark.parametrize("dtype", ["uint8", "int8", "uint16", "int16", "float32"])
def test_every_setting_has_a_label_a_codec_and_flags_of_its_own(dtype: str) -> None:
    settings = swept(np.dtype(dtype), 200.0, labels=False)
    assert len({setting.label for setting in settings}) == len(settings)
    known = [setting.flags for setting in settings if not is_found(setting)]
    assert len(set(known)) == len(known)
    assert settings[0].label == "lossless"
    assert {s.family.split(",")[0] for s in settings} >= {"S3Dc", "zerobit", "lossless"}


points = st.lists(
    st.tuples(st.sampled_from([1.0, 2.0, 3.5, 8.0]), st.sampled_from([None, 20.0, 45.0, 60.0])),
    min_size=1,
    max_size=30,
)


@given(points)
def test_no_setting_of_the_front_is_beaten_and_every_other_is(
    points: list[tuple[float, float | None]],
) -> None:
    rows = [row_of(str(i), bits, psnr_db) for i, (bits, psnr_db) in enumerate(points)]

    def beats(a: CodeRow, b: CodeRow) -> bool:
        no_worse = a.disk_bits <= b.disk_bits and psnr_of(a) >= psnr_of(b)
        return no_worse and (a.disk_bits, psnr_of(a)) != (b.disk_bits, psnr_of(b))

    best = front(rows)
    for row in rows:
        assert (row.setting.label in best) != any(beats(other, row) for other in rows)
    bits = [next(r.disk_bits for r in rows if r.setting.label == label) for label in best]
    assert bits == sorted(bits)


def row_of(label: str, disk_bits: float, psnr_db: float | None) -> CodeRow:
    setting = Setting(label, "family", None, ())
    exact = metrics.Histogram()
    return CodeRow(setting, disk_bits, disk_bits, psnr_db, 1.0, 0.0, 0.0, exact, 1.0, 1.0)


def test_a_weighted_sample_comes_near_the_whole(saved: Saved) -> None:
    path = saved(mostly_air((256, 256, 128)))
    labels = ("lossless", "S3Dc 4 bits, 8³", "zerobit, 5 % of details")
    (whole, _), (part, _) = (rows_of(path, *labels, full=full) for full in (True, False))
    for label in labels:
        assert part[label].errors.total == pytest.approx(256 * 256 * 128, rel=1e-3)
        assert part[label].disk_bits == pytest.approx(whole[label].disk_bits, rel=0.35)
        assert psnr_of(part[label]) == pytest.approx(psnr_of(whole[label]), abs=1.5)


def test_the_same_seed_gives_the_same_figures(saved: Saved) -> None:
    path = saved(mostly_air((130, 64, 64)))
    few = {"full": False, "seconds": 30.0}
    first, second = (
        measured(path, seed=3, clock=iter(map(float, range(10**6))).__next__, **few)
        for _ in range(2)
    )
    for a, b in zip(first.codes, second.codes, strict=True):
        timeless = {"encode_voxels_per_second": 0.0, "decode_voxels_per_second": 0.0}
        a, b = (dataclasses.replace(row, errors=None, **timeless) for row in (a, b))  # type: ignore[arg-type]
        assert a == b
    assert first.front == second.front
