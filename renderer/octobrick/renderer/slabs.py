"""Cutting a view's box into slabs that fit the decode buffer, nearest first.

A ray's sample belongs to exactly one slab: that between whose planes its position on the main
axis lies. Every slab is decoded with the margin of voxels that its samples touch, so the picture
does not depend on where the cuts are: not even in its last bit, because the buffer's sides are
powers of two. Texture coordinates are then exact, and so are the weights of the interpolation,
wherever in the texture a voxel lies.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from octobrick.renderer.cells import cell_shape
from octobrick.store.box import Box, Zyx


@dataclass(frozen=True, slots=True)
class Slab:
    """Voxels that are decoded together, and the part of the rays that they serve.

    Attributes:
        low: samples from this position (voxel space) on the main axis belong here; -inf for the
            first slab, because what lies in front of the box belongs to no other.
        high: the position from which on they no longer do; inf for the last.
        content: the voxels decoded: the slab and its margin, clipped to the level.
    """

    low: float
    high: float
    content: Box


@dataclass(frozen=True, slots=True)
class SlabPlan:
    """Slabs in the order in which every ray meets them, and the buffer that holds each of them."""

    axis_zyx: int
    slabs: tuple[Slab, ...]
    buffer_zyx: Zyx


def plan_slabs(
    box: Box,
    level_shape_zyx: Zyx,
    brick_zyx: Zyx,
    axis_zyx: int,
    eye_on_axis: float,
    *,
    margin: int,
    fits: Callable[[Zyx], bool],
    side_max: int,
) -> SlabPlan | None:
    """Cut a box into as few slabs as the buffer allows; None where not even one voxel's depth fits.

    Cuts lie between cells, if the buffer holds one: its sides are powers of two, of which cuts
    between bricks would leave much unused.

    Args:
        box: the voxels of the sampled bricks, not empty.
        level_shape_zyx: voxels of the level.
        brick_zyx: voxels of a brick.
        axis_zyx: the array axis along which slabs follow each other.
        eye_on_axis: the eye's position on that axis in voxel space; ±inf for a direction.
        margin: voxels around a sample's base that are read.
        fits: whether a buffer of these sides may be had.
        side_max: the longest side that a 3D texture may have.
    """
    level = Box.of_shape(level_shape_zyx)
    sides = [power_of_two(n) for n in box.grow(margin).intersect(level).shape_zyx]
    start, stop = box.start_zyx[axis_zyx], box.stop_zyx[axis_zyx]
    depth = stop - start
    whole = sides[axis_zyx]
    while max(sides) > side_max or not fits((sides[0], sides[1], sides[2])):
        sides[axis_zyx] //= 2
        if sides[axis_zyx] <= 2 * margin:
            return None
    if sides[axis_zyx] < whole:
        cell, depth = cell_shape(brick_zyx)[axis_zyx], sides[axis_zyx] - 2 * margin
        depth = depth // cell * cell or depth
    cuts = [*range(start + depth, stop, depth)]
    lows, highs = [start, *cuts], [*cuts, stop]
    slabs = [
        Slab(
            low=float(low) if low > start else -math.inf,
            high=float(high) if high < stop else math.inf,
            content=_part(box, axis_zyx, low, high).grow(margin).intersect(level),
        )
        for low, high in zip(lows, highs, strict=True)
    ]
    order = sorted(range(len(slabs)), key=lambda i: _distance(lows[i], highs[i], eye_on_axis))
    z, y, x = (power_of_two(max(s.content.shape_zyx[a] for s in slabs)) for a in range(3))
    return SlabPlan(axis_zyx, tuple(slabs[i] for i in order), (z, y, x))


def power_of_two(n: int) -> int:
    """The smallest power of two that is at least n, for positive n."""
    return 1 << (n - 1).bit_length()


def _part(box: Box, axis: int, low: int, high: int) -> Box:
    start, stop = list(box.start_zyx), list(box.stop_zyx)
    start[axis], stop[axis] = low, high
    return Box((start[0], start[1], start[2]), (stop[0], stop[1], stop[2]))


def _distance(low: float, high: float, eye: float) -> float:
    """How far the eye is from a slab; for an eye at infinity, in the order of its direction."""
    if math.isinf(eye):
        return low if eye < 0 else -high
    return max(low - eye, eye - high, 0.0)
