from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from octobrick.codec.errors import InvalidInputError
from octobrick.store.box import Box, cell_box, cells_touching, grid_of

points = st.tuples(*[st.integers(0, 20)] * 3)
cells = st.tuples(*[st.integers(1, 7)] * 3)


@given(points, points, points, points)
def test_the_intersection_holds_exactly_the_voxels_of_both(a, b, c, d) -> None:  # type: ignore[no-untyped-def]
    one, other = np.zeros((21,) * 3, bool), np.zeros((21,) * 3, bool)
    one[Box(a, b).slices] = True
    other[Box(c, d).slices] = True
    assert Box(a, b).intersect(Box(c, d)).nvoxels == (one & other).sum()


@given(points, points, cells)
def test_the_cells_touching_a_box_are_those_that_share_a_voxel(a, b, cell) -> None:  # type: ignore[no-untyped-def]
    start, stop = (
        tuple(map(min, zip(a, b, strict=False))),
        tuple(i + 1 for i in map(max, zip(a, b, strict=False))),
    )
    box = Box(start, stop)  # type: ignore[arg-type]
    every = list(np.ndindex(*grid_of(stop, cell)))  # type: ignore[arg-type]
    sharing = [c for c in every if cell_box(c, cell).intersect(box).nvoxels]
    assert list(cells_touching(box, cell)) == sharing


def test_a_box_that_leaves_the_volume_names_both() -> None:
    with pytest.raises(InvalidInputError, match=r"\(0, 0, 0\) to \(9, 1, 1\).*\(8, 8, 8\)"):
        Box((0, 0, 0), (9, 1, 1)).require_within((8, 8, 8), "here")
