"""What each mode makes of a ray's samples, beside the same done by NumPy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from octobrick.codec import S3dc
from octobrick.codec.errors import InvalidInputError
from octobrick.renderer import (
    Camera,
    Clip,
    Isosurface,
    Light,
    Lighting,
    Renderer,
    Slice,
    TransferFunction,
)

from .array_source import ArraySource, Channels

pytestmark = pytest.mark.gl

GREY = TransferFunction(((0.0, (0.0, 0.0, 0.0)), (1.0, (1.0, 1.0, 1.0))), ((0.0, 1.0),))
"""As bright as the value, opaque."""
SHAPE = (12, 20, 28)


def noise(seed: int = 1, shape: tuple[int, int, int] = SHAPE) -> NDArray[np.uint8]:
    return np.random.default_rng(seed).integers(0, 256, shape).astype(np.uint8)


def along_z(shape: tuple[int, int, int] = SHAPE) -> tuple[Camera, tuple[int, int]]:
    """An orthographic camera in which each pixel is one column of voxels, rows from y = 0."""
    _, ny, nx = shape
    middle = ((nx - 1) / 2, (ny - 1) / 2)
    eye, target = (*middle, -50.0), (*middle, 0.0)
    return Camera(eye, target, (0.0, -1.0, 0.0), None, float(min(nx, ny))), (nx, ny)


def grey_of(values: NDArray[np.floating]) -> NDArray[np.float64]:
    return np.asarray(values, np.float64) / 255


@pytest.mark.parametrize("brick", [8, 32])
@pytest.mark.parametrize(
    ("mode", "reduce"), [("mip", np.max), ("minip", np.min), ("average", np.mean)]
)
def test_a_projection_is_the_statistic_of_each_column_of_voxels(
    renderer: Renderer, mode: str, reduce: object, brick: int
) -> None:
    voxels = noise()
    source = ArraySource(voxels, brick=brick, nlevels=1)
    camera, size = along_z()
    image = renderer.render(
        source, camera, GREY, size, mode=mode, window=(0, 255), step_voxels=1.0, depth=True
    )
    wanted = grey_of(reduce(voxels, axis=0))  # type: ignore[operator]
    np.testing.assert_allclose(image.premultiplied[..., 0], wanted, atol=2e-4)
    np.testing.assert_array_equal(image.premultiplied[..., 3], 1)
    if mode == "mip":
        assert image.depth is not None
        np.testing.assert_allclose(image.depth, 50 + voxels.argmax(axis=0), atol=1e-3)


@pytest.mark.parametrize("mode", ["mip", "minip", "average"])
def test_a_projection_is_transparent_where_the_function_is(renderer: Renderer, mode: str) -> None:
    function = TransferFunction(GREY.colors, ((0.0, 0.0), (1.0, 0.0)))
    camera, size = along_z()
    image = renderer.render(ArraySource(noise(), brick=8, nlevels=1), camera, function, size)
    assert not image.premultiplied.any()


def test_rays_beside_the_volume_have_no_projection(renderer: Renderer) -> None:
    source = ArraySource(np.zeros((4, 4, 4), np.uint8), brick=8, nlevels=1)
    camera = Camera((1.5, 1.5, -9.0), (1.5, 1.5, 0.0), (0.0, -1.0, 0.0), None, 12.0)
    for mode in ("mip", "minip", "average"):
        image = renderer.render(source, camera, GREY, (12, 12), mode=mode, depth=True)
        assert image.premultiplied[4:8, 4:8, 3].all()
        assert image.premultiplied[..., 3].sum() == 16


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.0, 0.0, -3e9)])
def test_a_slice_along_an_axis_is_that_slice_of_the_array(
    renderer: Renderer, normal: tuple[float, float, float]
) -> None:
    voxels = noise()
    source = ArraySource(voxels, brick=8, nlevels=1)
    camera, size = along_z()
    for z in (0, 7, 11):
        plane = Slice((3.0, 1.0, float(z)), normal)
        image = renderer.render(source, camera, GREY, size, mode=plane, window=(0, 255), depth=True)
        np.testing.assert_allclose(image.premultiplied[..., 0], grey_of(voxels[z]), atol=2e-4)
        assert image.depth is not None
        np.testing.assert_allclose(image.depth, 50 + z, atol=1e-4)
        assert image.stats.bricks["clipped"] > 0


def test_an_oblique_slice_of_a_ramp_is_that_ramp(renderer: Renderer) -> None:
    z, y, x = np.meshgrid(*(np.arange(n) for n in (40, 40, 40)), indexing="ij")
    source = ArraySource((2 * x + y + 3 * z).astype(np.uint8), brick=16, nlevels=1)
    camera, size = along_z((40, 40, 40))
    normal = np.array((0.3, -0.2, 1.0))
    plane = Slice((20.0, 20.0, 20.0), tuple(normal))
    image = renderer.render(source, camera, GREY, size, mode=plane, window=(0, 255))
    depth = 20 - ((x[0] - 20) * 0.3 - (y[0] - 20) * 0.2)
    found = image.premultiplied[4:-4, 4:-4, 0] * 255
    np.testing.assert_allclose(found, (2 * x[0] + y[0] + 3 * depth)[4:-4, 4:-4], atol=0.1)


def test_an_isosurface_of_a_ramp_lies_where_the_ramp_has_its_value(renderer: Renderer) -> None:
    z, _, x = np.meshgrid(*(np.arange(n) for n in (40, 20, 28)), indexing="ij")
    source = ArraySource((4 * z + 2 * x).astype(np.uint8), brick=8, nlevels=1)
    camera, size = along_z((40, 20, 28))
    for step_voxels in (0.3, 1.0):
        image = renderer.render(
            source, camera, GREY, size,
            mode=Isosurface(101.3), window=(0, 255), step_voxels=step_voxels, depth=True,
        )  # fmt: skip
        assert image.depth is not None
        np.testing.assert_allclose(image.depth, 50 + (101.3 - 2 * x[0]) / 4, atol=0.01)
        np.testing.assert_array_equal(image.premultiplied[..., 3], 1)
    # The gradient is (2, 0, 4): the light at the eye falls at its angle to the ray.
    facing = 4 / math.hypot(2, 4)
    lit = (101.3 / 255) * (0.25 + 0.75 * facing) + 0.2 * facing**40
    np.testing.assert_allclose(image.premultiplied[:, 4:-4, 0], lit, atol=2e-3)


def test_further_surfaces_shine_through_a_translucent_one(renderer: Renderer) -> None:
    voxels = np.zeros((40, 16, 16), np.uint8)
    voxels[8:16] = voxels[24:32] = 200
    source = ArraySource(voxels, brick=8, nlevels=1)
    camera, size = along_z((40, 16, 16))
    for opacity, ncrossings in ((1.0, 1), (0.5, 4), (0.25, 4)):
        image = renderer.render(source, camera, GREY, size, mode=Isosurface(100.0, opacity))
        wanted = 1 - (1 - opacity) ** ncrossings
        np.testing.assert_allclose(image.premultiplied[..., 3], wanted, atol=1e-5)


def test_an_isosurface_needs_one_channel_and_short_steps(renderer: Renderer) -> None:
    source = ArraySource(noise(), brick=8, nlevels=1)
    camera, size = along_z()
    with pytest.raises(InvalidInputError, match="at most 1 voxel"):
        renderer.render(source, camera, GREY, size, mode=Isosurface(9.0), step_voxels=2.0)
    two = Channels([source, source])
    with pytest.raises(InvalidInputError, match="one channel, not of 2"):
        renderer.render(two, camera, GREY, size, mode=Isosurface(9.0), c=(0, 1))


def test_clipping_is_leaving_out_what_is_not_there(renderer: Renderer) -> None:
    voxels = noise()
    camera, size = along_z()
    source = ArraySource(voxels, brick=8, nlevels=1)
    clip = Clip((4.5, 2.5, 1.5), (20.5, 15.5, 9.5))
    clipped = renderer.render(
        source, camera, GREY, size, mode="mip", window=(0, 255), step_voxels=1.0, clip=clip
    )
    wanted = np.zeros(SHAPE[1:])
    wanted[3:16, 5:21] = grey_of(voxels[2:10, 3:16, 5:21].max(axis=0))
    np.testing.assert_allclose(clipped.premultiplied[..., 0], wanted, atol=2e-4)


def test_a_clip_plane_cuts_matter_to_its_true_length(renderer: Renderer) -> None:
    source = ArraySource(np.full((40, 16, 16), 9, np.uint8), brick=8, nlevels=1)
    camera, size = along_z((40, 16, 16))
    function = TransferFunction(((0.0, (1.0, 1.0, 1.0)),), ((0.0, 0.05),))
    for at in (7.3, 20.0, 33.9):
        clip = Clip(half_spaces=((0.0, 0.0, -2.0, 2 * at),))
        for step_voxels in (0.37, 1.0, 2.2):
            image = renderer.render(
                source, camera, function, size,
                clip=clip, shading=False, step_voxels=step_voxels,
            )  # fmt: skip
            wanted = 1 - 0.95 ** (at + 0.5)
            np.testing.assert_allclose(image.premultiplied[..., 3], wanted, atol=1e-3)


def test_impossible_clips_are_refused() -> None:
    with pytest.raises(InvalidInputError, match="holds no point"):
        Clip((1.0, 0.0, 0.0), (0.0, 1.0, 1.0))
    with pytest.raises(InvalidInputError, match="a normal that has a length"):
        Clip(half_spaces=((0.0, 0.0, 0.0, 1.0),))
    with pytest.raises(InvalidInputError, match="holds"):
        Clip((math.nan, 0.0, 0.0))
    with pytest.raises(InvalidInputError, match="13 planes"):
        Clip(half_spaces=((0.0, 0.0, 1.0, 1.0),) * 13)


def test_channels_in_different_places_show_side_by_side(renderer: Renderer) -> None:
    left, right = np.zeros((2, 16, 16, 16), np.uint8)
    left[:, :, :8], right[:, :, 8:] = 200, 100
    source = Channels([ArraySource(a, brick=8, nlevels=1) for a in (left, right)])
    camera, size = along_z((16, 16, 16))
    red, green = (
        TransferFunction(((0.0, color),), ((0.0, 0.0), (60.0, 0.0), (60.0, 1.0)), "value")
        for color in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    )
    image = renderer.render(
        source, camera, (red, green), size, c=(0, 1), shading=False, step_voxels=1.0
    )
    np.testing.assert_array_equal(image.rgba[8, :7, :3], [[255, 0, 0]] * 7)
    np.testing.assert_array_equal(image.rgba[8, 9:, :3], [[0, 255, 0]] * 7)
    swapped = renderer.render(
        source, camera, (green, red), size, c=(1, 0), shading=False, step_voxels=1.0
    )
    np.testing.assert_array_equal(swapped.premultiplied, image.premultiplied)


def test_channels_in_one_place_stop_light_together(renderer: Renderer) -> None:
    solid = [np.full((16, 16, 16), value, np.uint8) for value in (1, 2, 3, 4)]
    source = Channels([ArraySource(a, brick=8, nlevels=1) for a in solid])
    camera, size = along_z((16, 16, 16))
    functions = [
        TransferFunction(((0.0, color),), ((0.0, 0.03),))
        for color in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 1.0, 1.0))
    ]
    image = renderer.render(source, camera, functions, size, c=range(4), shading=False)
    alpha = 1 - 0.97 ** (4 * 16)
    np.testing.assert_allclose(image.premultiplied[..., 3], alpha, atol=1e-3)
    np.testing.assert_allclose(image.premultiplied[..., 0], alpha / 2, atol=1e-3)


@pytest.mark.parametrize("mode", ["dvr", "mip"])
def test_rays_that_end_early_do_not_mix_up_the_channels_of_others(
    renderer: Renderer, mode: str
) -> None:
    """Lit, in perspective: beside each other lie rays of all lengths."""
    z, y, x = np.ogrid[-20:20, -20:20, -20:20]
    ball = np.clip(250 - 11 * np.sqrt(z * z + y * y + x * x), 0, None).astype(np.uint8)
    air = np.zeros_like(ball)
    source = Channels([ArraySource(a, brick=16, nlevels=1) for a in (ball, air, air)])
    camera = Camera.orbit(source, 20, 30)
    function = TransferFunction(GREY.colors, ((0.0, 0.0), (0.2, 0.0), (1.0, 0.5)))
    alone, beside = (
        renderer.render(source, camera, function, (48, 48), c=c, window=(0, 255), mode=mode)
        for c in (0, (2, 0, 1))
    )
    assert alone.premultiplied[..., 3].max() > 0.2
    np.testing.assert_allclose(beside.premultiplied, alone.premultiplied, atol=1e-4)


def test_three_channels_are_the_colours_of_their_voxels(renderer: Renderer) -> None:
    colors = np.random.default_rng(3).integers(0, 256, (3, *SHAPE)).astype(np.uint8)
    source = Channels([ArraySource(a, brick=8, nlevels=1) for a in colors])
    camera, size = along_z()
    image = renderer.render(
        source, camera, GREY, size,
        c=(0, 1, 2), rgb=True, mode=Slice((0.0, 0.0, 5.0), (0.0, 0.0, 1.0)), window=(0, 255),
    )  # fmt: skip
    np.testing.assert_allclose(image.rgba[..., :3], np.moveaxis(colors[:, 5], 0, -1), atol=1)
    with pytest.raises(InvalidInputError, match="three channels"):
        renderer.render(source, camera, GREY, size, c=(0, 1), rgb=True)


def test_a_light_from_the_side_lights_what_faces_it(renderer: Renderer) -> None:
    z, y, x = np.meshgrid(*(np.arange(n) - 20 for n in (40, 40, 40)), indexing="ij")
    ball = (255 * (np.sqrt(x**2 + y**2 + z**2) < 12)).astype(np.uint8)
    source = ArraySource(ball, brick=16, nlevels=1)
    camera, size = along_z((40, 40, 40))
    lighting = Lighting(0.0, 1.0, 0.0, lights=(Light((0.0, 1.0, 0.0), (1.0, 0.5, 0.25)),))
    image = renderer.render(source, camera, GREY, size, mode=Isosurface(128.0), shading=lighting)
    lit = image.premultiplied
    assert lit[29, 20, 0] > 0.3  # rows go with y
    assert lit[20, 20, 0] < 0.1
    np.testing.assert_allclose(lit[29, 20, :3] / lit[29, 20, 0], (1.0, 0.5, 0.25), atol=1e-4)


def test_edges_show_borders_and_not_what_lies_between(renderer: Renderer) -> None:
    voxels = np.zeros((40, 40, 40), np.uint8)
    voxels[10:30, 10:30, 10:30] = 200
    source = ArraySource(voxels, brick=16, nlevels=1)
    camera, size = along_z((40, 40, 40))
    function = TransferFunction(((0.0, (1.0, 1.0, 1.0)),), ((0.0, 0.0), (1.0, 0.1)))
    whole, edges = (
        renderer.render(source, camera, function, size, shading=False, edges=e).premultiplied
        for e in (None, (0.05, 0.3))
    )
    assert whole[20, 20, 3] > 0.8
    assert 0.05 < edges[20, 20, 3] < 0.4  # the two faces
    assert edges[20, 10, 3] > 0.5 * whole[20, 10, 3]


def test_unknown_words_and_numbers_are_refused(renderer: Renderer) -> None:
    source = ArraySource(noise(), brick=8, nlevels=1)
    camera, size = along_z()
    for wrong in (
        {"mode": "xray"}, {"mode": 3}, {"gradients": "none"}, {"gradients": "stored"},
        {"edges": (1, 1)}, {"edges": 3}, {"deblocking": math.inf}, {"c": (0, 0)}, {"c": ()},
        {"c": 1}, {"window": ((0, 1), (1, 2))},
    ):  # fmt: skip
        with pytest.raises(InvalidInputError):
            renderer.render(source, camera, GREY, size, **wrong)  # type: ignore[arg-type]
    for make in (
        lambda: Slice((0, 0, math.nan), (0, 0, 1)), lambda: Slice((0, 0, 0), (0, 0, 0)),
        lambda: Isosurface(math.nan), lambda: Isosurface(1, 0), lambda: Lighting(lights=()),
        lambda: Light((0, 0, 0)), lambda: Light(color=(-1, 0, 0)),
    ):  # fmt: skip
        with pytest.raises(InvalidInputError):
            make()


def test_s3dc_and_raw_bricks_have_the_same_modes(renderer: Renderer) -> None:
    """Where the codec loses nothing, here with two values a block."""
    voxels = (noise() // 128 * 255).astype(np.uint8)
    camera, size = along_z()
    for mode in ("mip", "average", Isosurface(100.0), Slice((0, 0, 3), (0, 0.1, 1))):
        raw, coded = (
            renderer.render(
                ArraySource(voxels, codec=codec, brick=8, nlevels=1), camera, GREY, size, mode=mode
            ).premultiplied
            for codec in (None, S3dc((4, 4, 4), 1))
        )
        np.testing.assert_array_equal(raw, coded)
