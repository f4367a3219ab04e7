"""Metrics of what does not fit into memory: parts add up to the whole, however it was cut."""

from __future__ import annotations

import itertools
import math
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from octobrick.codec import metrics
from octobrick.codec.errors import InvalidInputError
from octobrick.codec.metrics import AngularStats, ErrorStats, SsimStats, ValueRange

Pair = tuple[NDArray[Any], NDArray[Any]]


def pair_of(shape: tuple[int, ...], dtype: str = "uint8", seed: int = 1) -> Pair:
    """Waves, and the same with noise and a part that is gone."""
    rng = np.random.default_rng(seed)
    waves = sum(np.sin(i / (3 + axis)) for axis, i in enumerate(np.indices(shape)))
    a = 60 + 10 * np.asarray(waves) + rng.normal(size=shape)
    b = a + 5 * rng.normal(size=shape)
    b[: shape[0] // 3] = 60
    return a.astype(dtype), b.astype(dtype)


@st.composite
def cuts(draw: st.DrawFn, n: int) -> list[tuple[int, int]]:
    """Where parts of an axis of n voxels begin and end: of any sizes, not of one."""
    inner = draw(st.lists(st.integers(1, n - 1), max_size=4, unique=True))
    return list(itertools.pairwise([0, *sorted(inner), n]))


def with_halo(shape: tuple[int, ...], parts: list[list[tuple[int, int]]]) -> Iterator[Any]:
    """As the documentation says: 5 voxels more on each side, less where the whole ends."""
    for part in itertools.product(*parts):
        yield tuple(
            slice(max(0, start - 5), min(n, stop + 5))
            for (start, stop), n in zip(part, shape, strict=True)
        )


def ssim_at_once(a: NDArray[Any], b: NDArray[Any], peak: float, offset: float = 0) -> float:
    """The formula over whole arrays: no tiles, no halo; an offset is added to means alone."""
    axis = np.exp(-((np.arange(11) - 5.0) ** 2) / (2 * 1.5**2))

    def smooth(values: NDArray[Any]) -> NDArray[Any]:
        for i in range(values.ndim):
            windows = np.lib.stride_tricks.sliding_window_view(values, 11, i)
            values = windows @ (axis / axis.sum())
        return values

    a, b = a.astype(np.float64), b.astype(np.float64)
    c1, c2 = (0.01 * peak) ** 2, (0.03 * peak) ** 2
    x, y = smooth(a), smooth(b)
    xx, yy, xy = smooth(a * a) - x * x, smooth(b * b) - y * y, smooth(a * b) - x * y
    x, y = x + offset, y + offset
    return float(
        ((2 * x * y + c1) * (2 * xy + c2) / ((x * x + y * y + c1) * (xx + yy + c2))).mean()
    )


def peak_nbytes(run: Callable[[], object]) -> int:
    """What was allocated at most while it ran."""
    tracemalloc.start()
    try:
        run()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


# ---- SSIM ------------------------------------------------------------------------------------


@given(
    st.tuples(*[st.integers(11, 22)] * 3),
    st.sampled_from(["uint8", "int16", "float32"]),
    st.data(),
)
@settings(max_examples=40, deadline=None)
def test_parts_of_a_volume_cut_anyhow_add_up_to_its_ssim(
    shape: tuple[int, int, int], dtype: str, data: st.DataObject
) -> None:
    a, b = pair_of(shape, dtype)
    peak = float(np.ptp(a))
    parts = [data.draw(cuts(n)) for n in shape]
    stats = SsimStats()
    for part in with_halo(shape, parts):
        stats += metrics.ssim_stats(a[part], b[part], peak)
    assert stats.count == math.prod(n - 10 for n in shape)
    assert stats.mean == pytest.approx(metrics.ssim(a, b, peak), abs=1e-12)


@given(st.tuples(*[st.integers(11, 40)] * 2), st.sampled_from([None, 1, 3, 4]), st.data())
@settings(max_examples=40, deadline=None)
def test_parts_of_an_image_cut_anyhow_add_up_to_its_ssim(
    shape: tuple[int, int], channels: int | None, data: st.DataObject
) -> None:
    full = shape if channels is None else (*shape, channels)
    a, b = pair_of(full)
    parts = [data.draw(cuts(n)) for n in shape]
    stats = SsimStats()
    for part in with_halo(shape, parts):
        stats += metrics.ssim_stats(a[part], b[part], 255)
    assert stats.count == math.prod(n - 10 for n in shape) * (channels or 1)
    assert stats.mean == pytest.approx(metrics.ssim(a, b, 255), abs=1e-12)


@given(st.tuples(*[st.integers(11, 20)] * 3), st.tuples(*[st.integers(1, 30)] * 3))
@settings(max_examples=40, deadline=None)
def test_ssim_parts_cuts_so_that_every_window_is_in_one_part(
    shape: tuple[int, int, int], part: tuple[int, int, int]
) -> None:
    times_seen = np.zeros(shape, int)
    for box in metrics.ssim_parts(shape, part):
        assert all(s.stop - s.start <= n + 10 for s, n in zip(box, part, strict=True))
        inner = tuple(slice(s.start + 5, max(s.start + 5, s.stop - 5)) for s in box)
        times_seen[inner] += 1
    expected = np.zeros(shape, int)
    expected[5:-5, 5:-5, 5:-5] = 1
    np.testing.assert_array_equal(times_seen, expected)


@pytest.mark.parametrize("shape", [(40, 59, 110), (33, 11, 97), (300, 1100), (11, 1025)])
def test_tiles_have_the_ssim_of_the_formula_over_whole_arrays(shape: tuple[int, ...]) -> None:
    a, b = pair_of(shape)
    assert metrics.ssim(a, b, 255) == pytest.approx(ssim_at_once(a, b, 255), abs=1e-12)


def test_ssim_parts_index_what_lies_on_a_disk(tmp_path: Path) -> None:
    a, b = pair_of((24, 25, 26))
    np.save(tmp_path / "a.npy", a)
    on_disk = np.load(tmp_path / "a.npy", mmap_mode="r")
    stats = SsimStats()
    for part in metrics.ssim_parts(on_disk.shape, (10, 25, 7)):
        stats += metrics.ssim_stats(on_disk[part], b[part], 255)
    assert stats.mean == pytest.approx(metrics.ssim(a, b, 255), abs=1e-12)


def test_ssim_parts_leave_axes_that_are_not_named_whole() -> None:
    assert list(metrics.ssim_parts((20, 8, 3), (16, 16))) == [
        (slice(0, 20), slice(0, 8)), (slice(11, 20), slice(0, 8))
    ]  # fmt: skip


@pytest.mark.parametrize("shape", [(10, 40), (6, 20, 20), (5, 5, 3), (0, 20, 20)])
def test_a_part_without_a_window_adds_nothing(shape: tuple[int, ...]) -> None:
    nothing = metrics.ssim_stats(np.zeros(shape), np.zeros(shape), 1)
    assert nothing == SsimStats()
    with pytest.raises(InvalidInputError, match="ssim_parts"):
        _ = nothing.mean


def test_memory_of_ssim_does_not_grow_with_the_volume() -> None:
    small, large = pair_of((96, 96, 192)), pair_of((192, 96, 192))
    needed = peak_nbytes(lambda: metrics.ssim(*small, 255))
    assert needed < 30 * 2**20
    assert peak_nbytes(lambda: metrics.ssim(*large, 255)) < 1.1 * needed


def test_ssim_on_an_offset_of_ten_thousand_peaks_is_exact_to_1e_8() -> None:
    rng = np.random.default_rng(7)
    a = rng.random((20, 25, 30))
    b = a + 0.2 * rng.random(a.shape)
    for offset in (1e2, 1e3, 1e4):
        expected = ssim_at_once(a, b, 1, offset)
        assert metrics.ssim(a + offset, b + offset, 1) == pytest.approx(expected, abs=1e-8)


def test_nan_shows_in_the_ssim_of_the_whole_and_nowhere_else() -> None:
    a, b = pair_of((12, 12, 60), "float32")
    b[6, 6, 50] = np.nan
    parts = [metrics.ssim_stats(a[p], b[p], 100) for p in metrics.ssim_parts(a.shape, (12, 12, 20))]
    assert [math.isnan(p.total) for p in parts] == [False, False, True]
    assert math.isnan(sum(parts, SsimStats()).mean)


def test_ssim_stats_refuses_what_ssim_does() -> None:
    for peak in (-1.0, math.nan):
        with pytest.raises(InvalidInputError, match="peak is"):
            metrics.ssim_stats(np.zeros((11, 11)), np.zeros((11, 11)), peak)
    for shape in ((), (40,), (2, 20, 20, 20)):
        with pytest.raises(InvalidInputError, match="SSIM compares"):
            metrics.ssim_stats(np.zeros(shape), np.zeros(shape), 1)
    for part in ((0, 4, 4), (4, 4, 4, 4)):
        with pytest.raises(InvalidInputError, match="cannot cut"):
            metrics.ssim_parts((20, 20, 20), part)


# ---- Angles ----------------------------------------------------------------------------------

components = st.sampled_from([0.0, -0.0, 1.0, -1.0, 0.3, 5e-324, 1e308])
vectors = st.lists(st.tuples(*[components] * 6), min_size=1, max_size=60).map(np.array)


@given(vectors, st.data())
@settings(max_examples=80, deadline=None)
def test_parts_of_a_field_cut_anyhow_add_up_to_its_angles(
    both: NDArray[np.float64], data: st.DataObject
) -> None:
    a, b = both[:, :3], both[:, 3:]
    stops = sorted(data.draw(st.lists(st.integers(0, len(a)), max_size=4)))
    total = AngularStats()
    for start, stop in itertools.pairwise([0, *stops, len(a)]):
        total += metrics.angular_stats(a[start:stop], b[start:stop])
    whole = metrics.angular_stats(a, b)
    for name in ("count", "max_degrees", "vanished", "empty", "histogram"):
        assert getattr(total, name) == getattr(whole, name)
    assert total.mean == pytest.approx(whole.mean, rel=1e-12)
    assert total.rms == pytest.approx(whole.rms, rel=1e-12)
    assert all(total.percentile(q) == whole.percentile(q) for q in (0, 50, 99, 100))


@given(vectors)
@settings(max_examples=60, deadline=None)
def test_angular_stats_are_those_of_the_angles(both: NDArray[np.float64]) -> None:
    a, b = both[:, :3], both[:, 3:]
    degrees = metrics.angular_error(a, b)
    stats = metrics.angular_stats(a, b)
    zero_a, zero_b = ~a.any(axis=-1), ~b.any(axis=-1)
    assert stats.count == len(a)
    assert stats.max_degrees == degrees.max()
    assert stats.mean == pytest.approx(degrees.mean())
    assert stats.rms == pytest.approx(np.sqrt((degrees**2).mean()))
    assert stats.vanished == (zero_a ^ zero_b).sum()
    assert stats.empty == (zero_a & zero_b).sum()


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 0.03, 1, 40])
def test_percentiles_are_those_of_the_angles_to_the_width_of_a_bin(scale: float) -> None:
    rng = np.random.default_rng(3)
    turn = np.radians(np.clip(np.abs(rng.normal(size=100_000)) * scale, 0, 180))
    a = np.broadcast_to([0.0, 0.0, 1.0], (100_000, 3))
    b = np.column_stack([np.sin(turn), np.zeros_like(turn), np.cos(turn)])
    stats, degrees = metrics.angular_stats(a, b), np.sort(metrics.angular_error(a, b))
    for permille in (0, 10, 500, 990, 999, 1000):
        exact = degrees[max(1, permille * 100) - 1]
        found = stats.percentile(permille / 10)
        assert exact * (1 - 1e-12) <= found <= exact + 0.0007 * (exact + 1)
    assert stats.percentile(100) == stats.max_degrees


def test_opposite_vectors_are_in_the_last_bin() -> None:
    x = np.array([[1.0, 0, 0]])
    stats = metrics.angular_stats(np.concatenate([x, x]), np.concatenate([-x, x]))
    assert stats.max_degrees == stats.percentile(100) == stats.percentile(51) == 180
    assert stats.percentile(50) <= 0.0007


def test_a_nan_shows_in_the_angles_of_the_whole() -> None:
    x = np.array([[1.0, 0, 0]])
    good, bad = metrics.angular_stats(x, x), metrics.angular_stats(x, x * np.nan)
    for total in (good + bad, bad + good):
        assert total.count == 2
        for value in (total.max_degrees, total.mean, total.rms, total.percentile(50)):
            assert math.isnan(value)


def test_nothing_compared_has_no_angle() -> None:
    for nothing in (AngularStats(), metrics.angular_stats(np.empty((0, 3)), np.empty((0, 3)))):
        assert nothing == AngularStats()
        assert nothing.mean == nothing.rms == nothing.percentile(99) == 0


@pytest.mark.parametrize("percent", [-1, 100.1, math.nan])
def test_percentiles_that_make_no_sense_are_refused(percent: float) -> None:
    with pytest.raises(InvalidInputError, match="percent is"):
        AngularStats().percentile(percent)


def test_angular_stats_refuses_what_has_no_angle() -> None:
    with pytest.raises(InvalidInputError, match="last axis"):
        metrics.angular_stats(np.zeros((3, 2)), np.zeros((3, 2)))
    with pytest.raises(InvalidInputError, match="one shape"):
        metrics.angular_stats(np.zeros((3, 3)), np.zeros((4, 3)))


def test_memory_of_angular_stats_does_not_grow_with_the_field() -> None:
    field = np.ones((40, 100, 100, 3), np.float32)
    needed = peak_nbytes(lambda: metrics.angular_stats(field[:20], field[:20]))
    assert needed < 30 * 2**20
    assert peak_nbytes(lambda: metrics.angular_stats(field, field)) < 1.1 * needed


# ---- Values ----------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["uint8", "int8", "uint16", "int16", "float32", "float64"])
def test_the_psnr_of_a_stream_takes_one_pass(dtype: str) -> None:
    a, b = pair_of((7, 20, 21), dtype)
    errors, values = ErrorStats(), ValueRange()
    for z in range(7):
        errors += metrics.compare(a[z], b[z])
        values += metrics.value_range(a[z])
    assert values == ValueRange(float(a.min()), float(a.max()))
    assert errors.psnr(values.peak) == pytest.approx(metrics.psnr(a, b), rel=1e-12)


def test_no_values_have_no_range_and_widen_none() -> None:
    nothing, some = metrics.value_range(np.empty((0, 4))), ValueRange(-3, 5)
    assert nothing == ValueRange()
    assert nothing.peak == 0
    assert nothing + some == some + nothing == some
    assert some.peak == 8


def test_a_nan_shows_in_the_range_of_the_whole() -> None:
    bad = metrics.value_range(np.array([1.0, np.nan]))
    for total in (bad + ValueRange(0, 1), ValueRange(0, 1) + bad, bad + ValueRange()):
        assert math.isnan(total.least)
        assert math.isnan(total.greatest)
        with pytest.raises(InvalidInputError, match="peak is nan"):
            ErrorStats(1, 1, 1).psnr(total.peak)
