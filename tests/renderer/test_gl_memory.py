"""The memory budget is kept: counted by what OpenGL was asked for, not by what we say."""

from __future__ import annotations

from typing import Any

import moderngl
import numpy as np
import pytest

from octobrick.codec import S3dc
from octobrick.renderer import Camera, Renderer, TransferFunction

from .array_source import ArraySource

pytestmark = pytest.mark.gl

FIXED_NBYTES = 256 << 10
"""Beside the budget: the transfer function's table, records of bricks, flags of tiles."""
PIXEL_NBYTES = 4 * 4 + 4 + 4
"""Of the picture: float colour, 8-bit colour, depth."""


class Meter:
    """Bytes of all textures and buffers of all contexts that are alive."""

    def __init__(self) -> None:
        self.now = self.peak = 0

    def count(self, thing: Any, nbytes: int) -> Any:
        self.now += nbytes
        self.peak = max(self.peak, self.now)
        release = thing.release

        def released() -> None:
            nonlocal nbytes
            self.now -= nbytes
            nbytes = 0
            release()

        thing.release = released
        return thing


@pytest.fixture
def meter(monkeypatch: pytest.MonkeyPatch) -> Meter:
    counted = Meter()
    sizes = {"f1": 1, "u1": 1, "i1": 1, "nu2": 2, "u2": 2, "i2": 2, "f2": 2, "f4": 4, "u4": 4}
    texture3d, texture = moderngl.Context.texture3d, moderngl.Context.texture
    buffer = moderngl.Context.buffer

    def meter_texture3d(self: Any, size: Any, components: int, *args: Any, **kw: Any) -> Any:
        made = texture3d(self, size, components, *args, **kw)
        return counted.count(made, int(np.prod(size)) * components * sizes[kw.get("dtype", "f1")])

    def meter_texture(self: Any, size: Any, components: int, *args: Any, **kw: Any) -> Any:
        made = texture(self, size, components, *args, **kw)
        return counted.count(made, int(np.prod(size)) * components * sizes[kw.get("dtype", "f1")])

    def meter_buffer(self: Any, *args: Any, **kw: Any) -> Any:
        made = buffer(self, *args, **kw)
        return counted.count(made, made.size)

    monkeypatch.setattr(moderngl.Context, "texture3d", meter_texture3d)
    monkeypatch.setattr(moderngl.Context, "texture", meter_texture)
    monkeypatch.setattr(moderngl.Context, "buffer", meter_buffer)
    return counted


def smooth(side: int) -> np.ndarray[Any, Any]:
    z, y, x = np.meshgrid(*[np.linspace(-2, 2, side)] * 3, indexing="ij")
    field = np.sin(3 * x + y) * np.cos(2 * y - z) * np.exp(-0.3 * (x**2 + y**2 + z**2))
    return np.rint(127 + 120 * field).astype(np.uint8)


FUNCTION = TransferFunction(((0.0, (0.9, 0.7, 0.5)),), ((0.0, 0.004), (1.0, 0.02)))


@pytest.mark.parametrize(
    ("share", "scene"),
    [(8, {"shading": False}), (8, {}), (8, {"mode": "mip"}), (0.25, {"deblocking": True})],
    ids=str,
)
def test_a_scene_of_many_times_the_budget_renders_within_it(
    meter: Meter, renderer: Renderer, share: float, scene: dict[str, Any]
) -> None:
    """All voxels are in view; the budget is one part in `share` of them, raw."""
    side = 256 if share > 1 else 128
    source = ArraySource(smooth(side), codec=S3dc(), brick=32, nlevels=1)
    budget = int(side**3 / share)
    camera, size = Camera.orbit(source, 30, 20), (40, 40)
    before = meter.now
    with Renderer(budget, slab_budget=budget * 3 // 4, decode="gpu") as small:
        meter.peak = meter.now
        image = small.render(source, camera, FUNCTION, size, level=0, depth=True, **scene)
    assert image.stats.slabs > 3
    assert image.stats.bricks["sampled"] == (side // 32) ** 3
    picture_nbytes = size[0] * size[1] * PIXEL_NBYTES
    assert meter.peak - before <= budget + picture_nbytes + FIXED_NBYTES
    wanted = renderer.render(source, camera, FUNCTION, size, level=0, depth=True, **scene)
    np.testing.assert_allclose(image.premultiplied, wanted.premultiplied, atol=2e-4)


@pytest.mark.parametrize("block", [8, 16])
def test_resident_bytes_per_voxel_are_those_of_the_code(block: int) -> None:
    source = ArraySource(smooth(128), codec=S3dc((block,) * 3, 4), brick=64, nlevels=1)
    for decode in ("gpu", "cpu"):
        with Renderer("64MiB", decode=decode) as renderer:  # type: ignore[arg-type]
            image = renderer.render(
                source, Camera.orbit(source), FUNCTION, (16, 16), level=0, shading=False
            )
        assert image.stats.resident_nbytes / 128**3 <= 0.55


class Directions:
    """A direction for every voxel: three bytes."""

    levels = (0,)
    brick_shape_zyx = (64, 64, 64)

    def code(self, level: int, zyx: Any, t: int = 0, c: int = 0) -> bytes:
        return np.random.default_rng(zyx).integers(0, 256, 3 * 64**3, np.uint8).tobytes()


class Lit(ArraySource):
    gradients = Directions()


def test_resident_bytes_per_voxel_of_a_lit_level_are_codes_and_three_bytes() -> None:
    source = Lit(smooth(128), codec=S3dc(), brick=64, nlevels=1)
    with Renderer("64MiB", decode="gpu") as renderer:
        image = renderer.render(source, Camera.orbit(source), FUNCTION, (16, 16), level=0)
    assert 3 < image.stats.resident_nbytes / 128**3 <= 3.6
