"""Scale bars are as long as they say, legends have the function's colours, text is readable."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from octobrick.codec.errors import InvalidInputError
from octobrick.renderer import Camera, TransferFunction, with_legend, with_scale_bar
from octobrick.renderer.scale import format_length, round_length, round_ticks

from .pictures import ramp

EYE = Camera((0, -100, 0), (0, 0, 0))
FLAT = Camera((0, -100, 0), (0, 0, 0), fov_degrees=None, height_world=100.0)
FUNCTION = TransferFunction.from_points([(0.0, (1, 0, 0), 0.0), (1.0, (0, 0, 1), 1.0)])
SIZES = [(128, 128), (300, 700), (768, 512)]


def changed(before: Any, after: Any) -> tuple[slice, slice]:
    """The smallest box of pixels in which two pictures differ."""
    y, x = np.nonzero((before.rgba != after.rgba).any(axis=-1))
    return slice(y.min(), y.max() + 1), slice(x.min(), x.max() + 1)


def white(pixels: NDArray[np.uint8]) -> NDArray[np.bool_]:
    return np.asarray((pixels[..., :3] == 255).all(axis=-1))


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("camera", [EYE, FLAT])
def test_the_bar_is_as_long_as_its_label_says(size: tuple[int, int], camera: Camera) -> None:
    image = ramp(size, background=(0, 0, 0))
    drawn = with_scale_bar(image, camera, "millimeter")
    height = camera.orthographic().height_world
    assert height is not None
    pixel = height / min(size)
    pixels = round_length(pixel * size[0] / 4) / pixel
    rows = white(drawn.rgba[changed(image, drawn)])
    # The bar's row is the longest run of white.
    longest = max(_run(row) for row in rows)
    assert abs(longest - pixels) <= 1


def _run(row: NDArray[np.bool_]) -> int:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], row.astype(np.int8), [0]])))
    return int(max(edges[1::2] - edges[::2], default=0))


@pytest.mark.parametrize("size", SIZES)
def test_a_perspective_label_says_where_it_holds(size: tuple[int, int]) -> None:
    image = ramp(size)
    near, flat = (with_scale_bar(image, camera, "meter") for camera in (EYE, EYE.orthographic()))
    text = [white(drawn.rgba[changed(image, drawn)]).sum() for drawn in (near, flat)]
    assert text[0] > text[1]


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("background", [(0, 0, 0), (1, 1, 1), (0.5, 0.5, 0.5), None])
def test_text_is_white_on_dark_and_the_rest_is_untouched(
    size: tuple[int, int], background: Any
) -> None:
    image = ramp(size, background=background)
    bar, legend = with_scale_bar(image, EYE, "micrometer"), with_legend(image, FUNCTION)
    for drawn in (bar, legend):
        box = changed(image, drawn)
        inside = drawn.rgba[box]
        assert white(inside).any()
        # The plate's top row, between its round corners: over white still dark.
        plate = inside[0, inside.shape[1] // 2]
        assert plate[:3].max() <= 80
        assert plate[3] >= 176
        np.testing.assert_array_equal(drawn.premultiplied, image.premultiplied)
    (bar_y, bar_x), (legend_y, legend_x) = changed(image, bar), changed(image, legend)
    assert bar_y.start > size[1] / 2
    assert bar_x.start < size[0] / 4
    assert legend_y.stop < size[1] / 2
    assert legend_x.stop > size[0] * 3 / 4


def test_a_legend_has_the_colours_by_opacity_over_checkers() -> None:
    image = ramp((768, 512), background=(0, 0, 0))
    drawn = with_legend(image, FUNCTION)
    box = drawn.rgba[changed(image, drawn)]
    row = box[box.shape[0] // 5].astype(int)
    strip = row[(row[:, :3].max(axis=1) > 80)]
    assert strip[:20, 0].std() > 10  # transparent: the checkers
    assert abs(strip[:20, 0] - strip[:20, 2]).max() < 20
    assert strip[-1, :3].tolist() == pytest.approx([0, 0, 255], abs=3)


@given(st.floats(1e-12, 1e12))
def test_round_lengths_are_the_largest_of_1_2_5_that_fit(at_most: float) -> None:
    length = round_length(at_most)
    assert length <= at_most * (1 + 1e-12)
    assert at_most < 2.5 * length * (1 + 1e-12)
    assert f"{length:e}"[0] in "125"


@given(st.floats(-1e6, 1e6), st.floats(1e-3, 1e6))
def test_round_ticks_lie_between_the_ends(low: float, extent: float) -> None:
    ticks = round_ticks(low, low + extent)
    assert 2 <= len(ticks) <= 8
    assert all(low < tick < low + extent for tick in ticks)


@pytest.mark.parametrize(
    ("length", "unit", "text"),
    [
        (50, "millimeter", "50 mm"),
        (0.05, "millimeter", "50 um"),
        (2000, "micrometer", "2 mm"),
        (100, "centimeter", "1 m"),
        (5e-4, "nanometer", "0.5 pm"),
        (20, "angstrom", "20 angstrom"),
        (0.2, None, "0.2 world units"),
    ],
)
def test_lengths_have_the_prefix_that_suits_them(length: float, unit: Any, text: str) -> None:
    assert format_length(length, unit) == text


def test_what_is_too_small_to_write_on_is_refused() -> None:
    for draw in (lambda image: with_scale_bar(image, EYE), lambda i: with_legend(i, FUNCTION)):
        with pytest.raises(InvalidInputError, match="400×127 pixels is too small"):
            draw(ramp((400, 127)))
