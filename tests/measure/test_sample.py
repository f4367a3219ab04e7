"""Which bricks are chosen, and what they stand for."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from octobrick.measure.brick_pass import BrickKey, Place, brick_box
from octobrick.measure.drawn_part import drawn_box
from octobrick.measure.options import SourceOptions
from octobrick.measure.reference import open_reference
from octobrick.measure.sample import Sample, stratified
from octobrick.measure.scan import BrickFacts, Scan, scan
from octobrick.store.box import Box

from .conftest import mostly_air

Saved = Callable[..., Path]


def facts(ranges: list[float], entropies: list[float], side: int = 64) -> Scan:
    """A scan of a row of bricks, the last one thinner."""
    n = len(ranges)
    shape = (side * (n - 1) + side // 2, side, side)
    places = (Place(0, Box.of_shape(shape)),)
    keys = [BrickKey(0, 0, (z, 0, 0)) for z in range(n)]
    bricks = tuple(
        BrickFacts(key, brick_box(places, key).nvoxels, 0.0, r, e if r else 0.0)
        for key, r, e in zip(keys, ranges, entropies, strict=True)
    )
    nvoxels = shape[0] * side * side
    return Scan(places, bricks, n, nvoxels, (0.0, max(ranges)), "all voxels", (0.0, 1.0))


bricks_of = st.lists(
    st.tuples(st.sampled_from([0.0, 1.0, 7.0, 200.0, 4e3]), st.floats(0.1, 8)),
    min_size=1,
    max_size=80,
)


@given(bricks_of, st.integers(0, 2**32), st.integers(1, 40))
def test_weights_times_voxels_add_up_to_the_whole_volume(
    bricks: list[tuple[float, float]], seed: int, count: int
) -> None:
    seen = facts([r for r, _ in bricks], [e for _, e in bricks])
    sample = Sample.of(seen, seed, full=False, nbricks=count)
    nvoxels = {brick.key: brick.nvoxels for brick in seen.bricks}
    total = sum(weight * nvoxels[key] for key, weight in sample.weights.items())
    assert total == pytest.approx(seen.nvoxels)
    assert all(weight > 0 for weight in sample.weights.values())
    if sample.strata:
        assert sum(stratum.share for stratum in sample.strata) == pytest.approx(1)
        assert sum(stratum.chosen for stratum in sample.strata) == len(sample.weights)


@given(bricks_of, st.integers(0, 2**32))
def test_the_same_seed_chooses_the_same_bricks(
    bricks: list[tuple[float, float]], seed: int
) -> None:
    seen = facts([r for r, _ in bricks], [e for _, e in bricks])
    first, second = (Sample.of(seen, seed, full=False, nbricks=6) for _ in range(2))
    assert first == second


def test_another_seed_chooses_others() -> None:
    seen = facts(list(np.linspace(1, 9, 90)), list(np.linspace(1, 5, 90)))
    chosen = [Sample.of(seen, seed, full=False).weights.keys() for seed in range(4)]
    assert len({tuple(keys) for keys in chosen}) == 4


def test_busy_strata_of_a_volume_of_air_have_their_share_of_bricks() -> None:
    seen = facts([0.0] * 190 + list(np.linspace(10, 200, 10)), [3.0] * 200)
    sample = Sample.of(seen, 0, full=False, nbricks=12)
    chosen = {stratum.name: stratum.chosen for stratum in sample.strata}
    assert chosen.pop("flat") == 2
    assert sum(chosen.values()) == 10  # all that there are
    weights = sorted(sample.weights.values())
    assert weights[:10] == pytest.approx([1.0] * 10)
    assert weights[10] > 90


def test_strata_are_thirds_of_range_and_then_of_entropy() -> None:
    rng = np.random.default_rng(1)
    seen = facts(list(rng.permutation(np.arange(1.0, 91))), list(rng.random(90) + 0.1))
    classes = stratified(seen.bricks)
    assert [len(bricks) for bricks in classes.values()] == [10] * 9
    low = [b.range for name, part in classes.items() if name.startswith("low") for b in part]
    assert max(low) == 30
    entropies = [
        [brick.entropy_bits for brick in classes[f"high range, {which} entropy"]]
        for which in ("low", "middle", "high")
    ]
    assert max(entropies[0]) <= min(entropies[1])
    assert max(entropies[1]) <= min(entropies[2])


def test_a_scan_tells_range_and_entropy_of_every_brick(saved: Saved) -> None:
    voxels = mostly_air((100, 70, 130))
    options = SourceOptions()
    with (
        ThreadPoolExecutor(2) as executor,
        open_reference(str(saved(voxels)), options) as reference,
    ):
        seen = scan(reference, executor, full=False, over=lambda: False, report=lambda _: None)
        sample = Sample.of(seen, 0, full=True)
        (group,) = sample.groups(reference, seen, executor)
    assert seen.range_of == "all voxels"
    assert seen.value_range == (voxels.min(), voxels.max())
    assert len(seen.bricks) == seen.nbricks == 2 * 2 * 3
    for brick, sampled in zip(seen.bricks, group, strict=True):
        own = voxels[seen.box_of(brick).slices]
        np.testing.assert_array_equal(sampled.voxels, own)
        assert sampled.box == seen.box_of(brick)
        assert (brick.least, brick.greatest) == (own.min(), own.max())
        shares = np.unique(own, return_counts=True)[1] / own.size
        assert brick.entropy_bits == pytest.approx(-(shares * np.log2(shares)).sum())


def test_a_scan_that_time_ends_says_what_the_range_is_of(saved: Saved) -> None:
    voxels = mostly_air((200, 64, 64))
    with (
        ThreadPoolExecutor(1) as executor,
        open_reference(str(saved(voxels)), SourceOptions()) as reference,
    ):
        seen = scan(reference, executor, full=False, over=lambda: True, report=lambda _: None)
        sample = Sample.of(seen, 0, full=False)
    assert seen.range_of == "estimated from 1 of 4 bricks"
    total = sum(sample.weights[brick.key] * brick.nvoxels for brick in seen.bricks)
    assert total == pytest.approx(voxels.size)


def test_of_a_large_volume_a_box_around_what_there_is_to_see_is_drawn(saved: Saved) -> None:
    voxels = np.zeros((64, 300, 900), np.uint8)
    rng = np.random.default_rng(0)
    voxels[:, 64:128, 640:832] = rng.integers(0, 255, (64, 64, 192))
    with (
        ThreadPoolExecutor(2) as executor,
        open_reference(str(saved(voxels)), SourceOptions()) as reference,
    ):
        seen = scan(reference, executor, full=False, over=lambda: False, report=lambda _: None)
    assert drawn_box(seen, voxels.shape) == Box((0, 0, 608), (64, 256, 864))
    assert drawn_box(seen, (64, 256, 256)) == Box((0, 0, 0), (64, 256, 256))
