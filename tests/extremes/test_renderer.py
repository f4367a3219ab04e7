"""Pictures at the extremes: finite, of the right opacity, and the same however they are made."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from octobrick.codec import S3dc
from octobrick.codec.errors import CorruptBrickError, InvalidInputError
from octobrick.renderer import Camera, Clip, Isosurface, Renderer, Slice, TransferFunction

from ..renderer.array_source import ArraySource, Times
from .table import holds

WHITE = ((0.0, (1.0, 1.0, 1.0)),)
SHAPE = (12, 20, 28)
MIDDLE = (13.5, 9.5, 5.5)
MODES = ("dvr", "mip", "average", Isosurface(3.5), Slice((20.0, 15.0, 11.0), (0.2, 1.0, 0.4)))


def uniform(opacity: float) -> TransferFunction:
    """White of the same opacity for every value."""
    return TransferFunction(WHITE, ((0.0, opacity),))


def medium(spacing_xyz: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> ArraySource:
    """A box of one value; coded, so that it can be sampled directly too."""
    voxels = np.full(SHAPE, 7, np.uint8)
    return ArraySource(voxels, codec=S3dc(), brick=16, nlevels=1, spacing_xyz=spacing_xyz)


def waves(dtype: str = "uint8") -> NDArray[Any]:
    """Matter that changes smoothly, in empty space."""
    z, y, x = np.indices(SHAPE)
    unit = np.clip(np.sin(x / 5) * np.cos(y / 6) + 0.3 * np.sin(z / 3), 0, 1)
    return (unit * 240).astype(dtype)


def way_of(implementation: str) -> str | None:
    """How the renderer is asked for it."""
    return "linear" if implementation == "direct" else None


def alpha_at(image: Any) -> float:
    """Of the pixel in the middle."""
    h, w = image.premultiplied.shape[:2]
    return float(image.premultiplied[h // 2, w // 2, 3])


# ---- Volumes ---------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 20, 17), (1, 1, 30)])
@holds("renderer", "one-voxel", "glsl")
def test_volumes_one_voxel_thin_are_seen_in_all_modes(
    renderer: Renderer, implementation: str, shape: tuple[int, int, int]
) -> None:
    source = ArraySource(np.full(shape, 5, np.uint8), brick=16, nlevels=1)
    middle = tuple((n - 1) / 2 for n in reversed(shape))
    for mode in MODES:
        if isinstance(mode, Slice):
            mode = Slice(middle, mode.normal_world_xyz)  # type: ignore[arg-type]
        for azimuth, elevation in ((33, 27), (0, 90)):
            camera = Camera.orbit(source, azimuth, elevation)
            image = renderer.render(source, camera, uniform(1), (60, 60), mode=mode)
            assert np.isfinite(image.premultiplied).all()
            # A constant volume has no surface; a plane seen from its edge has no width.
            if not isinstance(mode, (Isosurface, Slice)):
                assert image.premultiplied[..., 3].any()


@holds("renderer", "constant", "glsl")
def test_one_value_is_shown_whichever_it_is_and_lit_by_ambient_light(
    renderer: Renderer, implementation: str
) -> None:
    greatest = float(np.finfo(np.float32).max)
    for dtype, value in (
        ("uint8", 0), ("int16", -32768), ("float32", 1e-45), ("float32", greatest),
        ("float32", -greatest),
    ):  # fmt: skip
        voxels = np.full((9, 9, 9), value, dtype)
        source = ArraySource(voxels, brick=16, nlevels=1, fill_value=3)
        image = renderer.render(source, Camera.orbit(source), uniform(0.5), (9, 9))
        assert np.isfinite(image.premultiplied).all()
        assert alpha_at(image) == pytest.approx(1 - 0.5**9, abs=2e-3)
        assert all(math.isfinite(end) for end in image.stats.window)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@holds("renderer", "not-finite", "glsl")
def test_scenes_that_are_not_finite_are_refused(
    renderer: Renderer, implementation: str, bad: float
) -> None:
    for make in (
        lambda: Camera((bad, 0.0, 0.0), (1.0, 0.0, 0.0)),
        lambda: Camera((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, bad, 1.0)),
        lambda: Camera((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), fov_degrees=bad),
        lambda: Clip(half_spaces=((bad, 0.0, 0.0, 1.0),)),
        lambda: TransferFunction(WHITE, ((bad, 1.0),)),
    ):
        with pytest.raises(InvalidInputError):
            make()
    source = medium()
    for scene in ({"window": (0.0, bad)}, {"step_voxels": bad}, {"deblocking": bad}):
        with pytest.raises(InvalidInputError):
            renderer.render(source, Camera.orbit(source), uniform(0.1), (4, 4), **scene)


# ---- Transfer functions ----------------------------------------------------------------------


@holds("renderer", "opaque-function", "glsl", "direct")
def test_an_opaque_function_is_opaque_wherever_the_volume_is(
    renderer: Renderer, implementation: str
) -> None:
    source, camera = medium(), Camera((13.5, 9.5, -60.0), MIDDLE, (0.0, -1.0, 0.0), None, 30.0)
    image = renderer.render(
        source, camera, uniform(1), (60, 60), shading=False, direct=way_of(implementation)
    )
    alpha = image.premultiplied[..., 3]
    wanted = np.zeros((60, 60))
    wanted[10:50, 2:58] = 1  # 20 × 28 voxels, two pixels each
    np.testing.assert_array_equal(alpha, wanted)


@pytest.mark.parametrize("bits", [1, 2, 4])
@holds("renderer", "spike-function", "glsl")
def test_a_spike_narrower_than_a_step_of_the_code_survives_dropping(
    renderer: Renderer, implementation: str, bits: int
) -> None:
    """Interpolation crosses values between two indices; what is dropped must not have had them."""
    source = ArraySource(waves(), codec=S3dc((4, 4, 4), bits), brick=8, nlevels=1)
    camera = Camera.orbit(source, 120, 30)
    with Renderer("64MiB", cull=False) as unculled:
        for at in (3.0, 121.0, 200.0):
            spike = ((at + 0.2, 0.0), (at + 0.5, 0.9), (at + 0.8, 0.0))
            function = TransferFunction(WHITE, spike, "value")
            found, wanted = (
                r.render(source, camera, function, (32, 24), window=(0, 255)).premultiplied
                for r in (renderer, unculled)
            )
            assert wanted.any()
            np.testing.assert_array_equal(found, wanted)


# ---- Views -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("eye", "depth"),
    [(MIDDLE, 14.0), ((-0.5, 9.5, 5.5), 28.0), ((27.5, 9.5, 5.5), 0.0), ((16.0, 9.5, 5.5), 11.5)],
    ids=["in the middle", "on the near face", "on the far face", "between bricks"],
)
@holds("renderer", "camera-inside", "glsl", "direct")
def test_an_eye_in_the_volume_sees_what_lies_ahead(
    renderer: Renderer, implementation: str, eye: tuple[float, float, float], depth: float
) -> None:
    camera = Camera(eye, (100.0, 9.5, 5.5), (0.0, 0.3, 1.0), 20.0)
    image = renderer.render(
        medium(), camera, uniform(0.05), (33, 33), shading=False, direct=way_of(implementation)
    )
    assert np.isfinite(image.premultiplied).all()
    assert alpha_at(image) == pytest.approx(1 - 0.95**depth, abs=0.03)


@holds("renderer", "parallel-rays", "glsl", "direct")
def test_rays_parallel_to_faces_have_their_length_within_the_volume_and_none_beside_it(
    renderer: Renderer, implementation: str
) -> None:
    """Direction components are exactly 0, and rays on a face have 0 · ∞ in the way."""
    source = medium()
    for axis, length in enumerate((28, 20, 12)):
        eye, target = list(MIDDLE), list(MIDDLE)
        eye[axis] -= 100.0
        up = (0.0, 1.0, 0.0) if axis == 2 else (0.0, 0.0, 1.0)
        for beside in (0.0, 0.499, 0.5, 0.501):
            other = (axis + 1) % 3
            at = (28, 20, 12)[other] - 1 + beside  # inside, on, and outside of the far face
            eye[other] = target[other] = at
            camera = Camera(tuple(eye), tuple(target), up, None, 1e-6)  # type: ignore[arg-type]
            image = renderer.render(
                source, camera, uniform(0.1), (3, 3), shading=False, direct=way_of(implementation)
            )
            assert np.isfinite(image.premultiplied).all()
            alpha = image.premultiplied[1, 1, 3]
            inside = pytest.approx(1 - 0.9**length, abs=5e-3)
            if beside < 0.5:
                assert alpha == inside
            elif beside > 0.5:
                assert alpha == 0
            else:
                assert alpha in (0, inside)


@pytest.mark.parametrize("zoom", [28, 1e3, 1e6])
@holds("renderer", "one-voxel-zoom", "glsl")
def test_one_voxel_fills_the_picture_with_its_value(
    renderer: Renderer, implementation: str, zoom: float
) -> None:
    voxels = waves()
    source = ArraySource(voxels, brick=16, nlevels=1, window=(0, 255))
    grey = TransferFunction(((0.0, (0.0, 0.0, 0.0)), (1.0, (1.0, 1.0, 1.0))), ((0.0, 1.0),))
    camera = Camera((8.0, 4.0, -50.0), (8.0, 4.0, 6.0), (0.0, -1.0, 0.0), None, 28.0).zoomed(zoom)
    image = renderer.render(
        source, camera, grey, (32, 32), mode=Slice((0.0, 0.0, 6.0), (0.0, 0.0, 1.0))
    )
    seen = image.premultiplied[..., 0] * 255
    assert np.isfinite(seen).all()
    around = voxels[6, 3:6, 7:10]
    assert around.min() - 0.1 <= seen.min()
    assert seen.max() <= around.max() + 0.1
    assert seen[15:17, 15:17].mean() == pytest.approx(float(voxels[6, 4, 8]), abs=0.5)
    assert np.abs(np.diff(seen, axis=1)).max() <= float(np.ptp(around)) * 28 / zoom / 32 + 0.1


@pytest.mark.parametrize("fov_degrees", [1e-6, 1e-3, 1.0, 179.0, 179.999])
@holds("renderer", "field-of-view", "glsl")
def test_angles_near_0_and_180_give_finite_pictures(
    renderer: Renderer, implementation: str, fov_degrees: float
) -> None:
    source = medium()
    for eye, depth in (((13.5, -300.0, 5.5), 20.0), ((13.5, 4.5, 5.5), 15.0)):
        camera = Camera(eye, MIDDLE, fov_degrees=fov_degrees)
        image = renderer.render(source, camera, uniform(0.05), (17, 17), shading=False)
        assert np.isfinite(image.premultiplied).all()
        assert alpha_at(image) == pytest.approx(1 - 0.95**depth, abs=0.03)
    for impossible in (0.0, -1.0, 180.0, 360.0):
        with pytest.raises(InvalidInputError, match="fov_degrees"):
            Camera((0.0, -9.0, 0.0), MIDDLE, fov_degrees=impossible)


@pytest.mark.parametrize("ratio", [1e-3, 2.0, 1e3])
@holds("renderer", "anisotropic", "glsl")
def test_the_way_through_long_voxels_counts_in_the_world(
    renderer: Renderer, implementation: str, ratio: float
) -> None:
    """The opacity of a function is that of one smallest spacing, whichever axis has it."""
    source = medium((1.0, 1.0, ratio))
    unit = min(1.0, ratio)
    for elevation, length in ((0.0, 20 / unit), (90.0, 12 * ratio / unit)):
        opacity = 1 - math.exp(-1 / length)  # that a fixed part comes through
        camera = Camera.orbit(source, 0, elevation).orthographic()
        image = renderer.render(
            source, camera, uniform(opacity), (5, 5), shading=False, step_voxels=4
        )
        assert alpha_at(image) == pytest.approx(1 - math.exp(-1), abs=0.02)


@holds("renderer", "anisotropic", "glsl")
def test_light_falls_by_gradients_in_the_world(renderer: Renderer, implementation: str) -> None:
    """A slope of 45° in the world faces the eye by cos 45°, however long voxels are."""
    from octobrick.renderer import Lighting

    for ratio in (0.25, 4.0):
        z, _, x = np.indices((24, 8, 24))
        voxels = (x + z * ratio).astype(np.float32)
        source = ArraySource(voxels, brick=32, nlevels=1, spacing_xyz=(1.0, 1.0, ratio))
        middle = (12.0, 3.5, 12.0 * ratio)
        camera = Camera((12.0, 3.5, -500.0), middle, (0.0, 1.0, 0.0), None, 4.0)
        level = float(voxels[12, 3, 12])
        image = renderer.render(
            source, camera, uniform(1), (9, 9), mode=Isosurface(level),
            shading=Lighting(0.0, 1.0, 0.0), step_voxels=0.5,
        )  # fmt: skip
        assert image.premultiplied[4, 4, 0] == pytest.approx(math.sqrt(0.5), abs=0.01)


# ---- How it is made --------------------------------------------------------------------------


@holds("renderer", "step-size", "glsl", "direct")
def test_steps_of_any_length_gather_the_opacity_of_the_way(
    renderer: Renderer, implementation: str
) -> None:
    """20 voxels of an even medium, in steps that divide them and in steps that do not."""
    source = medium()
    camera = Camera((13.5, -60.0, 5.5), MIDDLE, (0.0, 0.0, 1.0), None, 2.0)
    for opacity in (1e-9, 1e-6, 0.02, 0.3):
        for step in (1 / 64, 0.1, 0.5, 1.0, 2.5, 4.0):
            image = renderer.render(
                source, camera, uniform(opacity), (5, 5), shading=False, step_voxels=step,
                direct=way_of(implementation),
            )  # fmt: skip
            wanted = -math.expm1(20 * math.log1p(-opacity))
            assert alpha_at(image) == pytest.approx(wanted, rel=1e-3)


@holds("renderer", "slab-cuts", "glsl")
def test_slabs_of_any_thickness_give_the_same_picture(
    renderer: Renderer, implementation: str
) -> None:
    """Lit and deblocked, from S3Dc: cuts go through blocks and between samples."""
    source = ArraySource(np.tile(waves(), (3, 1, 1)), codec=S3dc((8, 8, 8), 2), brick=8, nlevels=1)
    function = TransferFunction(WHITE, ((0.1, 0.0), (0.6, 0.2)))
    for view, deblocking, budget in (
        ((30, 20), False, "16KiB"), ((45, 0), False, "16KiB"), ((0, 90), True, "200KiB"),
    ):  # fmt: skip
        camera, scene = Camera.orbit(source, *view), {"deblocking": deblocking, "level": 0}
        whole = renderer.render(source, camera, function, (24, 24), **scene)
        assert whole.stats.slabs_planned == 1
        with Renderer("4MiB", slab_budget=budget) as thin:
            cut = thin.render(source, camera, function, (24, 24), **scene)
        assert cut.stats.slabs_planned > 1
        np.testing.assert_allclose(cut.premultiplied, whole.premultiplied, atol=1e-5)


@holds("renderer", "early-end", "glsl")
def test_a_ray_that_ends_early_misses_less_than_a_hundredth(
    renderer: Renderer, implementation: str
) -> None:
    """Of an even medium it is known what a ray without an early end would gather."""
    for opacity in (0.05, 0.2, 0.6):
        length = 200
        voxels = np.full((4, length, 4), 1, np.uint8)
        source = ArraySource(voxels, brick=32, nlevels=1)
        camera = Camera((1.5, -60.0, 1.5), (1.5, 0.0, 1.5), (0.0, 0.0, 1.0), None, 1.0)
        alpha = alpha_at(renderer.render(source, camera, uniform(opacity), (3, 3), shading=False))
        exact = 1 - (1 - opacity) ** length
        assert exact - 1 / 1024 - 1e-5 <= alpha <= exact + 1e-5


@holds("renderer", "threads-and-instructions", "glsl")
def test_threads_that_read_bricks_change_no_bit(renderer: Renderer, implementation: str) -> None:
    source = ArraySource(waves(), codec=S3dc((4, 4, 4), 2), brick=8, nlevels=1)
    function = TransferFunction(WHITE, ((0.1, 0.0), (0.6, 0.2)))
    pictures = []
    for threads in (1, 3):
        with Renderer("64MiB", threads=threads) as made:
            image = made.render(source, Camera.orbit(source, 30, 20), function, (24, 24))
        pictures.append(image.premultiplied)
    assert pictures[0].any()
    np.testing.assert_array_equal(*pictures)


# ---- Damage ----------------------------------------------------------------------------------


@holds("renderer", "corrupt-step", "glsl")
def test_a_damaged_time_step_is_an_error_and_the_others_are_drawn(
    renderer: Renderer, implementation: str
) -> None:
    steps = [ArraySource(np.roll(waves(), i, 2), codec=S3dc(), brick=16) for i in range(3)]
    bad = steps[1]
    bad.brick_code = lambda *_: b"short"  # type: ignore[assignment]
    source = Times(steps)
    function, camera = uniform(0.1), Camera.orbit(steps[0])
    wanted = [renderer.render(steps[t], camera, function, (8, 8)).premultiplied for t in (0, 2)]
    with pytest.raises(CorruptBrickError, match="5 were given"):
        renderer.render(source, camera, function, (8, 8), t=1)  # type: ignore[arg-type]
    for t, picture in zip((0, 2), wanted, strict=True):
        image = renderer.render(source, camera, function, (8, 8), t=t)  # type: ignore[arg-type]
        np.testing.assert_array_equal(image.premultiplied, picture)


@holds("renderer", "beyond-the-levels", "glsl")
def test_levels_steps_and_channels_that_there_are_not_are_refused(
    renderer: Renderer, implementation: str
) -> None:
    source = medium()
    for scene in ({"level": 1}, {"level": -1}, {"t": 1}, {"c": 1}, {"t": -1}):
        with pytest.raises(InvalidInputError, match="0 to 0"):
            renderer.render(source, Camera.orbit(source), uniform(0.1), (4, 4), **scene)
