"""Rendering from S3Dc code without a slab gives what slabs of it give."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from octobrick.codec import S3dc
from octobrick.codec.errors import InvalidInputError, UnsupportedError
from octobrick.renderer import Camera, PictureTooLargeError, Renderer, Slice, TransferFunction

from .array_source import ArraySource

pytestmark = pytest.mark.gl

FUNCTION = TransferFunction(
    ((0.2, (0.9, 0.3, 0.1)), (1.0, (1.0, 1.0, 0.9))), ((0.15, 0.0), (0.7, 0.06), (1.0, 0.3))
)
SIZE = (40, 32)


@pytest.fixture(scope="module")
def small() -> Iterator[Renderer]:
    with Renderer("8MiB") as made:
        yield made


def require_alike(
    renderer: Renderer, direct: NDArray[np.float32], slabs: NDArray[np.float32]
) -> None:
    """As float32 on llvmpipe; GPUs interpolate slabs by weights of 8 bits."""
    software = "llvmpipe" in renderer.gl_renderer
    np.testing.assert_allclose(direct, slabs, atol=1e-4 if software else 0.06)
    assert np.abs(direct - slabs).mean() < (1e-6 if software else 2e-3)


@pytest.mark.parametrize("sampling", ["linear", "shared"])
@pytest.mark.parametrize(
    ("dtype", "codec", "brick"),
    [
        ("uint8", S3dc((8, 8, 8), 4), 16),
        ("uint8", S3dc((4, 4, 4), 3), 20),
        ("int16", S3dc((5, 8, 16), 8), 32),
        ("float32", S3dc((8, 8, 8), 2), 16),
    ],
)
def test_directly_sampled_bricks_look_as_decoded_ones(
    renderer: Renderer,
    blobs: NDArray[np.uint8],
    dtype: str,
    codec: S3dc,
    brick: int,
    sampling: str,
) -> None:
    source = ArraySource((blobs // 2).astype(dtype), codec=codec, brick=brick, nlevels=1)
    for scene in ({"shading": False}, {"shading": True}):
        slabs, direct = (
            renderer.render(
                source, Camera.orbit(source, 30, 20), FUNCTION, SIZE, window=(0, 127),
                level=0, direct=way, **scene,
            )
            for way in (None, sampling)
        )  # fmt: skip
        assert slabs.premultiplied.any()
        require_alike(renderer, direct.premultiplied, slabs.premultiplied)
        assert direct.stats.slabs == direct.stats.decoded_nbytes == 0


def test_the_nearest_voxel_is_shown_as_it_decodes(renderer: Renderer) -> None:
    voxels = np.random.default_rng(5).integers(0, 256, (12, 20, 28)).astype(np.uint8)
    source = ArraySource(voxels, codec=S3dc((4, 4, 4), 4), brick=8, nlevels=1)
    grey = TransferFunction(((0.0, (0.0, 0.0, 0.0)), (1.0, (1.0, 1.0, 1.0))), ((0.0, 1.0),))
    middle = (13.5, 9.5)
    camera = Camera((*middle, -50.0), (*middle, 0.0), (0.0, -1.0, 0.0), None, 20.0)
    for z, at in ((0, 0.0), (7, 6.7), (7, 7.4)):
        image = renderer.render(
            source, camera, grey, (28, 20), window=(0, 255), direct="nearest",
            mode=Slice((0.0, 0.0, at), (0.0, 0.0, 1.0)),
        )  # fmt: skip
        wanted = source.decoded(0)[z] / 255
        np.testing.assert_allclose(image.premultiplied[..., 0], wanted, atol=2e-4)


def test_absent_bricks_have_the_fill_value(renderer: Renderer) -> None:
    voxels = np.zeros((32, 32, 32), np.uint8)
    voxels[16:, 16:, 16:] = 200
    source = ArraySource(voxels, codec=S3dc(), brick=16, nlevels=1)
    slabs, direct = (
        renderer.render(source, Camera.orbit(source), FUNCTION, SIZE, window=(0, 255), direct=way)
        for way in (None, "shared")
    )
    require_alike(renderer, direct.premultiplied, slabs.premultiplied)


@pytest.mark.parametrize("mode", ["mip", "average"])
def test_other_modes_go_without_slabs_too(
    renderer: Renderer, blobs: NDArray[np.uint8], mode: str
) -> None:
    source = ArraySource(blobs, codec=S3dc(), brick=16, nlevels=1)
    camera = Camera.orbit(source, 30, 20)
    slabs, direct = (
        renderer.render(source, camera, FUNCTION, SIZE, mode=mode, direct=way).premultiplied
        for way in (None, "linear")
    )
    require_alike(renderer, direct, slabs)


def test_what_cannot_be_sampled_directly_is_refused_with_what_to_do(
    small: Renderer, blobs: NDArray[np.uint8]
) -> None:
    camera = Camera.orbit(ArraySource(blobs), 30, 20)

    def render(source: ArraySource, **scene: Any) -> None:
        small.render(source, camera, FUNCTION, SIZE, level=0, **scene)

    with pytest.raises(UnsupportedError, match="fixed rate"):
        render(ArraySource(blobs, brick=16, nlevels=1), direct="linear")
    coded = ArraySource(blobs, codec=S3dc(), brick=16, nlevels=1)
    with pytest.raises(InvalidInputError, match="choose one of"):
        render(coded, direct="cubic")
    with pytest.raises(InvalidInputError, match="without deblocking"):
        render(coded, direct="linear", deblocking=True)
    everything = TransferFunction(FUNCTION.colors, ((0.0, 0.1),))
    large = ArraySource(np.zeros((300, 300, 300), np.uint8), codec=S3dc(), fill_value=1)
    with pytest.raises(PictureTooLargeError, match="raise memory_budget"):
        small.render(large, Camera.orbit(large), everything, SIZE, level=0, direct="linear")
