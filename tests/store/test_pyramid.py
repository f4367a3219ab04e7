"""The pyramid as a stream: what comes out depends on the voxels alone."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from octobrick.codec import gradients, metrics, reference
from octobrick.codec import reference_gradients as reference_field
from octobrick.store import frame as zstd_frame
from octobrick.store.box import Zyx, cell_box, grid_of
from octobrick.store.brick_encoder import BrickEncoder, DirectionEncoder, EncodedBrick
from octobrick.store.pyramid import Address, Pyramid, PyramidPlan
from octobrick.store.reducers import level_shapes
from octobrick.store.window import ScratchWindow, memory_window

SPACING = (2.0, 1.0, 0.5)


@pytest.fixture(scope="module")
def executor() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(3) as threads:
        yield threads


class Recorder:
    """A sink that remembers everything."""

    def __init__(self) -> None:
        self.bricks: dict[str, dict[Zyx, EncodedBrick]] = defaultdict(dict)
        self.ended: dict[str, list[int]] = defaultdict(list)
        self.histogram = metrics.Histogram()

    def wants(self, address: Address) -> bool:
        assert address.zyx not in self.bricks[address.array]
        return True

    def take(self, address: Address, encoded: EncodedBrick) -> None:
        assert (address.t, address.c) == (3, 1)
        earlier = self.bricks[address.array]
        assert not earlier or max(earlier) < address.zyx
        earlier[address.zyx] = encoded

    def count(self, t: int, c: int, histogram: metrics.Histogram) -> None:
        assert (t, c) == (3, 1)
        self.histogram += histogram

    def end_layer(self, array: str, t: int, c: int, index: int) -> None:
        assert (t, c) == (3, 1)
        assert all(z <= index for z, _, _ in self.bricks[array])
        self.ended[array].append(index)

    def array(
        self, name: str, shape: tuple[int, ...], brick: int, dtype: str
    ) -> np.ndarray[Any, Any]:
        """The voxels of all bricks together."""
        whole = np.empty(
            [n * brick for n in grid_of(shape[:3], (brick,) * 3)] + list(shape[3:]), dtype
        )
        for zyx, encoded in self.bricks[name].items():
            own = np.full((brick, brick, brick, *shape[3:]), 128 if shape[3:] else 0, dtype)
            if encoded.frame is not None:
                content = zstd_frame.decompress(encoded.frame, own.nbytes)
                own = np.frombuffer(content, dtype).reshape(own.shape)
            whole[cell_box(zyx, (brick,) * 3).slices] = own
        return whole[tuple(slice(n) for n in shape)]


def push(pyramid: Pyramid, voxels: np.ndarray[Any, Any], nplanes: int, nrows: int) -> None:
    nz, ny, _ = voxels.shape
    for z in range(0, nz, nplanes):
        for y in reversed(range(0, ny, nrows)):
            pyramid.put(z, y, voxels[z : z + nplanes, y : y + nrows])
        pyramid.complete_to(min(z + nplanes, nz))


@settings(
    max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    shape=st.tuples(st.integers(1, 45), st.integers(1, 21), st.integers(1, 21)),
    nlevels=st.integers(1, 5),
    brick=st.sampled_from([8, 10, 12]),
    nplanes=st.integers(1, 20),
    nrows=st.integers(1, 9),
    is_scratch=st.booleans(),
    seed=st.integers(0, 99),
)
def test_all_levels_and_gradients_are_those_of_the_whole_however_rows_arrive(
    executor: ThreadPoolExecutor,
    tmp_path: Path,
    shape: Zyx,
    nlevels: int,
    brick: int,
    nplanes: int,
    nrows: int,
    is_scratch: bool,
    seed: int,
) -> None:
    voxels = np.random.default_rng(seed).integers(0, 255, shape).astype(np.uint8)
    shapes = level_shapes(shape, brick, nlevels)
    plan = PyramidPlan(
        shapes_zyx=shapes,
        dtype=voxels.dtype,
        encoders=[BrickEncoder(None, brick, 1)] * nlevels,
        reducer="mean",
        spacing_zyx=SPACING,
        directions=DirectionEncoder(brick, 1),
        source_nplanes=nplanes,
        make_window=(
            (lambda _, what: ScratchWindow(*what, tmp_path)) if is_scratch else memory_window
        ),
        nahead=2,
    )
    sink = Recorder()
    push(Pyramid(plan, 3, 1, executor, sink), voxels, nplanes, nrows)

    expected, field = voxels, reference_field.central_differences(voxels, SPACING)
    for level, level_shape in enumerate(shapes):
        assert expected.shape == level_shape
        name, grid = str(level), grid_of(level_shape, (brick,) * 3)
        np.testing.assert_array_equal(sink.array(name, level_shape, brick, "uint8"), expected)
        for zyx, encoded in sink.bricks[name].items():
            box = cell_box(zyx, (brick,) * 3)
            around = expected[tuple(slice(max(s.start - 1, 0), s.stop + 1) for s in box.slices)]
            assert (encoded.low, encoded.high) == (around.min(), around.max())
        assert sink.ended[name] == list(range(grid[0]))
        if level:
            field = reference_field.reduce(field)
            name = f"gradient/{level}"
            codes = gradients.encode_directions(field)
            np.testing.assert_array_equal(sink.array(name, codes.shape, brick, "uint8"), codes)
            assert sink.ended[name] == list(range(grid[0]))
        expected = reference.mean2(expected)
    np.testing.assert_array_equal(
        sink.histogram.counts, np.bincount(voxels.ravel())[voxels.min() :]
    )


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
