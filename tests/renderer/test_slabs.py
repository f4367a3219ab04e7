from __future__ import annotations

import itertools
import math

from hypothesis import given
from hypothesis import strategies as st

from octobrick.renderer.cells import CELL_MAX, CellGrid, cell_shape
from octobrick.renderer.slabs import SlabPlan, plan_slabs, power_of_two
from octobrick.store.box import Box, Zyx

SAMPLE_MARGIN = 2

sides = st.integers(1, 300)
shapes = st.tuples(sides, sides, sides)


def cut(box: Box, shape: Zyx, brick: Zyx, axis: int, eye: float, **limits: int) -> SlabPlan | None:
    """Slabs in a buffer of at most `nvoxels_max`, with sides of at most `side_max`."""
    nvoxels = limits["nvoxels_max"]
    return plan_slabs(
        box,
        shape,
        brick,
        axis,
        eye,
        margin=SAMPLE_MARGIN,
        fits=lambda side_zyx: math.prod(side_zyx) <= nvoxels,
        side_max=limits["side_max"],
    )


@st.composite
def boxes(draw: st.DrawFn) -> tuple[Box, Zyx]:
    """A box of bricks of 16 and the level that it lies in."""
    shape = draw(shapes)
    start, stop = [], []
    for n in shape:
        nbricks = -(-n // 16)
        first = draw(st.integers(0, nbricks - 1))
        last = draw(st.integers(first, nbricks - 1))
        start.append(first * 16)
        stop.append(min((last + 1) * 16, n))
    return Box((start[0], start[1], start[2]), (stop[0], stop[1], stop[2])), shape


@given(boxes(), st.integers(0, 2), st.floats(-400, 700), st.integers(1, 1 << 22))
def test_slabs_partition_the_axis_and_fit_their_buffer(
    where: tuple[Box, Zyx], axis: int, eye: float, nvoxels_max: int
) -> None:
    box, shape = where
    plan = cut(box, shape, (16,) * 3, axis, eye, nvoxels_max=nvoxels_max, side_max=2048)
    if plan is None:
        grown = box.grow(SAMPLE_MARGIN).intersect(Box.of_shape(shape)).shape_zyx
        across = math.prod(power_of_two(n) for a, n in enumerate(grown) if a != axis)
        assert across * power_of_two(2 * SAMPLE_MARGIN + 1) > nvoxels_max
        return
    assert math.prod(plan.buffer_zyx) <= nvoxels_max
    assert all(n == power_of_two(n) for n in plan.buffer_zyx)
    ordered = sorted(plan.slabs, key=lambda slab: slab.low)
    assert ordered[0].low == -math.inf
    assert ordered[-1].high == math.inf
    for a, b in itertools.pairwise(ordered):
        assert a.high == b.low
    for slab in plan.slabs:
        assert all(n <= m for n, m in zip(slab.content.shape_zyx, plan.buffer_zyx, strict=True))
        # Every voxel that its samples touch: one before the base, two beyond.
        low = max(slab.low, box.start_zyx[axis])
        high = min(slab.high, box.stop_zyx[axis])
        assert slab.content.start_zyx[axis] == max(0, low - SAMPLE_MARGIN)
        assert slab.content.stop_zyx[axis] == min(shape[axis], high + SAMPLE_MARGIN)
        for other in {0, 1, 2} - {axis}:
            assert slab.content.start_zyx[other] == max(0, box.start_zyx[other] - SAMPLE_MARGIN)


def order(plan: SlabPlan | None) -> list[tuple[float, float]]:
    assert plan is not None
    return [(slab.low, slab.high) for slab in plan.slabs]


@given(boxes(), st.integers(0, 2), st.floats(-400, 700) | st.sampled_from([-math.inf, math.inf]))
def test_every_ray_meets_slabs_in_order(where: tuple[Box, Zyx], axis: int, eye: float) -> None:
    box, shape = where
    across = math.prod(power_of_two(n + 4) for a, n in enumerate(shape) if a != axis)
    plan = cut(
        box, shape, (16,) * 3, axis, eye, nvoxels_max=across * 32, side_max=2048
    )  # fmt: skip
    met = order(plan)
    # Of two slabs on one side of the eye, the nearer comes first.
    for i, (low, high) in enumerate(met):
        for later_low, later_high in met[i + 1 :]:
            assert not (eye <= later_low and later_high <= low)
            assert not (eye >= later_high and later_low >= high)


def test_one_slab_where_all_fits_and_thin_ones_where_little_does() -> None:
    box = Box((0, 0, 0), (64, 60, 60))

    def cubes(nvoxels: int) -> SlabPlan | None:
        return cut(box, (64, 60, 60), (16,) * 3, 0, -9.0, nvoxels_max=nvoxels, side_max=2048)

    assert order(cubes(64**3)) == [(-math.inf, math.inf)]
    assert order(cubes(64**3 // 2)) == [(-math.inf, 24), (24, 48), (48, math.inf)]
    assert len(order(cubes(64 * 64 * 16))) == 8
    assert len(order(cubes(64 * 64 * 8))) == 16  # thinner than a cell
    assert cubes(64 * 64 * 4) is None
    assert cubes(64 * 64 - 1) is None


def test_sides_beyond_the_driver_do_not_fit() -> None:
    box = Box((0, 0, 0), (64, 60, 200))
    arguments = (box, (64, 60, 200), (16,) * 3)
    assert cut(*arguments, 0, -9.0, nvoxels_max=1 << 30, side_max=128) is None
    plan = cut(*arguments, 2, -9.0, nvoxels_max=1 << 30, side_max=128)
    assert len(order(plan)) == 2


@given(shapes)
def test_cells_divide_bricks(brick: Zyx) -> None:
    for edge, cell in zip(brick, cell_shape(brick), strict=True):
        assert edge % cell == 0
        assert cell <= CELL_MAX or cell == edge


@given(boxes())
def test_cells_cover_the_content_and_lie_in_its_bricks(where: tuple[Box, Zyx]) -> None:
    box, _ = where
    grid = CellGrid.of((16, 16, 16), box)
    assert grid.cell_zyx == (8, 8, 8)
    covered = Box(
        tuple(8 * n for n in grid.cells.start_zyx),  # type: ignore[arg-type]
        tuple(8 * n for n in grid.cells.stop_zyx),  # type: ignore[arg-type]
    )
    assert covered.intersect(box) == box
    bricks = grid.bricks((16, 16, 16))
    assert bricks.start_zyx == tuple(n // 16 for n in box.start_zyx)
    assert bricks.stop_zyx == tuple(-(-n // 16) for n in box.stop_zyx)
