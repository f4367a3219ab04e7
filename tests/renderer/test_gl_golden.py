"""Pictures kept as files: what everything together looks like does not change unnoticed.

Compared on Mesa's llvmpipe only, because other drivers round differently. To make it anew after a
change that is meant to show: python -m tests.renderer.test_gl_golden, then look at it.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from octobrick.codec import S3dc
from octobrick.renderer import (
    Camera,
    Clip,
    Isosurface,
    Light,
    Lighting,
    RenderedImage,
    Renderer,
    Slice,
    TransferFunction,
)

from .array_source import ArraySource, Channels
from .conftest import make_blobs

pytestmark = pytest.mark.gl

GOLDEN = Path(__file__).with_name("golden_blobs.png")
GOLDEN_MODES = Path(__file__).with_name("golden_modes.png")
TOLERANCE = 3  # of 255; versions of Mesa and LLVM differ by 1


def picture(renderer: Renderer, blobs: NDArray[np.uint8]) -> RenderedImage:
    source = ArraySource(blobs, codec=S3dc(), brick=32, spacing_xyz=(1.0, 1.0, 1.2))
    camera = Camera.orbit(source, 35, 25).zoomed(1.4)
    function = TransferFunction.preset("ct-soft-tissue")
    return renderer.render(
        source, camera, function, (160, 120), level=0, background=(0.1, 0.1, 0.2)
    )


def modes_sheet(renderer: Renderer, blobs: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Ten small pictures: each way to look at the blobs, and at them beside themselves, moved."""
    coded = ArraySource(blobs, codec=S3dc((8, 8, 8), 2), brick=32)
    two = Channels([ArraySource(a, brick=32) for a in (blobs, np.roll(blobs, 15, axis=2))])
    camera = Camera.orbit(coded, 35, 25).zoomed(1.4)
    soft = TransferFunction.preset("ct-soft-tissue")
    grey = TransferFunction(
        ((0.0, (0.0, 0.0, 0.0)), (1.0, (1.0, 1.0, 1.0))), ((0.0, 0.0), (1.0, 1.0))
    )
    red, blue = (
        TransferFunction(((0.0, color),), ((0.2, 0.0), (0.8, 0.06)))
        for color in ((1.0, 0.3, 0.2), (0.2, 0.5, 1.0))
    )
    lights = Lighting(lights=(Light((1.0, -1.0, 1.0), (1.0, 0.7, 0.4)), Light((-1.0, 0.0, 0.2))))
    scenes: list[tuple[Any, Any, dict[str, Any]]] = [
        (coded, soft, {}),
        (coded, soft, {"deblocking": True}),
        (coded, soft, {"shading": lights}),
        (coded, soft, {"clip": Clip((30.0, 20.0, 0.0)), "edges": (0.01, 0.05)}),
        (coded, soft, {"direct": "shared", "step_voxels": 1.0}),
        (coded, grey, {"mode": "mip"}),
        (coded, grey, {"mode": "average", "window": (0.0, 60.0)}),
        (coded, soft, {"mode": Isosurface(120.0, 0.7)}),
        (coded, grey, {"mode": Slice((40.0, 35.0, 30.0), (0.3, 1.0, 0.2))}),
        (two, (red, blue), {"c": (0, 1)}),
    ]
    tiles = [
        renderer.render(
            volume, camera, function, (80, 60), level=0, background=(0.1, 0.1, 0.2), **scene
        ).rgba[..., :3]
        for volume, function, scene in scenes
    ]
    return np.vstack([np.hstack(tiles[:5]), np.hstack(tiles[5:])])


def require_llvmpipe(renderer: Renderer) -> None:
    if "llvmpipe" not in renderer.gl_renderer:
        pytest.skip(f"the golden pictures are llvmpipe's, this is {renderer.gl_renderer}")


def test_the_picture_is_the_golden_one(
    renderer: Renderer, blobs: NDArray[np.uint8], require_alike: Callable[..., None]
) -> None:
    require_llvmpipe(renderer)
    wanted = np.asarray(Image.open(GOLDEN))
    require_alike(picture(renderer, blobs).rgba[..., :3], wanted, tolerance=TOLERANCE)


def test_every_way_to_look_is_the_golden_one(
    renderer: Renderer, blobs: NDArray[np.uint8], require_alike: Callable[..., None]
) -> None:
    require_llvmpipe(renderer)
    wanted = np.asarray(Image.open(GOLDEN_MODES))
    require_alike(modes_sheet(renderer, blobs), wanted, tolerance=TOLERANCE)


if __name__ == "__main__":
    with Renderer() as own:
        assert "llvmpipe" in own.gl_renderer, own.gl_renderer
        picture(own, make_blobs()).save(GOLDEN)
        Image.fromarray(modes_sheet(own, make_blobs())).save(GOLDEN_MODES)
