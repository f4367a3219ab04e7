"""Model only what a scene requires: over real volumes, dropping bricks changes no bit."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from octobrick.codec import S3dc
from octobrick.renderer import Camera, Clip, Isosurface, Renderer, Slice, TransferFunction
from octobrick.store.box import Box
from octobrick.store.sources import open_source

from .array_source import ArraySource

pytestmark = pytest.mark.gl

ROOT = Path(__file__).parents[2]
SHARED = ROOT.parent / "shared" / "data"
# The bundled volume, and others where they are: CT, MR angiography, simulation.
SOURCES = [
    ROOT / "data" / "ct_vhf_head.mhd",
    *(
        path
        for name in ("ct_bonsai.nii.gz", "mra_avf_f32.nrrd", "sim_heptane.nii.gz")
        if (path := SHARED / name).exists()
    ),
]
SIDE = 80

unit = st.floats(0, 1)


@pytest.fixture(scope="module")
def thinner() -> Iterator[Renderer]:
    """Cuts the crops into several slabs, also those of float32."""
    with Renderer("8MiB", slab_budget="1MiB") as made:
        yield made


@functools.cache
def crop_of(path: Path) -> NDArray[np.generic]:
    """The middle of a volume."""
    with open_source(path) as source:
        shape = source.shape_zyx
        start = tuple(max(0, (n - SIDE) // 2) for n in shape)
        stop = tuple(min(n, s + SIDE) for n, s in zip(shape, start, strict=True))
        return source.read(Box(start, stop))  # type: ignore[arg-type]


@functools.cache
def source_of(path: Path, codec: S3dc | None) -> ArraySource:
    return ArraySource(crop_of(path), codec=codec, brick=16, nlevels=1)


@st.composite
def functions(draw: st.DrawFn) -> TransferFunction:
    """Mostly transparent, with one or two bands of values that are not."""
    at = sorted(draw(st.lists(unit, min_size=3, max_size=6)))
    heights = [draw(st.sampled_from([0.0, 0.0, 0.04, 0.5, 1.0])) for _ in at]
    colors = ((0.0, (0.1, 0.3, 0.9)), (1.0, (1.0, 0.8, 0.3)))
    return TransferFunction(colors, tuple(zip(at, heights, strict=True)))


@st.composite
def cameras(draw: st.DrawFn) -> Camera:
    target = draw(st.tuples(*[st.floats(0.2 * SIDE, 0.8 * SIDE)] * 3))
    outward = draw(st.tuples(*[st.floats(-1, 1)] * 3))
    if max(map(abs, outward)) < 0.1:
        outward = (0.5, -0.7, 0.4)
    distance = draw(st.sampled_from([0.1, 0.7, 2.0, 5.0])) * SIDE
    eye = tuple(t + distance * o for t, o in zip(target, outward, strict=True))
    up = (0.3, 0.2, 1.0) if abs(outward[2]) < 0.9 * max(map(abs, outward)) else (0.1, 1.0, 0.3)
    camera = Camera(eye, target, up, draw(st.sampled_from([10.0, 40.0, 100.0])))  # type: ignore[arg-type]
    return camera.orthographic() if draw(st.booleans()) else camera


@st.composite
def scenes(draw: st.DrawFn) -> dict[str, object]:
    source = source_of(draw(st.sampled_from(SOURCES)), draw(st.sampled_from([None, S3dc()])))
    low, high = source.window
    point = draw(st.tuples(*[st.floats(0, SIDE)] * 3))
    normal = draw(st.sampled_from([(0.0, 0.0, 1.0), (1.0, 0.4, -0.3), (-0.2, 1.0, 0.7)]))
    mode = draw(
        st.sampled_from(
            ["dvr", "dvr", "dvr", "mip", "minip", "average",
             Isosurface(low + draw(unit) * (high - low), 0.6), Slice(point, normal)]
        )
    )  # fmt: skip
    clip = draw(
        st.sampled_from(
            [None, None, Clip(low_world_xyz=point), Clip(half_spaces=((*normal, -30.0),))]
        )
    )
    return {
        "volume": source,
        "camera": draw(cameras()),
        "transfer_function": draw(functions()),
        "mode": mode,
        "clip": clip,
        "shading": draw(st.booleans()),
        "step_voxels": draw(st.sampled_from([0.5, 1.0])),
    }


@given(scenes())
@settings(
    max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_dropping_bricks_changes_no_bit_of_a_picture_of_a_real_volume(
    renderer: Renderer, unculled: Renderer, thinner: Renderer, scene: dict[str, object]
) -> None:
    wanted, culled, cut = (
        each.render(size=(24, 20), level=0, depth=True, **scene)  # type: ignore[arg-type]
        for each in (unculled, renderer, thinner)
    )
    assert np.isfinite(wanted.premultiplied).all()
    for found in (culled, cut):
        np.testing.assert_array_equal(found.premultiplied, wanted.premultiplied)
        assert culled.stats.bricks["sampled"] <= wanted.stats.bricks["sampled"]


def test_culling_saves_bricks_and_bytes_on_a_real_volume(unculled: Renderer) -> None:
    source = source_of(SOURCES[0], S3dc())
    bone = TransferFunction.preset("ct-bone")
    camera = Camera.orbit(source, 30, 20).zoomed(2)
    with Renderer("64MiB") as fresh:
        some = fresh.render(source, camera, bone, (64, 64), level=0).stats
    every = unculled.render(source, camera, bone, (64, 64), level=0).stats
    assert some.bricks["sampled"] < every.bricks["sampled"] == every.bricks["total"]
    every_nbytes = every.bricks["total"] * len(source.brick_code(0, (2, 2, 2)) or b"")
    assert 0 < some.uploaded_nbytes < every_nbytes
