from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from octobrick.codec import reduce, reference
from octobrick.store.pyramid import Layer, LevelStream, level_shapes


@settings(max_examples=40, deadline=None)
@given(
    shape=st.tuples(st.integers(1, 45), st.integers(1, 9), st.integers(1, 9)),
    nlevels=st.integers(1, 4),
    pieces=st.lists(st.integers(1, 20), min_size=1, max_size=6),
)
def test_layers_hold_their_voxels_and_one_plane_of_halo_however_the_planes_arrive(
    shape: tuple[int, int, int], nlevels: int, pieces: list[int]
) -> None:
    voxels = np.random.default_rng(1).integers(0, 255, shape).astype(np.uint8)
    expected = [voxels]
    for _ in range(nlevels - 1):
        expected.append(reference.mean2(expected[-1]))
    seen: list[list[int]] = [[] for _ in range(nlevels)]

    def check(layer: Layer) -> None:
        nz, start = len(expected[layer.level]), layer.index * 8
        first, stop = max(0, start - 1), min(start + 9, nz)
        held = layer.planes[first - layer.first_z : stop - layer.first_z]
        assert layer.first_z <= first
        np.testing.assert_array_equal(held, expected[layer.level][first:stop])
        seen[layer.level].append(layer.index)

    shapes = level_shapes(shape, 8, nlevels)
    assert shapes == tuple(e.shape for e in expected)
    stream = LevelStream(0, shapes, np.dtype(np.uint8), 8, reduce.mean2, check)
    start, step = 0, 0
    while start < shape[0]:
        stream.push(voxels[start : start + pieces[step % len(pieces)]])
        start += pieces[step % len(pieces)]
        step += 1
    assert seen == [list(range(-(-len(e) // 8))) for e in expected]


@pytest.mark.parametrize(
    ("shape", "shapes"),
    [
        ((64, 64, 64), [(64, 64, 64)]),
        ((65, 10, 1), [(65, 10, 1), (33, 5, 1)]),
        ((1, 1, 257), [(1, 1, 257), (1, 1, 129), (1, 1, 65), (1, 1, 33)]),
    ],
)
def test_by_default_the_pyramid_ends_with_the_first_level_that_fits_into_one_brick(
    shape: tuple[int, int, int], shapes: list[tuple[int, int, int]]
) -> None:
    assert list(level_shapes(shape, 64)) == shapes
