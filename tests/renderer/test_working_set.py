from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from octobrick.codec import S3dc
from octobrick.codec.errors import InvalidInputError
from octobrick.renderer import Camera, Clip, TransferFunction, select
from octobrick.renderer.brick_ranges import BrickRanges
from octobrick.renderer.selection import select_bricks, select_within
from octobrick.renderer.view import make_view

from .array_source import ArraySource

WHITE = ((0.0, (1.0, 1.0, 1.0)),)
ABOVE_100 = TransferFunction(WHITE, ((0.0, 0.0), (100.0, 0.0), (101.0, 1.0)), "value")


def source(brick: int = 16, codec: S3dc | None = None) -> ArraySource:
    voxels = np.zeros((70, 60, 90), np.uint8)
    voxels[20:60, 10:50, 10:80] = 200
    return ArraySource(voxels, brick=brick, codec=codec)


def test_bricks_come_front_to_back_and_each_once() -> None:
    volume = source()
    for camera in (
        Camera.orbit(volume, 0, 0),
        Camera.orbit(volume, 130, -40),
        Camera.orbit(volume, 10, 80).orthographic(),
    ):
        found = select(volume, camera, (512, 512), ABOVE_100, level=0)
        assert len({tuple(brick) for brick in found.bricks_zyx.tolist()}) == found.counts["needed"]
        view = make_view(camera, (512, 512), volume.levels[0])
        along = found.bricks_zyx[:, 2 - view.main_axis] * np.sign(
            view.forward_world[view.main_axis]
        )
        assert (np.diff(along) >= 0).all()


def test_an_eye_within_the_volume_gets_what_is_around_it_first() -> None:
    volume = source()
    camera = Camera.look_at((45.0, 30.0, 35.0), (46.0, 30.0, 35.0), fov_degrees=120.0)
    found = select(volume, camera, (64, 64), ABOVE_100, level=0)
    assert found.bricks_zyx[0, 2] in (2, 3)


def test_what_the_caller_has_is_left_out() -> None:
    volume = source()
    camera = Camera.orbit(volume)
    every = select(volume, camera, (64, 64), ABOVE_100, level=0)
    had = {tuple(brick) for brick in every.bricks_zyx[::2].tolist()}
    rest = select(
        volume, camera, (64, 64), ABOVE_100, level=0, have=lambda _, zyx: tuple(zyx) in had
    )
    assert rest.counts["had"] == len(had)
    np.testing.assert_array_equal(rest.bricks_zyx, every.bricks_zyx[1::2])
    assert rest.nbytes == every.nbytes == 16**3 * every.counts["needed"]


def test_a_smaller_budget_gives_a_coarser_level_that_fits_it() -> None:
    volume, camera = source(codec=S3dc()), Camera.orbit(source())
    sets = [
        select(volume, camera, (4000, 4000), ABOVE_100, budget_nbytes=nbytes)
        for nbytes in (1 << 30, 100_000, 9000)
    ]
    assert [found.level for found in sets] == [0, 1, 2]
    assert all(found.finest_level_wanted == 0 for found in sets)
    assert sets[1].nbytes <= 100_000
    assert sets[0].max_error == volume.fidelity(0)[..., 0].max()


def test_nothing_to_see_needs_nothing() -> None:
    volume = source()
    nothing = TransferFunction(WHITE, ((0.0, 0.0),))
    found = select(volume, Camera.orbit(volume), (64, 64), nothing)
    assert found.bricks_zyx.shape == (0, 3)
    assert found.nbytes == 0
    with pytest.raises(InvalidInputError):
        select(volume, Camera.orbit(volume), (64, 0), nothing)


@given(
    st.tuples(*[st.integers(1, 40)] * 3), st.integers(0, 2**32), st.floats(0, 360),
    st.floats(-80, 80), st.sampled_from([0.3, 1.0, 4.0]), st.sampled_from([0.0, 0.05, 1.0]),
)  # fmt: skip
@settings(max_examples=60, deadline=None)
def test_descending_a_tree_of_cubes_finds_what_testing_each_brick_does(
    grid: tuple[int, int, int], seed: int, azimuth: float, elevation: float, zoom: float,
    spread: float,
) -> None:  # fmt: skip
    volume = ArraySource(np.zeros(grid, np.uint8), brick=1, nlevels=1)
    random = np.random.default_rng(seed)
    low = 0.63 * (1 - spread) + spread * random.random(grid)  # all alike, or each its own
    high = low + random.random(grid) * 0.1
    camera = Camera.orbit(volume, azimuth, elevation, fov_degrees=50.0).zoomed(zoom)
    view = make_view(camera, (40, 30), volume.levels[0])
    planes = Clip(half_spaces=((0.5, 0.3, -0.1, -1.0),)).planes_world()
    level, unit = volume.levels[0], (1, 1, 1)
    ranges = [(BrickRanges.of_bricks(low, high), lambda a, b: (a <= 0.7) & (b >= 0.6))]
    scene: dict[str, Any] = {"clip_planes_world": planes, "margin_zyx": (0, 0, 0)}
    found = select_bricks(level, unit, view, ranges, **scene)
    index = np.argwhere(np.ones(grid, bool))[:, ::-1]
    corner = index - 0.5
    far = np.minimum(corner + 2, np.array(grid[::-1]) - 0.5)
    wanted = view.meets(corner, far).reshape(grid) & (low <= 0.7) & (high >= 0.6)
    nearest = np.where(planes[0, :3] > 0, far, corner) @ planes[0, :3] + planes[0, 3]
    # A thousandth of a box is kept beyond each plane.
    sure = (nearest > 0).reshape(grid)
    surely_not = (nearest < -0.01).reshape(grid)
    assert not (wanted & sure & ~found.sampled).any()
    assert not (found.sampled & ~wanted).any()
    assert not (found.sampled & surely_not).any()
    reasons = ("frustum", "clipped", "transparent", "sampled")
    assert sum(found.counts[reason] for reason in reasons) == found.counts["total"]
    count = found.counts["sampled"]
    again = select_within(count, level, unit, view, ranges, **scene)
    assert again is not None
    assert (again.sampled == found.sampled).all()
    assert count == 0 or select_within(count - 1, level, unit, view, ranges, **scene) is None
