"""Whatever the view and the transfer function, the tricks do not show."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from octobrick.codec import S3dc
from octobrick.renderer import Camera, Renderer, TransferFunction

from .array_source import ArraySource

pytestmark = pytest.mark.gl

unit = st.floats(0, 1)
colors = st.lists(st.tuples(unit, st.tuples(unit, unit, unit)), min_size=1, max_size=4)
opacities = st.lists(
    st.tuples(unit, st.sampled_from([0.0, 0.0, 0.0, 0.02, 0.3, 1.0])), min_size=2, max_size=7
)


@st.composite
def functions(draw: st.DrawFn) -> TransferFunction:
    return TransferFunction(
        tuple(sorted(draw(colors), key=lambda p: p[0])),
        tuple(sorted(draw(opacities), key=lambda p: p[0])),
    )


@st.composite
def cameras(draw: st.DrawFn) -> Camera:
    """Around, far or near, or inside the 83 x 70 x 59 voxels of the blobs."""
    target = draw(st.tuples(st.floats(0, 83), st.floats(0, 70), st.floats(0, 59)))
    eye = draw(st.tuples(*[st.floats(-150, 250)] * 3))
    up = draw(st.sampled_from([(0.0, 0.0, 1.0), (0.0, 1.0, 0.1), (1.0, 0.1, 0.2)]))
    if max(abs(a - b) for a, b in zip(eye, target, strict=True)) < 1:
        eye = (-60.0, -70.0, 90.0)
    view = np.subtract(target, eye)
    if np.linalg.norm(np.cross(view, up)) < 0.01 * np.linalg.norm(view):
        up = (0.3, 1.0, 0.7)
    camera = Camera(eye, target, up, draw(st.sampled_from([3.0, 25.0, 60.0, 130.0])))
    return camera.orthographic() if draw(st.booleans()) else camera


@functools.cache
def source_of(key: bytes, shape: tuple[int, ...], codec: S3dc | None, brick: int) -> ArraySource:
    voxels = np.frombuffer(key, np.uint8).reshape(shape)
    return ArraySource(voxels, codec=codec, brick=brick, nlevels=1)


@given(
    cameras(), functions(), st.booleans(), st.sampled_from([0.5, 1.0, 3.3]),
    st.sampled_from([(None, 16), (S3dc(), 16), (S3dc((4, 4, 4), 1), 32)]),
)  # fmt: skip
@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_dropping_skipping_and_cutting_change_no_bit(
    renderer: Renderer,
    unculled: Renderer,
    thin: Renderer,
    blobs: NDArray[np.uint8],
    camera: Camera,
    function: TransferFunction,
    shading: bool,
    step_voxels: float,
    coding: tuple[S3dc | None, int],
) -> None:
    source = source_of(blobs.tobytes(), blobs.shape, *coding)
    wanted, culled, cut = (
        each.render(
            source, camera, function, (41, 30), shading=shading, step_voxels=step_voxels, level=0
        )
        for each in (unculled, renderer, thin)
    )
    assert np.isfinite(wanted.premultiplied).all()
    np.testing.assert_array_equal(culled.premultiplied, wanted.premultiplied)
    np.testing.assert_array_equal(cut.premultiplied, wanted.premultiplied)
