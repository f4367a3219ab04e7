"""Surfaces lit by stored directions of gradients."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from octobrick.codec import gradients
from octobrick.renderer import Camera, Isosurface, Lighting, Renderer, TransferFunction
from octobrick.store.box import Zyx, cell_box

from .array_source import ArraySource

pytestmark = pytest.mark.gl

WHITE = TransferFunction(((0.0, (1.0, 1.0, 1.0)),), ((0.0, 1.0),))
MATT = Lighting(0.0, 1.0, 0.0)


class Directions:
    """Codes of the directions of a volume's gradients, brick by brick."""

    levels = (0,)

    def __init__(self, vectors: NDArray[Any], brick_zyx: Zyx) -> None:
        self._codes = gradients.encode_directions(np.ascontiguousarray(vectors, np.float32))
        self.brick_shape_zyx = brick_zyx

    def code(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> bytes | None:
        part = self._codes[cell_box(zyx, self.brick_shape_zyx).slices]
        room = [(0, b - n) for b, n in zip(self.brick_shape_zyx, part.shape[:3], strict=True)]
        brick = np.pad(part, [*room, (0, 0)], constant_values=128)
        return None if (brick == 128).all() else brick.tobytes()


def lit(array: NDArray[Any], vectors: NDArray[Any] | None = None, **more: Any) -> ArraySource:
    """A volume of one level with the directions of its gradients, or with others."""
    source: Any = ArraySource(array, nlevels=1, **more)
    if vectors is None:
        spacing_zyx = source.levels[0].spacing_xyz[::-1]
        vectors = gradients.central_differences(array, spacing_zyx)
    source.gradients = Directions(vectors, source.brick_shape_zyx)
    made: ArraySource = source
    return made


def ball(side: int = 48) -> NDArray[np.uint8]:
    z, y, x = np.meshgrid(*[np.arange(side) - (side - 1) / 2] * 3, indexing="ij")
    radius = np.sqrt(x**2 + y**2 + z**2)
    return np.clip(20 * (0.375 * side - radius) + 128, 0, 255).astype(np.uint8)


@pytest.fixture(params=["cpu", "gpu"])
def both(request: pytest.FixtureRequest) -> Iterator[Renderer]:
    with Renderer("64MiB", decode=request.param) as made:
        yield made


@pytest.mark.parametrize("spacing_xyz", [(1.0, 1.0, 1.0), (1.0, 1.0, 2.0)])
def test_stored_directions_light_a_smooth_surface_as_differences_do(
    both: Renderer, spacing_xyz: tuple[float, float, float]
) -> None:
    source = lit(ball(), brick=16, spacing_xyz=spacing_xyz)
    camera = Camera.orbit(source, 30, 20)
    stored, differences = (
        both.render(
            source, camera, WHITE, (64, 64), mode=Isosurface(128.0), shading=MATT, gradients=way
        ).premultiplied
        for way in ("stored", "differences")
    )
    assert stored[32, 32, 0] > 0.95  # it faces the light at the eye
    assert stored[..., 0].max() > 1.5 * stored[24:40, 14:18, 0].max()  # its edge does not
    assert np.abs(stored - differences).mean() < 0.01


def test_absent_directions_leave_ambient_light(both: Renderer) -> None:
    source = lit(ball(), np.zeros((48, 48, 48, 3)), brick=16)
    image = both.render(
        source, Camera.orbit(source), WHITE, (32, 32), mode=Isosurface(128.0),
        shading=Lighting(0.25, 0.75, 0.0), gradients="stored",
    )  # fmt: skip
    assert image.premultiplied[16, 16, 0] == pytest.approx(0.25 * 1, abs=1e-3)


def test_directions_of_two_sides_do_not_cancel(renderer: Renderer) -> None:
    """Light falls on both sides of a surface, so a direction and its opposite are the same."""
    vectors = np.zeros((32, 32, 32, 3))
    vectors[..., 2] = np.where(np.indices((32, 32, 32)).sum(axis=0) % 2, 1, -1)  # z, or -z
    z = np.indices((32, 32, 32))[0]
    source = lit((200 * (z > 14)).astype(np.uint8), vectors, brick=16)
    camera = Camera((15.5, 15.5, -60.0), (15.5, 15.5, 0.0), (0.0, -1.0, 0.0), None, 20.0)
    image = renderer.render(
        source, camera, WHITE, (40, 40), mode=Isosurface(100.0), shading=MATT, gradients="stored"
    )
    np.testing.assert_allclose(image.premultiplied[..., 0], 1, atol=0.02)
