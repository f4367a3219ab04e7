from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from octobrick.renderer.canvas import Canvas
from octobrick.renderer.context import GraphicsContext

pytestmark = pytest.mark.gl

GATHERED = np.array([[[0.25, 0.5, 0.0, 0.5], [0, 0, 0, 0], [1.5, 0.2, 0.1, 1.0]]], np.float32)


@pytest.fixture(scope="module")
def canvas() -> Iterator[Canvas]:
    context = GraphicsContext()
    with context.current() as gl:
        yield Canvas(context, gl)
    context.release()


@pytest.fixture
def rounding(canvas: Canvas) -> int:
    """Drivers round halves of 8 bits either way; llvmpipe up."""
    return 0 if canvas._context.software else 1


def gather(canvas: Canvas) -> None:
    canvas.begin((3, 1), 0.0, depth=True)
    assert canvas._picture is not None
    canvas._picture.write(GATHERED.tobytes())


def test_without_background_alpha_is_straight(canvas: Canvas, rounding: int) -> None:
    gather(canvas)
    found = canvas.finished(None)
    wanted = [[[128, 255, 0, 128], [0, 0, 0, 0], [255, 51, 26, 255]]]
    np.testing.assert_allclose(found, wanted, atol=rounding)


def test_a_background_shows_through_what_is_thin(canvas: Canvas, rounding: int) -> None:
    gather(canvas)
    found = canvas.finished((1.0, 0.0, 0.2))
    wanted = [[[191, 128, 26, 255], [255, 0, 51, 255], [255, 51, 26, 255]]]
    np.testing.assert_allclose(found, wanted, atol=rounding)


def test_what_was_gathered_comes_back_and_a_new_picture_is_empty(canvas: Canvas) -> None:
    gather(canvas)
    np.testing.assert_array_equal(canvas.picture(), GATHERED)
    canvas.begin((3, 1), -1.0, depth=True)
    np.testing.assert_array_equal(canvas.picture(), np.full((1, 3, 4), -1, np.float32))
    np.testing.assert_array_equal(canvas.depth(), np.full((1, 3), np.inf, np.float32))
