"""Axes: any order of letters gives the boxes that numpy's own transposition gives."""

from __future__ import annotations

from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from octobrick.codec.errors import InvalidInputError
from octobrick.store.box import Box
from octobrick.store.errors import SourceError, UnsupportedSourceError
from octobrick.store.sources.axes import Strides, axes_of
from octobrick.store.sources.base import RGB, RGBA

PATH = Path("a.npy")
SIZES = {"t": 2, "c": 3, "z": 4, "y": 5, "x": 6}
BOX = Box((1, 2, 1), (3, 5, 4))
ORDERS = st.sets(st.sampled_from("tcz")).flatmap(
    lambda more: st.permutations(sorted({"y", "x", *more}))
)


def full(array: np.ndarray, letters: str) -> np.ndarray:
    """The array as (t, c, z, y, x), by numpy alone."""
    wanted = "tczyx"
    kept = [letter for letter in wanted if letter in letters]
    array = array.transpose([letters.index(letter) for letter in kept])
    return array.reshape([SIZES[letter] if letter in letters else 1 for letter in wanted])


@given(ORDERS.map("".join), st.booleans())
def test_every_order_selects_the_box_and_lies_where_numpy_puts_it(letters, fortran):
    sizes = [SIZES[letter] for letter in letters]
    array = np.arange(np.prod(sizes)).reshape(sizes)
    whole = full(array, letters)
    axes = axes_of(sizes, letters, PATH)
    assert (axes.nt, axes.nc, *axes.shape_zyx) == whole.shape
    box = Box.of_shape(axes.shape_zyx).intersect(BOX)
    box = box if box.nvoxels else Box.of_shape(axes.shape_zyx)
    for t, c in ((0, 0), (axes.nt - 1, axes.nc - 1)):
        np.testing.assert_array_equal(
            axes.to_zyx(array[axes.index(box, t, c)]), whole[(t, c, *box.slices)]
        )
        np.testing.assert_array_equal(
            axes.to_czyx(array[axes.index(box, t, None)]),
            whole[(t, slice(None), *box.slices)],
        )
    flat = array.ravel(order="F" if fortran else "C")
    at = tuple(size - 1 for size in whole.shape)
    strides = axes.strides(fortran=fortran)
    assert flat[sum(i * step for i, step in zip(at, strides, strict=True))] == whole[at]


def test_three_axes_are_z_y_x_where_nobody_says_otherwise():
    axes = axes_of((2, 3, 4), None, PATH)
    assert (axes.letters, axes.shape_zyx, axes.strides()) == (
        "zyx",
        (2, 3, 4),
        Strides(t=0, c=0, z=12, y=4, x=1),
    )
    assert axes.strides(fortran=True) == Strides(t=0, c=0, z=1, y=2, x=6)


@pytest.mark.parametrize(("n", "channels"), [(1, ()), (2, ()), (3, RGB), (4, RGBA), (5, ())])
def test_samples_are_colours_where_there_are_three_or_four(n, channels):
    axes = axes_of((2, 3, 4, n), "zyxs", PATH)
    assert (axes.nc, axes.channels) == (n, channels)
    assert axes_of((n, 2, 3, 4), "czyx", PATH).channels == ()


def test_samples_beside_one_channel_are_the_channels():
    axes = axes_of((1, 2, 3, 4, 3), "czyxs", PATH)
    assert (axes.nc, axes.channels) == (3, RGB)
    array = np.arange(72).reshape(1, 2, 3, 4, 3)
    part = axes.to_zyx(array[axes.index(Box.of_shape((2, 3, 4)), 0, 2)])
    np.testing.assert_array_equal(part, array[0, ..., 2])


@pytest.mark.parametrize("letters", ["".join(order) for order in permutations("zyx")])
def test_only_z_y_x_in_that_order_is_a_box_as_it_is(letters):
    assert axes_of((2, 3, 4), letters, PATH).is_zyx == (letters == "zyx")


def test_one_value_for_each_axis_gives_those_of_space():
    assert axes_of((2, 3, 4), "cxy", PATH).of_zyx((7, 8, 9), 1) == (1, 9, 8)


@pytest.mark.parametrize("shape", [(3, 4), (2, 3, 4, 5), (1, 1, 2, 3, 4, 5, 6)])
def test_axes_that_nobody_names_are_asked_for_with_the_shape(shape):
    with pytest.raises(InvalidInputError, match=r"a\.npy.*--axes tzyx.*zyxs") as caught:
        axes_of(shape, None, PATH)
    assert f"{list(shape)}" in caught.value.message


@pytest.mark.parametrize(
    "letters", ["", "zyq", "zzyx"[1:] + "z", "zy", "zyxt", "zxx", "ZYX", "tcz"]
)
def test_letters_that_do_not_fit_are_refused_with_both_sides(letters):
    with pytest.raises(InvalidInputError, match=r"\[2, 3, 4\].*t, c, z, y, x, s") as caught:
        axes_of((2, 3, 4), letters, PATH)
    assert repr(letters) in caught.value.message


@pytest.mark.parametrize("shape", [(), (3,)])
def test_fewer_than_two_axes_are_no_volume(shape):
    with pytest.raises(UnsupportedSourceError, match=f"{len(shape)} axes"):
        axes_of(shape, None, PATH)


@pytest.mark.parametrize(("letters", "shape"), [("tyx", (0, 3, 4)), ("zyxs", (2, 3, 4, 0))])
def test_an_axis_without_elements_is_refused(letters, shape):
    with pytest.raises(SourceError, match="every axis needs at least 1"):
        axes_of(shape, letters, PATH)


def test_channels_of_several_samples_are_refused():
    with pytest.raises(UnsupportedSourceError, match="2 channels of 3 samples"):
        axes_of((2, 3, 4, 3), "cyxs", PATH)
