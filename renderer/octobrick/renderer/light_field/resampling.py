"""The pixels of a picture from views: pure functions of arrays.

An eye sees through pixel (x, y) along one ray. The ray meets the plane of the cameras at (u, v)
and, in view i of that plane, lies at pixel ``x + focus · (i − u)``: it meets the plane in focus at
the point that this pixel of view i shows. Along x only u counts, along y only v, so that all is
done one axis after the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from octobrick.renderer.light_field.eye import Eye, Interpolation

Floats = NDArray[np.float32]
Pixels = NDArray[np.uint8] | NDArray[np.uint16]


@dataclass(frozen=True, slots=True)
class AxisShare:
    """What one column of cameras gives to the picture along x (or one row along y).

    Attributes:
        weights: by which the view counts at each pixel, 0 where it does not. All else is of the
            pixels where it is not 0, which are neighbours.
        pixels: of the picture.
        first: pixel of the view that is read.
        second: the next one, to blend with; the same where none is needed.
        share: of the second, 0 to 1.
    """

    weights: Floats
    pixels: slice
    first: NDArray[np.intp]
    second: NDArray[np.intp]
    share: Floats


def shares(
    at: float, eye: Eye, npixels: int, width: int, ncameras: int, interpolation: Interpolation
) -> dict[int, AxisShare]:
    """What each column (or row) of cameras gives, by its number; without those that give nothing.

    Args:
        at: the eye's u (or v).
        eye: its focus and spread.
        npixels: of the picture, and of each view, along this axis.
        width: pixels that the eye's spread is of.
        ncameras: along this axis.
        interpolation: how views and pixels are combined.
    """
    pixels = np.arange(npixels)
    meets = at + eye.spread * (pixels - (npixels - 1) / 2) / width
    inside = (meets >= 0) & (meets <= ncameras - 1)
    found = {}
    for camera in range(*_between(meets, inside)):
        if interpolation == "uvst":
            weights = np.maximum(1 - np.abs(meets - camera), 0)
        else:
            weights = (np.floor(meets + 0.5) == camera).astype(np.float64)
        places = pixels + eye.focus * (camera - meets)
        weights[~inside | (places < -0.5) | (places >= npixels - 0.5)] = 0
        share = _share(weights, places, npixels, interpolation)
        if share is not None:
            found[camera] = share
    return found


def _between(meets: NDArray[np.float64], inside: NDArray[np.bool_]) -> tuple[int, int]:
    """The first and the last but one of the cameras that rays can meet."""
    if not inside.any():
        return 0, 0
    return int(np.floor(meets[inside].min())), int(np.ceil(meets[inside].max())) + 1


def _share(
    weights: NDArray[np.float64],
    places: NDArray[np.float64],
    npixels: int,
    interpolation: Interpolation,
) -> AxisShare | None:
    counting = np.flatnonzero(weights)
    if not counting.size:
        return None
    used = slice(int(counting[0]), int(counting[-1]) + 1)
    places = places[used]
    if interpolation == "nearest":
        places = np.floor(places + 0.5)
    # Half a pixel beyond the last centre is still of that pixel.
    places = np.clip(places, 0, npixels - 1)
    first = np.floor(places).astype(np.intp)
    second = np.minimum(first + 1, npixels - 1)
    share = (places - first).astype(np.float32)
    return AxisShare(weights[used].astype(np.float32), used, first, second, share)


def add_view(
    total: Floats, weight: Floats, view: Pixels, along_y: AxisShare, along_x: AxisShare
) -> None:
    """Add the weighted pixels of a view, and their weights.

    Args:
        total: (y, x, c), grows.
        weight: (y, x), grows.
        view: (y, x, c).
        along_y: what the view's row of cameras gives.
        along_x: what its column gives.
    """
    rows = _blended(view, along_y, 0)
    pixels = _blended(rows, along_x, 1)
    weights = along_y.weights[:, np.newaxis] * along_x.weights
    here = (along_y.pixels, along_x.pixels)
    total[here] += pixels * weights[..., np.newaxis]
    weight[here] += weights


def _blended(pixels: Pixels | Floats, along: AxisShare, axis: int) -> Floats:
    """Pixels at the places that one axis asks for."""
    first = np.take(pixels, along.first, axis).astype(np.float32, copy=False)
    if not along.share.any():
        return first
    second = np.take(pixels, along.second, axis).astype(np.float32, copy=False)
    share = along.share.reshape([-1 if i == axis else 1 for i in range(3)])
    return first + share * (second - first)
