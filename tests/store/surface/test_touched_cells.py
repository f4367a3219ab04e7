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
places = st.floats(-3, 12, width=32) | st.integers(-3, 12).map(float)
triangles = st.lists(st.tuples(*[places] * 9), min_size=1, max_size=3).map(
    lambda rows: np.array(rows, np.float64).reshape(-1, 3, 3)
)


def distance_to_cells(triangle: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far, along the worst axis, the triangle stays away from each cell: by minimisation.

    The distance max_axis |p - cell| is convex in the weights of the corners, so a grid of weights
    that shrinks around its least value finds the least of all.
    """
    cells = np.stack(np.meshgrid(*map(np.arange, GRID), indexing="ij"), -1).reshape(-1, 1, 3)
    centre, width = np.full((len(cells), 2), 1 / 3), 1.0
    steps = np.stack(np.meshgrid(*[np.linspace(-1, 1, 9)] * 2), -1).reshape(1, -1, 2)
    best = np.full(len(cells), np.inf)
    for _ in range(40):
        at = np.clip(centre[:, np.newaxis] + width * steps, 0, 1)
        excess = np.maximum(at.sum(axis=2, keepdims=True), 1)
        at = at / excess
        weights = np.concatenate([1 - at.sum(axis=2, keepdims=True), at], axis=2)
        points = weights @ triangle
        apart = np.maximum(np.maximum(cells - points, points - cells - 1), 0).max(axis=2)
        least = apart.argmin(axis=1)
        rows = np.arange(len(cells))
        better = apart[rows, least] < best
        best = np.where(better, apart[rows, least], best)
        centre = np.where(better[:, np.newaxis], at[rows, least], centre)
        width *= 0.75
    return best


@settings(max_examples=25, deadline=None)
@given(triangles, st.sampled_from([0.0, 0.125, 0.5]))
def test_cells_are_those_within_the_margin(shape: NDArray[np.float64], margin: float) -> None:
    found = np.zeros(GRID, bool)
    found[tuple(touched_cells(shape, GRID, margin).T)] = True
    distance = np.min([distance_to_cells(triangle) for triangle in shape], axis=0)
    slack = 0.02  # of the minimisation above
    assert found.ravel()[distance <= margin - slack].all()
    assert not found.ravel()[distance > margin + slack].any()


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
