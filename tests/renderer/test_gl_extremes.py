"""Scenes at the edge of what makes sense: right, or refused with what to do."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from octobrick.codec.errors import InvalidInputError
from octobrick.renderer import Camera, Clip, Isosurface, Renderer, Slice, TransferFunction
from octobrick.renderer.view import make_view

from .array_source import ArraySource

pytestmark = pytest.mark.gl

WHITE = ((0.0, (1.0, 1.0, 1.0)),)
OPAQUE = TransferFunction(WHITE, ((0.0, 1.0),))
MEDIUM = ArraySource(np.full((23, 31, 40), 7, np.uint8), brick=16, nlevels=1)
MODES = ["dvr", "mip", "average", Isosurface(3.5), Slice((20.0, 15.0, 11.0), (0.2, 1.0, 0.4))]


def path_lengths(camera: Camera, size: tuple[int, int]) -> NDArray[np.float64]:
    """World length of each pixel's ray within the medium, in float64."""
    view = make_view(camera, size, MEDIUM.levels[0])
    lengths = np.zeros(size[::-1])
    for row, column in np.ndindex(*lengths.shape):
        start = view.start_voxel.at(column + 0.5, row + 0.5)
        toward = view.toward_world.at(column + 0.5, row + 0.5)
        toward = toward / np.linalg.norm(toward)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            planes = np.array([(0 - start) / toward, ((40, 31, 23) - start) / toward])
        near, far = max(0.0, np.nanmax(planes.min(axis=0))), np.nanmin(planes.max(axis=0))
        lengths[row, column] = max(0.0, far - near)
    return lengths


@given(
    st.floats(0, 360), st.floats(-85, 85), st.sampled_from([0.5, 1.3, 4.0]),
    st.floats(1 / 64, 16), st.floats(0, 0.9), st.booleans(),
)  # fmt: skip
@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_a_constant_medium_follows_beer_and_lambert_at_any_step(
    renderer: Renderer,
    azimuth: float,
    elevation: float,
    zoom: float,
    step_voxels: float,
    opacity: float,
    parallel: bool,
) -> None:
    camera = Camera.orbit(MEDIUM, azimuth, elevation).zoomed(zoom)
    camera = camera.orthographic() if parallel else camera
    function = TransferFunction(WHITE, ((0.0, opacity),))
    image = renderer.render(
        MEDIUM, camera, function, (9, 7), shading=False, step_voxels=step_voxels
    )
    lengths = path_lengths(camera, (9, 7))
    # A ray that has no sample in the volume, because it only cuts an edge, sees nothing of it.
    sure = (lengths == 0) | (lengths > 1.001 * step_voxels)
    assume(sure.any())
    wanted = 1 - (1 - opacity) ** lengths
    np.testing.assert_allclose(image.premultiplied[..., 3][sure], wanted[sure], atol=1e-3)


def test_halving_the_step_changes_a_smooth_picture_by_less_than_a_grey_value(
    renderer: Renderer, blobs: NDArray[np.uint8]
) -> None:
    source = ArraySource(blobs, brick=32, nlevels=1)
    function = TransferFunction(
        ((0.2, (0.9, 0.3, 0.1)), (1.0, (1.0, 1.0, 0.9))), ((0.15, 0.0), (0.7, 0.06), (1.0, 0.1))
    )
    for shading in (False, True):
        for step in (1.0, 0.5):
            whole, half = (
                renderer.render(
                    source, Camera.orbit(source, 40, 25), function, (64, 64),
                    shading=shading, step_voxels=s,
                ).premultiplied
                for s in (step, step / 2)
            )  # fmt: skip
            assert np.abs(whole - half).mean() < 1 / 255


@pytest.mark.parametrize("mode", MODES)
def test_cameras_on_corners_faces_and_inside_give_finite_pictures(
    renderer: Renderer, mode: object
) -> None:
    low, high = (-0.5, -0.5, -0.5), (39.5, 30.5, 22.5)
    function = TransferFunction(WHITE, ((0.0, 0.1),))
    for eye, target in (
        (low, high), (high, low), ((-0.5, 15.0, 11.0), (20.0, 15.0, 11.0)),
        ((20.0, 15.0, 11.0), (20.0, 15.0, 12.0)), ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
        ((20.0, 15.0, 22.5), (25.0, 15.0, 22.5)),
    ):  # fmt: skip
        for fov in (40.0, 179.9):
            camera = Camera(eye, target, (0.1, 0.2, 1.0) if eye[2] == 11 else (0.3, 1.0, 0.2), fov)
            image = renderer.render(
                MEDIUM,
                camera,
                function,
                (17, 13),
                mode=mode,
                depth=True,  # type: ignore[arg-type]
            )
            assert np.isfinite(image.premultiplied).all()
            assert image.depth is not None
            assert not np.isnan(image.depth).any()


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 40, 33), (40, 1, 33), (1, 1, 70)])
def test_volumes_one_voxel_thin_have_pictures_in_all_modes(
    renderer: Renderer, mode: object, shape: tuple[int, int, int]
) -> None:
    source = ArraySource(np.full(shape, 5, np.uint8), brick=16, nlevels=1)
    middle = tuple((n - 1) / 2 for n in reversed(shape))
    if isinstance(mode, Slice):
        mode = Slice(middle, mode.normal_world_xyz)  # type: ignore[arg-type]
    for azimuth, elevation in ((0, 0), (33, 27), (0, 90)):
        image = renderer.render(
            source, Camera.orbit(source, azimuth, elevation), OPAQUE, (200, 200),
            mode=mode, depth=True,  # type: ignore[arg-type]
        )  # fmt: skip
        assert np.isfinite(image.premultiplied).all()
        # A constant volume has no surface; a plane seen from its edge has no width.
        if not isinstance(mode, (Isosurface, Slice)):
            assert image.premultiplied[..., 3].any()


def test_voxels_a_thousand_times_longer_than_wide_are_shown_in_their_proportion(
    renderer: Renderer,
) -> None:
    for spacing_xyz in ((1.0, 1.0, 1000.0), (1000.0, 1.0, 1.0)):
        source = ArraySource(
            np.full((16, 16, 16), 5, np.uint8), brick=8, nlevels=1, spacing_xyz=spacing_xyz
        )
        camera = Camera.orbit(source, 0, 0).orthographic()
        image = renderer.render(source, camera, OPAQUE, (2048, 2048), shading=False)
        seen = image.premultiplied[..., 3] > 0.5
        assert seen.any()
        height, width = seen.any(axis=1).sum(), seen.any(axis=0).sum()
        assert max(height, width) > 300 * min(height, width)
        for mode in ("mip", Slice((0.0, 5.0, 0.0), (0.0, 1.0, 0.0))):
            again = renderer.render(source, camera, OPAQUE, (64, 64), mode=mode)
            assert np.isfinite(again.premultiplied).all()


def test_pictures_may_be_8192_pixels_wide_and_no_wider_than_the_driver_allows(
    renderer: Renderer,
) -> None:
    camera = Camera.orbit(MEDIUM, 20, 10)
    function = TransferFunction(WHITE, ((0.0, 0.5),))
    image = renderer.render(MEDIUM, camera, function, (8192, 2), shading=False)
    assert image.rgba.shape == (2, 8192, 4)
    assert image.premultiplied[..., 3].any()
    with pytest.raises(InvalidInputError, match="pixels a side, the limit of this OpenGL driver"):
        renderer.render(MEDIUM, camera, function, (1 << 20, 2))
    for size in ((0, 9), (9, 0), (-1, 9)):
        with pytest.raises(InvalidInputError, match="at least 1"):
            renderer.render(MEDIUM, camera, function, size)


def test_what_is_not_finite_is_refused_by_name() -> None:
    for bad in (math.nan, math.inf):
        with pytest.raises(InvalidInputError, match="eye_world_xyz"):
            Camera((bad, 0.0, 0.0), (1.0, 0.0, 0.0))
        with pytest.raises(InvalidInputError, match="up_world_xyz"):
            Camera((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, bad, 1.0))
        with pytest.raises(InvalidInputError):
            Clip(half_spaces=((bad, 0.0, 0.0, 1.0),))


def test_a_volume_that_is_clipped_away_shows_the_background(renderer: Renderer) -> None:
    image = renderer.render(
        MEDIUM, Camera.orbit(MEDIUM), OPAQUE, (16, 16),
        clip=Clip(low_world_xyz=(100.0, 0.0, 0.0)), background=(0.0, 0.0, 1.0),
    )  # fmt: skip
    np.testing.assert_array_equal(image.rgba, np.broadcast_to((0, 0, 255, 255), (16, 16, 4)))
    assert image.stats.bricks["clipped"] == image.stats.bricks["total"]
    assert image.stats.slabs == 0
