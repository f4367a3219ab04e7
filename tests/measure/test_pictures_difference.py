"""Difference pictures: the paper's colours, exactly at its thresholds."""

from __future__ import annotations

import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image

from octobrick.codec.errors import InvalidInputError
from octobrick.measure.pictures import difference_picture
from octobrick.measure.pictures.difference_picture import (
    CLASSES,
    class_shares,
    difference_png,
    error_classes,
    error_colours,
    pixel_errors,
)

# 255 · 5 % is 12.75, · 10 % 25.5, · 15 % 38.25.
THRESHOLDS = [(0, 0), (1, 1), (12, 1), (13, 2), (25, 2), (26, 3), (38, 3), (39, 4), (255, 4)]


def hue(rgb: NDArray[np.uint8]) -> str:
    """The colour's name, by eye."""
    red, green, blue = (int(component) for component in rgb)
    if red == green == blue == 0:
        return "black"
    if blue > red and blue > green:
        return "blue"
    if green > red:
        return "green"
    return "yellow" if green >= 200 else "red or orange"


@pytest.mark.parametrize(("error", "index"), THRESHOLDS)
def test_a_class_begins_exactly_at_its_threshold(error: int, index: int) -> None:
    assert error_classes()[error] == index
    names = ["black", "blue", "green", "yellow", "red or orange"]
    assert hue(error_colours()[error]) == names[index]


def test_greater_errors_go_from_orange_to_plain_red() -> None:
    red, green, _ = error_colours()[39:].astype(int).T
    assert (np.diff(green) <= 0).all()
    assert tuple(error_colours()[77]) == CLASSES[-1].last == tuple(error_colours()[255])
    assert red.min() >= 200


@given(st.tuples(*[st.integers(0, 255)] * 3), st.tuples(*[st.integers(0, 255)] * 3))
def test_a_pixels_error_is_the_greatest_of_its_channels_either_way(
    a: tuple[int, int, int], b: tuple[int, int, int]
) -> None:
    one, other = (np.array(rgb, np.uint8).reshape(1, 1, 3) for rgb in (a, b))
    greatest = max(abs(x - y) for x, y in zip(a, b, strict=True))
    assert pixel_errors(one, other)[0, 0] == pixel_errors(other, one)[0, 0] == greatest
    assert np.array_equal(difference_picture(one, other)[0, 0], error_colours()[greatest])


def test_a_png_has_the_colours_of_the_picture_and_the_errors_as_indices() -> None:
    errors = np.arange(256, dtype=np.uint8).reshape(16, 16)
    picture = Image.open(io.BytesIO(difference_png(errors)))
    assert np.array_equal(np.asarray(picture), errors)
    assert np.array_equal(np.asarray(picture.convert("RGB")), error_colours()[errors])


def test_shares_are_of_all_pixels() -> None:
    assert class_shares(np.array([[0, 1, 12, 13], [25, 26, 39, 255]], np.uint8)) == (
        1 / 8, 2 / 8, 2 / 8, 1 / 8, 2 / 8,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("shape", "other"), [((4, 4), (4, 4)), ((4, 4, 4), (4, 4, 4)), ((4, 4, 3), (4, 5, 3))]
)
def test_what_is_no_pair_of_pictures_is_refused(
    shape: tuple[int, ...], other: tuple[int, ...]
) -> None:
    with pytest.raises(InvalidInputError, match=r"shape"):
        difference_picture(np.zeros(shape, np.uint8), np.zeros(other, np.uint8))
    with pytest.raises(InvalidInputError, match="float64"):
        difference_picture(np.zeros((4, 4, 3)), np.zeros((4, 4, 3)))  # type: ignore[arg-type]
