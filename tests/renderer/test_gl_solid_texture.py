"""A mesh shows the colours of its solid texture, and of nothing that is not stored."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from octobrick.codec import Zerobit
from octobrick.codec.errors import InvalidInputError
from octobrick.renderer import (
    Camera,
    PictureTooLargeError,
    RenderedImage,
    Renderer,
    TransferFunction,
)
from octobrick.store import Mesh, Placement, Volume, ingest, open_volume

pytestmark = pytest.mark.gl

SHAPE = (36, 40, 44)  # z, y, x; nothing divides it
SIZE = (90, 70)
STEP = 5  # of a colour from voxel to voxel
IDENTITY = Placement.of_numbers((1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0))


def sphere(radius: float = 16.0, centre: tuple[float, float, float] = (21.5, 19.5, 17.5)) -> Mesh:
    """Rings of longitude and latitude, with degenerate triangles at the poles."""
    theta, phi = np.linspace(0, np.pi, 25), np.linspace(0, 2 * np.pi, 48, endpoint=False)
    t, p = np.meshgrid(theta, phi, indexing="ij")
    unit = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], -1).reshape(-1, 3)
    i, j = (n.ravel() for n in np.meshgrid(np.arange(24), np.arange(48), indexing="ij"))
    a, b = i * 48 + j, i * 48 + (j + 1) % 48
    faces = np.concatenate([np.stack([a, a + 48, b], 1), np.stack([b, a + 48, b + 48], 1)])
    return Mesh(np.array(centre) + radius * unit, faces, name="sphere")


BALL = sphere()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("texture")
    axes = np.meshgrid(*(np.arange(n) for n in SHAPE), indexing="ij")
    np.save(path / "ramp.npy", (np.stack(axes[::-1]) * STEP + 20).astype(np.uint8))
    cells = np.random.default_rng(3).integers(1, 6, (3, *(n // 4 for n in SHAPE))) * 40
    few = cells.repeat(4, 1).repeat(4, 2).repeat(4, 3)
    np.save(path / "few.npy", few.astype(np.uint8))
    return path


def opened(folder: Path, array: str, name: str, **options: Any) -> Volume:
    options = {"codec": None, "brick": 16, "axes": "czyx", "workers": 1} | options
    ingest(folder / array, folder / name, **options)
    return open_volume(folder / name)


@pytest.fixture(scope="module")
def ramp(folder: Path) -> Iterator[Volume]:
    """Red, green and blue grow by `STEP` for each voxel along x, y and z."""
    with opened(folder, "ramp.npy", "ramp.zarr") as volume:
        yield volume


def draw(renderer: Renderer, volume: Volume, mesh: Mesh = BALL, **how: Any) -> RenderedImage:
    camera = how.pop("camera", None) or Camera.orbit(volume, 30, 20)
    how = {"placement": IDENTITY, "shading": False, "background": None, "level": 0} | how
    return renderer.render_mesh(volume, mesh, camera, SIZE, **how)


def places_on_ball(camera: Camera, *, inside: bool = False) -> NDArray[np.float64]:
    """Where rays through the middles of pixels meet the true sphere; NaN where they do not."""
    right, up, forward = camera.basis_world()
    eye, centre = np.array(camera.eye_world_xyz), np.array([21.5, 19.5, 17.5])
    assert camera.fov_degrees is not None
    pixel = 2 * np.tan(np.radians(camera.fov_degrees) / 2) / min(SIZE)
    x = (np.arange(SIZE[0]) + 0.5 - SIZE[0] / 2) * pixel
    y = (np.arange(SIZE[1]) + 0.5 - SIZE[1] / 2) * pixel
    ray = forward + x[np.newaxis, :, np.newaxis] * right - y[:, np.newaxis, np.newaxis] * up
    ray /= np.linalg.norm(ray, axis=2, keepdims=True)
    along = ray @ (centre - eye)
    squared = along**2 - ((centre - eye) ** 2).sum() + 16.0**2
    with np.errstate(invalid="ignore"):
        t = along + np.sqrt(squared) if inside else along - np.sqrt(squared)
    return np.asarray(eye + t[..., np.newaxis] * ray)


@pytest.mark.parametrize("level", [0, 1])
@pytest.mark.parametrize("sampling", ["linear", "nearest"])
def test_colours_are_those_of_the_places(
    renderer: Renderer, ramp: Volume, sampling: str, level: int
) -> None:
    camera = Camera.orbit(ramp, 30, 20)
    image = draw(renderer, ramp, camera=camera, sampling=sampling, level=level)
    places = places_on_ball(camera)
    whole = np.isfinite(places).all(axis=2) & (image.rgba[..., 3] == 255)
    assert whole.sum() > 600
    texel = 2**level
    if sampling == "nearest":
        places = (np.floor((places + 0.5) / texel) + 0.5) * texel - 0.5
    error = np.abs(image.rgba[..., :3] - (places * STEP + 20))[whole]
    # Linear interpolation of a ramp is the ramp; but the mesh lies up to 0.14 voxels inside of the
    # sphere, more where it is seen from the side. A nearest voxel may be the next one there, and
    # pixels on the edge of two triangles have the mean of both.
    if sampling == "linear":
        assert np.quantile(error, 0.9) <= 2
        assert error.max() <= STEP
    else:
        assert np.quantile(error, 0.5) <= 0.5  # rounding of the mean
        assert error.max() <= 1.1 * STEP * texel
    assert image.fidelity.level == level


@pytest.mark.parametrize("sampling", ["linear", "nearest"])
@pytest.mark.parametrize(
    ("array", "codec"), [("ramp.npy", None), ("few.npy", Zerobit(1.0))], ids=["exact", "zerobit"]
)
def test_selective_and_whole_coding_give_the_same_picture_in_every_pixel(
    renderer: Renderer, folder: Path, array: str, codec: Any, sampling: str
) -> None:
    """Cells of five colours are within zerobit's codebooks, so that it loses nothing either way."""
    options = {"codec": codec, "levels": 2}
    with (
        opened(folder, array, f"{sampling}-whole.zarr", overwrite=True, **options) as whole,
        opened(
            folder,
            array,
            f"{sampling}-part.zarr",
            overwrite=True,
            surface=BALL,
            surface_placement=IDENTITY,
            **options,
        ) as part,
    ):
        assert (part.read(0) == 0).mean() > 0.4
        # Edge-on triangles, where a pixel is many voxels, and from within.
        within = Camera.look_at((21, 19, 17), (40, 25, 20), fov_degrees=100)
        for level in (0, 1):
            for camera in (Camera.orbit(whole, 40, 25), Camera.orbit(whole, 200, -60), within):
                a, b = (
                    draw(renderer, v, camera=camera, sampling=sampling, level=level, shading=True)
                    for v in (whole, part)
                )
                assert a.rgba[..., 3].any()
                np.testing.assert_array_equal(a.premultiplied, b.premultiplied)


def test_a_camera_inside_sees_the_far_side(renderer: Renderer, ramp: Volume) -> None:
    camera = Camera.look_at((20, 18, 16), (60, 30, 20), fov_degrees=90)
    image = draw(renderer, ramp, camera=camera)
    assert (image.rgba[..., 3] == 255).all()
    error = np.abs(image.rgba[..., :3] - (places_on_ball(camera, inside=True) * STEP + 20))
    assert np.quantile(error, 0.9) <= 3


def test_the_nearest_surface_hides_what_is_behind(renderer: Renderer, ramp: Volume) -> None:
    inner = sphere(8.0)
    count = len(BALL.vertices_xyz)
    both = Mesh(
        np.concatenate([inner.vertices_xyz, BALL.vertices_xyz]),
        np.concatenate([inner.faces, BALL.faces + count]),
    )
    a, b = draw(renderer, ramp, BALL), draw(renderer, ramp, both)
    np.testing.assert_array_equal(a.rgba, b.rgba)


def test_orthographic_and_perspective_agree_in_the_middle(renderer: Renderer, ramp: Volume) -> None:
    camera = Camera.orbit(ramp, 30, 20)
    a, b = (draw(renderer, ramp, camera=c) for c in (camera, camera.orthographic()))
    middle = (SIZE[1] // 2, SIZE[0] // 2)
    np.testing.assert_allclose(a.rgba[middle], b.rgba[middle].astype(float), atol=2)


def test_light_falls_on_both_sides_and_shading_can_be_left_out(
    renderer: Renderer, ramp: Volume
) -> None:
    turned = Mesh(BALL.vertices_xyz, BALL.faces[:, ::-1])
    outside, inside, flat = (
        draw(renderer, ramp, BALL, shading=True),
        draw(renderer, ramp, turned, shading=True),
        draw(renderer, ramp, BALL),
    )
    np.testing.assert_allclose(outside.premultiplied, inside.premultiplied, atol=1e-3)
    assert (outside.rgba != flat.rgba).any()


def test_what_lies_outside_of_the_texture_is_grey(renderer: Renderer, ramp: Volume) -> None:
    out = Placement.of_numbers((1, 0, 0, 30, 0, 1, 0, 0, 0, 0, 1, 0))
    camera = Camera.orbit(ramp, 30, 20, distance=160)
    rgba = draw(renderer, ramp, camera=camera, placement=out).rgba
    colours = rgba[rgba[..., 3] == 255][:, :3]
    grey = (np.abs(colours.astype(int) - 128) <= 1).all(axis=1)
    assert 0.3 < grey.mean() < 1


def test_a_mesh_that_touches_nothing_is_grey_all_over(renderer: Renderer, ramp: Volume) -> None:
    out = Placement.of_numbers((1, 0, 0, 100, 0, 1, 0, 0, 0, 0, 1, 0))
    camera = Camera.look_at((121, -60, 17), (121, 20, 17))
    rgba = draw(renderer, ramp, camera=camera, placement=out).rgba
    assert set(np.unique(rgba[rgba[..., 3] == 255][:, :3])) <= {127, 128}


def test_by_default_the_mesh_lies_where_the_volume_was_made_for_it(
    renderer: Renderer, folder: Path, ramp: Volume
) -> None:
    with opened(
        folder, "ramp.npy", "placed.zarr", surface=BALL, surface_placement=IDENTITY
    ) as placed:
        camera = Camera.orbit(placed, 30, 20)
        a = renderer.render_mesh(placed, BALL, camera, SIZE, level=0)
        b = renderer.render_mesh(placed, BALL, camera, SIZE, level=0, placement=IDENTITY)
        fitted = renderer.render_mesh(ramp, BALL, camera, SIZE, level=0)
    np.testing.assert_array_equal(a.rgba, b.rgba)
    assert (fitted.rgba[..., 3] > 0).sum() > 0
    assert (fitted.rgba != b.rgba).any()


def test_the_level_follows_the_size_of_a_pixel_and_the_budget(ramp: Volume) -> None:
    with Renderer("256MiB") as renderer:
        near = draw(renderer, ramp, level=None)
        far = draw(renderer, ramp, level=None, camera=Camera.orbit(ramp, 30, 20, distance=700))
        assert (near.fidelity.level, far.fidelity.level) == (0, 2)
    with Renderer("512KiB") as small:
        image = draw(small, ramp, level=None)
        assert image.fidelity.level > 0
        assert not image.fidelity.converged
        assert image.stats.resident_nbytes <= 2**19
        with pytest.raises(PictureTooLargeError, match="memory_budget"):
            draw(small, ramp, level=0)


def test_a_channel_is_coloured_by_a_transfer_function(renderer: Renderer, ramp: Volume) -> None:
    function = TransferFunction.from_points([(0, (0, 0, 1), 0), (1, (1, 0, 0), 0)])
    camera = Camera.orbit(ramp, 30, 20)
    image = draw(renderer, ramp, camera=camera, transfer_function=function, window=(20, 240), c=1)
    value = (places_on_ball(camera)[..., 1] * STEP) / 220
    whole = np.isfinite(value) & (image.rgba[..., 3] == 255)
    np.testing.assert_array_equal(image.rgba[whole][:, 1], 0)
    error = np.abs(image.rgba[..., 0] - value * 255)[whole]
    assert np.quantile(error, 0.9) <= 3


def test_volumes_and_meshes_take_turns_within_one_budget(renderer: Renderer, ramp: Volume) -> None:
    first = draw(renderer, ramp)
    function = TransferFunction.preset("ct-bone")
    renderer.render(ramp, Camera.orbit(ramp), function, SIZE)
    again = draw(renderer, ramp)
    np.testing.assert_array_equal(first.rgba, again.rgba)
    kept = draw(renderer, ramp)
    assert again.stats.uploaded_nbytes > 0 == kept.stats.uploaded_nbytes
    assert set(kept.stats.bricks) == {"total", "sampled", "absent"}


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"sampling": "cubic"}, "linear"),
        ({"c": (0, 1)}, "three channels"),
        ({"c": (0, 1, 9)}, "9"),
        ({"level": 9}, "levels 0 to"),
        ({"placement": None, "up": "w"}, "x, y, z"),
        ({"mesh": "bunny.ply"}, "read_mesh"),
        ({"window": [(0, 1)] * 2}, "2 windows for 3"),
    ],
    ids=str,
)
def test_what_makes_no_sense_is_refused(
    renderer: Renderer, ramp: Volume, how: dict[str, Any], message: str
) -> None:
    with pytest.raises(InvalidInputError, match=message):
        draw(renderer, ramp, **how)
