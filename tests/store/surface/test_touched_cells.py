"""The cells of a surface are all that it comes near to, and no other."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from octobrick.codec.errors import InvalidInputError
from octobrick.store.surface import touched_cells as module
from octobrick.store.surface.touched_cells import touched_cells

GRID = (7, 9, 8)
Corner = NDArray[np.float64]
places = st.floats(-3, 12, width=32) | st.integers(-3, 12).map(float)
triangles = st.lists(st.tuples(*[places] * 9), min_size=1, max_size=3).map(
    lambda rows: np.array(rows, np.float64).reshape(-1, 3, 3)
)


def clipped(corners: list[Corner], axis: int, sign: int, limit: float) -> list[Corner]:
    """The part of a convex polygon where ``sign * p[axis] <= limit``: Sutherland and Hodgman."""
    kept: list[Corner] = []
    for start, end in zip(corners[-1:] + corners[:-1], corners, strict=True):
        inside = [sign * corner[axis] <= limit for corner in (start, end)]
        if inside[0] != inside[1]:
            along = (sign * limit - start[axis]) / (end[axis] - start[axis])
            kept.append(start + along * (end - start))
        if inside[1]:
            kept.append(end)
    return kept


def comes_within(triangle: NDArray[np.float64], cell: tuple[int, ...], margin: float) -> bool:
    """Whether something is left of a triangle that a cell, enlarged by a margin, cuts out."""
    corners = list(triangle)
    for axis, low in enumerate(cell):
        corners = clipped(corners, axis, 1, low + 1 + margin)
        corners = clipped(corners, axis, -1, margin - low)
    return bool(corners)


@settings(max_examples=25, deadline=None)
@given(triangles, st.sampled_from([0.0, 0.125, 0.5]))
def test_cells_are_those_within_the_margin(shape: NDArray[np.float64], margin: float) -> None:
    found = set(map(tuple, touched_cells(shape, GRID, margin)))
    rounding = 1e-6
    for cell in np.ndindex(GRID):
        if any(comes_within(triangle, cell, margin - rounding) for triangle in shape):
            assert cell in found
        elif cell in found:
            assert any(comes_within(triangle, cell, margin + rounding) for triangle in shape)


def test_points_on_a_triangle_always_lie_in_its_cells() -> None:
    rng = np.random.default_rng(1)
    shape = rng.uniform(-2, 34, (200, 3, 3)) + rng.normal(0, 0.2, (200, 3, 3))
    found = np.zeros((32, 32, 32), bool)
    found[tuple(touched_cells(shape, (32, 32, 32), 0.125).T)] = True
    weights = rng.dirichlet([0.5] * 3, (200, 300))
    for shift in (-0.125, 0, 0.125):
        at = np.floor(weights @ shape + shift).astype(int).reshape(-1, 3)
        at = at[((at >= 0) & (at < 32)).all(axis=1)]
        assert found[tuple(at.T)].all()


@pytest.mark.parametrize(
    ("corners", "cells"),
    [
        ([[1.5, 1.5, 1.5]] * 3, [[1, 1, 1]]),
        ([[0.5, 0.5, 0.5], [0.5, 0.5, 3.5], [0.5, 0.5, 2]], [[0, 0, x] for x in range(4)]),
        ([[-9, -9, -9], [-8, -8, -8], [-9, -8, -9]], []),
    ],
    ids=["point", "line", "outside"],
)
def test_degenerate_triangles_touch_what_they_are(
    corners: list[list[float]], cells: list[list[int]]
) -> None:
    assert touched_cells(np.array([corners], float), GRID, 0.0).tolist() == cells


def test_a_triangle_across_everything_costs_its_area() -> None:
    side = 512
    corners = np.array([[[0.0, 0, 0], [side, 0, side], [0, side, side]]])
    cells = touched_cells(corners, (side,) * 3, 0.0)
    assert side**2 / 4 < len(cells) < 4 * side**2


def test_too_much_work_and_too_far_away_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InvalidInputError, match="place it nearer"):
        touched_cells(np.full((1, 3, 3), 1e20), GRID, 0.0)
    monkeypatch.setattr(module, "TESTS_MAX", 100)
    with pytest.raises(InvalidInputError, match="simplify the mesh"):
        touched_cells(np.random.default_rng(0).uniform(0, 9, (50, 3, 3)), GRID, 0.0)
