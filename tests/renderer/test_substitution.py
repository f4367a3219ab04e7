"""What stands for a brick that is not there lies where the brick does, and in one brick."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from octobrick.renderer.substitution import ancestor, covering, enlarged, nlevels_up_held
from octobrick.store.box import Box, Zyx, cell_box

triples = st.tuples(*[st.integers(0, 9)] * 3)
extents = st.tuples(*[st.integers(1, 9)] * 3)


@given(triples, extents, st.integers(0, 4))
def test_one_brick_of_every_coarser_level_covers_a_brick(zyx: Zyx, brick: Zyx, up: int) -> None:
    own = covering(cell_box(zyx, brick), up)
    assert own.intersect(cell_box(ancestor(zyx, up), brick)) == own


@given(triples, extents, st.integers(0, 3))
def test_voxels_stand_for_the_two_cubed_that_they_cover(start: Zyx, size: Zyx, up: int) -> None:
    stop = tuple(a + n for a, n in zip(start, size, strict=True))
    box = Box(start, (stop[0], stop[1], stop[2]))
    coarse_shape = tuple((n >> up) + 1 for n in stop)
    coarse = np.arange(np.prod(coarse_shape)).reshape(coarse_shape)
    fine = coarse
    for axis in range(3):
        fine = fine.repeat(2**up, axis)
    found = enlarged(coarse[covering(box, up).slices], box, up)
    np.testing.assert_array_equal(found, fine[box.slices])


def test_the_finest_coarser_level_at_hand_is_chosen() -> None:
    here = {(3, (1, 0, 0)), (4, (0, 0, 0))}
    held = lambda level, zyx: (level, zyx) in here  # noqa: E731
    assert nlevels_up_held((5, 2, 3), 1, 5, held) == 2
    assert nlevels_up_held((9, 2, 3), 1, 5, held) is None
    assert nlevels_up_held((7, 7, 7), 1, 5, held) == 3
    assert nlevels_up_held((7, 7, 7), 1, 4, held) is None
