from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from octobrick.codec import S3dc
from octobrick.codec.errors import InvalidInputError
from octobrick.renderer import Camera, TransferFunction
from octobrick.renderer.brick_ranges import brick_ranges
from octobrick.renderer.classifier import Classifier, ValueScale
from octobrick.renderer.selection import (
    Selection,
    checked_level,
    finest_useful_level,
    select_bricks,
)
from octobrick.renderer.view import View, checked_size, make_view
from octobrick.store.box import Box

from .array_source import ArraySource

WHITE = ((0.0, (1.0, 1.0, 1.0)),)


def classifier(source: ArraySource, *opacities: tuple[float, float]) -> Classifier:
    function = TransferFunction(WHITE, opacities, "value")
    return Classifier(function, ValueScale.of(source.dtype, source.value_range), (0, 255), 1.0)


def select(source: ArraySource, level: int, view: View, shown: Classifier) -> Selection:
    ranges = [(brick_ranges(source, level, 0, 0), shown.visible)]
    return select_bricks(source.levels[level], source.brick_shape_zyx, view, ranges)


def sparse() -> ArraySource:
    voxels = np.zeros((70, 60, 90), np.uint8)
    voxels[40:45, 20:25, 33:40] = 200  # brick (2, 1, 2) of 16 voxels
    return ArraySource(voxels, brick=16, nlevels=1)


def test_counts_of_all_reasons_add_up_to_the_total() -> None:
    source = sparse()
    camera = Camera.orbit(source, 30, 20).zoomed(6)
    view = make_view(camera, (64, 64), source.levels[0])
    for opacities in (((0.0, 0.0), (255.0, 1.0)), ((0.0, 0.5), (255.0, 0.5)), ((0.0, 0.0),)):
        counts = select(source, 0, view, classifier(source, *opacities)).counts
        assert counts["total"] == 5 * 4 * 6
        reasons = ("frustum", "clipped", "transparent", "sampled")
        assert counts["total"] == sum(counts[reason] for reason in reasons)


def test_only_bricks_whose_range_is_visible_are_sampled_and_neighbours_needed() -> None:
    source = sparse()
    view = make_view(Camera.orbit(source), (64, 64), source.levels[0])
    selection = select(source, 0, view, classifier(source, (100.0, 0.0), (101.0, 1.0)))
    assert np.argwhere(selection.sampled).tolist() == [[2, 1, 2]]
    assert np.argwhere(selection.needed).min(axis=0).tolist() == [1, 0, 1]
    assert np.argwhere(selection.needed).max(axis=0).tolist() == [3, 2, 3]
    assert selection.needed.sum() == 27
    assert selection.box == Box((32, 16, 32), (48, 32, 48))


def test_box_is_clipped_to_the_level() -> None:
    source = sparse()
    view = make_view(Camera.orbit(source), (64, 64), source.levels[0])
    selection = select(source, 0, view, classifier(source, (0.0, 1.0)))
    assert selection.box == Box.of_shape((70, 60, 90))


def test_nothing_visible_selects_nothing() -> None:
    source = sparse()
    view = make_view(Camera.orbit(source), (64, 64), source.levels[0])
    selection = select(source, 0, view, classifier(source, (0.0, 0.0)))
    assert not selection.sampled.any()
    assert not selection.needed.any()
    assert selection.box.nvoxels == 0


def test_lossy_neighbours_widen_a_bricks_range() -> None:
    """Stored ranges are of originals; the voxel beyond a brick is decoded from its neighbour."""
    voxels = np.zeros((16, 16, 32), np.uint8)
    voxels[:, :, 16:] = np.arange(16) * 17
    source = ArraySource(voxels, codec=S3dc((16, 16, 16), 1), brick=16, nlevels=1)
    assert source.ranges(0)[0, 0, 0].tolist() == [0, 0]
    assert source.fidelity(0)[0, 0, 1, 0] > 100
    view = make_view(Camera.orbit(source), (64, 64), source.levels[0])
    selection = select(source, 0, view, classifier(source, (50.0, 0.0), (51.0, 1.0)))
    assert selection.sampled.all()


@given(
    st.floats(0, 360), st.floats(-90, 90), st.floats(0.3, 30), st.floats(2, 150), st.booleans(),
    st.tuples(st.integers(1, 50), st.integers(1, 50)),
)  # fmt: skip
@settings(max_examples=40)
def test_every_sample_in_view_lies_in_a_brick_in_view(
    azimuth: float, elevation: float, zoom: float, fov: float, orthographic: bool,
    size: tuple[int, int],
) -> None:  # fmt: skip
    source = sparse()
    camera = Camera.orbit(source, azimuth, elevation, fov_degrees=fov).zoomed(zoom)
    if orthographic:
        camera = camera.orthographic()
    level = source.levels[0]
    view = make_view(camera, size, level)
    sampled = select(source, 0, view, classifier(source, (0.0, 1.0))).sampled
    rng = np.random.default_rng(1)
    columns, rows = rng.uniform(0, size[0], 200), rng.uniform(0, size[1], 200)
    shape_xyz = np.array(level.shape_zyx[::-1])
    for column, row in zip(columns, rows, strict=True):
        start = view.start_voxel.at(column, row)
        toward = view.toward_world.at(column, row) / np.array(level.spacing_xyz)
        at = start + np.linspace(0, 400, 300)[:, None] * toward / np.linalg.norm(toward)
        inside = at[((at >= 0) & (at < shape_xyz)).all(axis=1)]
        base = np.clip(np.floor(inside - 0.5), 0, shape_xyz - 1).astype(int)
        x, y, z = (base // 16).T
        assert sampled[z, y, x].all()


def test_level_is_the_coarsest_with_a_voxel_for_every_pixel() -> None:
    source = ArraySource(np.zeros((128, 128, 128), np.uint8), brick=16)
    assert len(source.levels) == 4
    camera = Camera((63.5, -1000.0, 63.5), (63.5, 63.5, 63.5), fov_degrees=None, height_world=128.0)
    wanted = {1: 3, 15: 3, 16: 3, 17: 2, 32: 2, 33: 1, 64: 1, 65: 0, 128: 0, 1000: 0}
    found = {pixels: finest_useful_level(source, camera, (pixels, pixels)) for pixels in wanted}
    assert found == wanted


def test_level_is_monotone_in_distance_and_finest_inside() -> None:
    source = ArraySource(np.zeros((128, 128, 128), np.uint8), brick=16)
    levels = [
        finest_useful_level(source, Camera.orbit(source, 30, 20, d), (200, 200))
        for d in (1, 60, 150, 300, 600, 1200, 2400, 1e5)
    ]
    assert levels == sorted(levels)
    assert levels[0] == 0
    assert levels[-1] == 3


@pytest.mark.parametrize("level", [-1, 4, 1.0, "0"])
def test_levels_that_do_not_exist_are_refused(level: object) -> None:
    source = ArraySource(np.zeros((128, 128, 128), np.uint8), brick=16)
    with pytest.raises(InvalidInputError, match="levels 0 to 3"):
        checked_level(source, level)  # type: ignore[arg-type]


@pytest.mark.parametrize("size", [(0, 5), (5, 0), (-1, 5), (5,), (5, 5, 5), (5.0, 5), (True, 5), 5])
def test_impossible_pictures_are_refused(size: object) -> None:
    with pytest.raises(InvalidInputError, match="picture size"):
        checked_size(size)  # type: ignore[arg-type]


def test_pictures_beyond_the_driver_are_refused_with_its_limit() -> None:
    with pytest.raises(InvalidInputError, match="16384 pixels a side") as caught:
        checked_size((20000, 5), 16384)
    assert caught.value.facts == {"size": [20000, 5], "limit": 16384}
