"""One picture, kept as a file: what everything together looks like does not change unnoticed.

Compared on Mesa's llvmpipe only, because other drivers round differently. To make it anew after a
change that is meant to show: python -m tests.renderer.test_gl_golden, then look at it.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from octobrick.codec import S3dc
from octobrick.renderer import Camera, RenderedImage, Renderer, TransferFunction

from .array_source import ArraySource
from .conftest import make_blobs

pytestmark = pytest.mark.gl

GOLDEN = Path(__file__).with_name("golden_blobs.png")
TOLERANCE = 3  # of 255; versions of Mesa and LLVM differ by 1


def picture(renderer: Renderer, blobs: NDArray[np.uint8]) -> RenderedImage:
    source = ArraySource(blobs, codec=S3dc(), brick=32, spacing_xyz=(1.0, 1.0, 1.2))
    camera = Camera.orbit(source, 35, 25).zoomed(1.4)
    function = TransferFunction.preset("ct-soft-tissue")
    return renderer.render(
        source, camera, function, (160, 120), level=0, background=(0.1, 0.1, 0.2)
    )


def test_the_picture_is_the_golden_one(
    renderer: Renderer, blobs: NDArray[np.uint8], require_alike: Callable[..., None]
) -> None:
    if "llvmpipe" not in renderer.gl_renderer:
        pytest.skip(f"the golden picture is llvmpipe's, this is {renderer.gl_renderer}")
    wanted = np.asarray(Image.open(GOLDEN))
    require_alike(picture(renderer, blobs).rgba[..., :3], wanted, tolerance=TOLERANCE)


if __name__ == "__main__":
    with Renderer() as own:
        assert "llvmpipe" in own.gl_renderer, own.gl_renderer
        picture(own, make_blobs()).save(GOLDEN)
