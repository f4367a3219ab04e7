"""Pictures that can be computed by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from octobrick.codec import S3dc
from octobrick.codec.errors import InvalidInputError
from octobrick.renderer import Camera, Lighting, Renderer, TransferFunction

from .array_source import ArraySource

pytestmark = pytest.mark.gl

WHITE = ((0.0, (1.0, 1.0, 1.0)),)


def uniform(
    opacity: float, color: tuple[float, float, float] = (1.0, 1.0, 1.0)
) -> TransferFunction:
    """The same colour and opacity for every value."""
    return TransferFunction(((0.0, color),), ((0.0, opacity),))


def box_source(value: int = 100, shape: tuple[int, int, int] = (40, 30, 50)) -> ArraySource:
    return ArraySource(np.full(shape, value, np.uint8), brick=16, nlevels=1, fill_value=1)


def facing(source: ArraySource, axis: int, sign: int) -> Camera:
    """An orthographic camera that looks along an axis (0 = x)."""
    eye, up = [24.5, 14.5, 19.5], (0.0, 1.0, 0.0) if axis == 2 else (0.0, 0.0, 1.0)
    target = (24.5, 14.5, 19.5)
    eye[axis] -= sign * 200.0
    return Camera((eye[0], eye[1], eye[2]), target, up, None, 20.0)


@pytest.mark.parametrize("step_voxels", [0.25, 1.0, 1.7])
@pytest.mark.parametrize(("axis", "sign"), [(0, 1), (0, -1), (1, 1), (1, -1), (2, 1), (2, -1)])
def test_constant_volume_has_the_opacity_of_its_depth(
    renderer: Renderer, axis: int, sign: int, step_voxels: float
) -> None:
    source, opacity = box_source(), 0.02
    image = renderer.render(
        source, facing(source, axis, sign), uniform(opacity), (16, 12),
        shading=False, step_voxels=step_voxels,
    )  # fmt: skip
    depth = source.levels[0].shape_zyx[2 - axis]
    nsamples = depth / step_voxels
    wanted = 1 - (1 - opacity) ** depth
    # A step may be cut at both ends: at most one sample more or less.
    tolerance = 1 / 255 if nsamples == round(nsamples) else opacity * step_voxels
    np.testing.assert_allclose(image.premultiplied[..., 3], wanted, atol=tolerance)


def test_anisotropic_voxels_count_by_their_world_length(renderer: Renderer) -> None:
    voxels = np.full((20, 20, 20), 9, np.uint8)
    source = ArraySource(voxels, brick=16, spacing_xyz=(1.0, 1.0, 3.0), nlevels=1)
    for elevation, length in ((0.0, 20.0), (90.0, 60.0)):
        camera = Camera.orbit(source, 0, elevation).orthographic()
        image = renderer.render(source, camera, uniform(0.03), (9, 9), shading=False)
        assert image.premultiplied[4, 4, 3] == pytest.approx(1 - 0.97**length, abs=1 / 255)


def test_linear_ramp_shows_each_value_at_its_place(renderer: Renderer) -> None:
    ramp = np.broadcast_to(np.arange(0, 240, 6, dtype=np.uint8), (8, 8, 40))
    source = ArraySource(ramp, brick=16, nlevels=1, window=(0, 255))
    grey = TransferFunction(((0.0, (0.0, 0.0, 0.0)), (1.0, (1.0, 1.0, 1.0))), ((0.0, 1.0),))
    camera = Camera((19.5, -50.0, 3.5), (19.5, 3.5, 3.5), (0, 0, 1), None, 8.0)
    image = renderer.render(source, camera, grey, (400, 80), shading=False)
    x = (np.arange(400) + 0.5) / 10  # ten pixels a voxel, from its face on
    wanted = np.interp(x - 0.5, np.arange(40), np.arange(0, 240, 6)) / 255
    np.testing.assert_allclose(image.premultiplied[40, :, 0], wanted, atol=1.01 / 4095)


def test_interpolation_is_finer_than_8_bits(renderer: Renderer) -> None:
    """Mesa interpolates 8-bit textures in 8 bits, unless the sampler is chosen with care."""
    step = np.broadcast_to(np.array([100, 100, 101, 101], np.uint8), (4, 4, 4))
    source = ArraySource(step, brick=8, window=(100, 101))
    grey = TransferFunction(((0.0, (0.0, 0.0, 0.0)), (1.0, (1.0, 1.0, 1.0))), ((0.0, 1.0),))
    camera = Camera((1.5, -20.0, 1.5), (1.5, 1.5, 1.5), (0, 0, 1), None, 1.0)
    image = renderer.render(source, camera, grey, (64, 64), shading=False)
    assert len(np.unique(image.rgba[32, :, 0])) >= 60


def test_empty_transfer_function_leaves_the_background_exactly(renderer: Renderer) -> None:
    source = box_source()
    for shading in (False, True):
        image = renderer.render(
            source, Camera.orbit(source), uniform(0.0), (20, 10),
            shading=shading, background=(0.2, 0.4, 1.0),
        )  # fmt: skip
        assert (image.rgba == (51, 102, 255, 255)).all()
        assert not image.premultiplied.any()
        assert image.stats.uploaded_nbytes == 0
        assert image.stats.bricks["transparent"] == image.stats.bricks["total"]


def test_empty_transfer_function_without_background_is_transparent(renderer: Renderer) -> None:
    source = box_source()
    image = renderer.render(source, Camera.orbit(source), uniform(0.0), (8, 8), background=None)
    assert not image.rgba.any()


def test_opaque_transfer_function_is_opaque_wherever_the_volume_is(renderer: Renderer) -> None:
    source = box_source()
    image = renderer.render(
        source, facing(source, 1, 1), uniform(1.0, (0.2, 0.6, 1.0)), (24, 16),
        shading=False, background=None,
    )  # fmt: skip
    assert (image.rgba == (51, 153, 255, 255)).all()
    assert (image.premultiplied[..., 3] == 1).all()


def test_straight_alpha_keeps_the_colour_of_thin_matter(renderer: Renderer) -> None:
    source = box_source()
    image = renderer.render(
        source, facing(source, 1, 1), uniform(0.005, (1.0, 0.5, 0.25)), (8, 8),
        shading=False, background=None,
    )  # fmt: skip
    alpha = 1 - 0.995**30
    assert abs(int(image.rgba[4, 4, 3]) - 255 * alpha) <= 1
    np.testing.assert_allclose(image.rgba[4, 4, :3], (255, 127.5, 63.75), atol=1)


@pytest.mark.parametrize("shading", [False, True])
def test_the_step_does_not_change_the_picture(
    renderer: Renderer, blobs: np.ndarray, shading: bool
) -> None:
    source = ArraySource(blobs, brick=32, nlevels=1)
    function = TransferFunction(
        ((0.2, (0.9, 0.3, 0.1)), (1.0, (1.0, 1.0, 0.9))), ((0.15, 0.0), (0.7, 0.06), (1.0, 0.1))
    )
    pictures = [
        renderer.render(
            source, Camera.orbit(source, 40, 25), function, (64, 64),
            shading=shading, step_voxels=step,
        ).premultiplied
        for step in (0.125, 0.25, 0.5, 1.0)
    ]  # fmt: skip
    for picture, tolerance in zip(pictures[1:], (0.006, 0.012, 0.03), strict=True):
        # Light changes faster along a ray than opacity does.
        assert np.abs(picture - pictures[0]).max() <= tolerance * (1 + shading)


def test_a_surface_that_faces_the_eye_gets_all_the_light(renderer: Renderer) -> None:
    voxels = np.zeros((16, 24, 16), np.uint8)
    voxels[:, 12:] = 200
    source = ArraySource(voxels, brick=16, nlevels=1)
    function = TransferFunction(WHITE, ((100.0, 0.0), (101.0, 1.0)), "value")
    light = Lighting(ambient=0.1, diffuse=0.5, specular=0.0)
    image = renderer.render(
        source, Camera.orbit(source).orthographic(), function, (9, 9),
        shading=light, step_voxels=0.1,
    )  # fmt: skip
    assert image.premultiplied[4, 4, 0] == pytest.approx(0.6, abs=0.005)


def test_no_gradient_means_ambient_light_only(renderer: Renderer) -> None:
    source = box_source()
    light = Lighting(ambient=0.25, diffuse=0.75, specular=0.5)
    image = renderer.render(
        source, facing(source, 0, 1), uniform(1.0), (9, 9), shading=light, background=None
    )
    np.testing.assert_allclose(image.premultiplied[..., :3], 0.25, atol=1e-6)
    assert np.isfinite(image.premultiplied).all()


@pytest.mark.parametrize(
    ("eye", "target"),
    [
        ((24.5, 14.5, 19.5), (100.0, 14.5, 19.5)),  # in the middle
        ((24.5, 14.5, 19.5), (30.0, 90.0, 60.0)),  # in the middle, along no axis
        ((-0.5, 14.5, 19.5), (100.0, 14.5, 19.5)),  # on a face
        ((-0.5, -0.5, -0.5), (100.0, 14.5, 19.5)),  # on a corner
        ((24.5, 14.5, 31.5), (24.5, 14.5, 100.0)),  # on the border of two bricks
        ((16.0, 16.0, 16.0), (16.0, 16.0, 17.0)),  # on one voxel, one voxel from the target
    ],
)
def test_camera_inside_sees_what_lies_ahead(
    renderer: Renderer, eye: tuple[float, float, float], target: tuple[float, float, float]
) -> None:
    source = box_source()
    camera = Camera(eye, target, (0.0, 0.3, 1.0), 20.0)
    image = renderer.render(source, camera, uniform(0.02), (33, 33), shading=False)
    assert np.isfinite(image.premultiplied).all()
    direction = np.subtract(target, eye) / math.dist(target, eye)
    high = np.array(source.levels[0].shape_zyx[::-1]) - 0.5
    with np.errstate(divide="ignore", invalid="ignore"):
        exits = np.where(
            direction > 0, (high - eye) / direction, (-0.5 - np.array(eye)) / direction
        )
    depth = np.nanmin(np.where(direction == 0, np.inf, exits))
    assert image.premultiplied[16, 16, 3] == pytest.approx(1 - 0.98**depth, abs=0.02)


def test_camera_that_looks_away_sees_the_background(renderer: Renderer) -> None:
    source = box_source()
    camera = Camera((24.5, -30.0, 19.5), (24.5, -90.0, 19.5))
    image = renderer.render(source, camera, uniform(1.0), (16, 16), background=(0, 0, 1))
    assert (image.rgba == (0, 0, 255, 255)).all()
    assert image.stats.bricks["frustum"] == image.stats.bricks["total"]


@pytest.mark.parametrize("fov_degrees", [1e-3, 1.0, 120.0, 179.9])
def test_extreme_angles_give_finite_pictures(renderer: Renderer, fov_degrees: float) -> None:
    source = box_source()
    for eye in ((24.5, -300.0, 19.5), (24.5, 10.0, 19.5)):
        image = renderer.render(
            source,
            Camera(eye, (24.5, 14.5, 19.5), fov_degrees=fov_degrees),
            uniform(0.05),
            (17, 17),
        )
        assert np.isfinite(image.premultiplied).all()
        assert image.premultiplied[8, 8, 3] > 0.5


def test_a_camera_very_far_away_sees_the_same(renderer: Renderer, blobs: np.ndarray) -> None:
    """Positions are exact to a part of a voxel, whatever the distance of the eye."""
    source = ArraySource(blobs, brick=32, nlevels=1)
    near = Camera.orbit(source, 30, 20, 1e5).orthographic()
    function = TransferFunction(WHITE, ((0.2, 0.0), (0.6, 0.3)))
    wanted = renderer.render(source, near, function, (48, 48), shading=False, level=0)
    fov = math.degrees(2 * math.atan((near.height_world or 0) / 2 / 1e7))
    far = Camera.orbit(source, 30, 20, 1e7, fov)
    found = renderer.render(source, far, function, (48, 48), shading=False, level=0)
    assert np.abs(found.premultiplied - wanted.premultiplied).max() < 0.02


def test_the_smallest_volume_is_seen(renderer: Renderer) -> None:
    source = ArraySource(np.full((1, 1, 1), 5, np.uint8), brick=8)
    image = renderer.render(source, Camera.orbit(source), uniform(1.0), (32, 32), shading=True)
    assert 0.1 < image.premultiplied[..., 3].mean() < 0.9


@pytest.mark.parametrize("shape", [(1, 40, 33), (40, 1, 33), (3, 2, 70)])
def test_flat_volumes_are_seen_from_all_sides(
    renderer: Renderer, shape: tuple[int, int, int]
) -> None:
    source = ArraySource(np.full(shape, 5, np.uint8), brick=16)
    for azimuth, elevation in ((0, 0), (90, 0), (0, 90), (33, 27)):
        camera = Camera.orbit(source, azimuth, elevation)
        image = renderer.render(source, camera, uniform(1.0), (64, 64))
        assert image.premultiplied[..., 3].any()
        assert np.isfinite(image.premultiplied).all()


def test_lossy_and_lossless_bricks_of_a_smooth_volume_look_alike(renderer: Renderer) -> None:
    z, y, x = np.meshgrid(*(np.linspace(-1, 1, n) for n in (60, 64, 70)), indexing="ij")
    voxels = np.rint(250 * np.exp(-2.5 * (x**2 + 1.5 * y**2 + z**2))).astype(np.uint8)
    function = TransferFunction(
        ((0.2, (0.3, 0.2, 0.9)), (0.8, (1.0, 0.8, 0.5))), ((0.2, 0.0), (0.8, 0.3))
    )
    exact, coded = (
        renderer.render(
            ArraySource(voxels, codec=codec, brick=32, nlevels=1),
            Camera.orbit(ArraySource(voxels, brick=32, nlevels=1), 30, 20), function, (96, 96),
        ).premultiplied
        for codec in (None, S3dc())
    )  # fmt: skip
    mse = float(((exact - coded).astype(np.float64) ** 2).mean())
    assert 10 * math.log10(1 / mse) >= 45


@pytest.mark.parametrize("spacing", [1e-38, 1e-9, 1e9, 1e37])
def test_voxels_of_any_world_size_give_the_same_picture(
    renderer: Renderer, blobs: np.ndarray, spacing: float
) -> None:
    function = TransferFunction(WHITE, ((0.2, 0.0), (0.6, 0.3)))
    pictures = []
    for scale in (1.0, spacing):
        spacing_xyz = (scale, 1.5 * scale, scale)
        source = ArraySource(blobs, brick=32, nlevels=1, spacing_xyz=spacing_xyz)
        camera = Camera.orbit(source, 30, 20)
        pictures.append(renderer.render(source, camera, function, (48, 48)).premultiplied)
    assert pictures[0].any()
    np.testing.assert_allclose(pictures[1], pictures[0], atol=0.01)


@pytest.mark.parametrize("far", [1e12, 1e300])
def test_cameras_beyond_all_precision_are_refused(renderer: Renderer, far: float) -> None:
    source = box_source()
    for camera in (
        Camera((far, 0.0, 0.0), (0.0, 0.0, 0.0)),
        Camera((9.0, 0.0, 0.0), (0.0, 0.0, 0.0), fov_degrees=None, height_world=far),
    ):
        with pytest.raises(InvalidInputError, match="diagonals"):
            renderer.render(source, camera, uniform(0.1), (8, 8))
