"""Which bricks a view needs: pure geometry and range tests, no GL and no bricks read.

A sample belongs to the brick that holds its *base voxel*, floor(p - ½) on each axis, which is the
lowest of the eight voxels that it is interpolated from. Brick ranges reach one voxel beyond the
brick, so a brick's range covers all of its samples.

Bricks are tested from the coarsest cubes of 2^k³ bricks down: what drops a cube drops its bricks.
A level may have millions of bricks of which a view needs thousands, so what follows the descent
looks at the box around those only, and a descent ends early where the caller has no use for more.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import InvalidInputError
from octobrick.renderer.brick_ranges import BrickRanges
from octobrick.renderer.brick_source import BrickSource, SourceLevel
from octobrick.renderer.camera import Camera
from octobrick.renderer.view import Size, View, box_depths_world, boxes_meet, make_view
from octobrick.store.box import Box, Zyx, ceil_div

Mask = NDArray[np.bool_]
CUBES_AT_ONCE = 1024
"""Tested together: numpy's cost of a call is small beside theirs, and few are tested in vain."""

RangeTest = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.bool_]]
"""Whether any value from low to high can be seen."""


@dataclass(frozen=True, slots=True)
class Selection:
    """The working set of one view at one level.

    Attributes:
        sampled: (nz, ny, nx) bricks in which a sample can be visible.
        needed: those and the neighbours that interpolation, gradients and filters reach into.
        box: voxels of the sampled bricks, clipped to the level; empty where there are none.
        counts: bricks of the level by what became of them; the reasons add up to "total".
    """

    sampled: Mask
    needed: Mask
    box: Box
    counts: dict[str, int]

    @property
    def every_brick(self) -> tuple[slice, ...]:
        """Slices of the masks that hold all of the level."""
        return tuple(slice(0, n) for n in self.sampled.shape)


def select_bricks(
    geometry: SourceLevel,
    brick_zyx: Zyx,
    view: View,
    ranges: Sequence[tuple[BrickRanges, RangeTest]],
    *,
    clip_planes_world: NDArray[np.float64] | None = None,
    margin_zyx: Zyx = (2, 2, 2),
    cull: bool = True,
    at_most: int | None = None,
) -> Selection | None:
    """The bricks of a level that a view needs. Dropping the others changes no pixel.

    Args:
        geometry: of the level.
        brick_zyx: voxels of a brick.
        view: whose frustum counts.
        ranges: of every channel, with the test of what its transfer function shows; a brick is
            dropped if no channel shows anything in it.
        clip_planes_world: (n, 4) half-spaces outside of which nothing is shown.
        margin_zyx: voxels around a sample's base that are read.
        cull: False keeps every brick: the reference that dropping is tested against.
        at_most: sampled bricks that are of use.

    Returns:
        The bricks; None where more than `at_most` are sampled.
    """
    total = math.prod(geometry.grid_zyx)
    counts = {"total": total, "frustum": 0, "clipped": 0, "transparent": 0}
    if not cull:
        sampled = np.ones(geometry.grid_zyx, dtype=bool)
    else:
        planes = {"frustum": view.planes_world}
        if clip_planes_world is not None and len(clip_planes_world):
            planes["clipped"] = clip_planes_world
        found = _descend(geometry, brick_zyx, planes, ranges, counts, at_most)
        if found is None:
            return None
        sampled = np.zeros(geometry.grid_zyx, dtype=bool)
        sampled[tuple(found.T)] = True
    bricks = bounding_bricks(sampled)
    counts["sampled"] = int(np.count_nonzero(sampled[bricks.slices]))
    needed = dilated(sampled, brick_zyx, margin_zyx)
    return Selection(sampled, needed, _voxels_of(bricks, geometry, brick_zyx), counts)


def finest_useful_level(source: BrickSource, camera: Camera, size: Size) -> int:
    """The coarsest level that still has a voxel per pixel where the volume is nearest.

    One level for the whole picture (design §7). A finer one would be sampled with gaps, a
    coarser one would show its voxels.
    """
    finest = source.levels[0]
    view = make_view(camera, size, finest)
    nearest, _ = box_depths_world(view, Box.of_shape(finest.shape_zyx), finest)
    pixel = view.pixel_size_at(nearest)
    voxel = min(finest.spacing_xyz)
    wanted = math.floor(math.log2(pixel / voxel)) if pixel > voxel else 0
    return min(wanted, len(source.levels) - 1)


def checked_level(source: BrickSource, level: int | None) -> int | None:
    """The level that the caller asks for, or None.

    Raises:
        InvalidInputError: there is no such level.
    """
    if level is not None and not (
        isinstance(level, (int, np.integer)) and 0 <= level < len(source.levels)
    ):
        raise InvalidInputError(
            f"level {level!r}: there are levels 0 to {len(source.levels) - 1}; None lets the "
            "renderer choose",
        )
    return None if level is None else int(level)


def ordered(bricks: Mask, geometry: SourceLevel, brick_zyx: Zyx, view: View) -> NDArray[np.intp]:
    """The bricks of a mask (n, 3) as (z, y, x), front to back.

    By slabs of bricks across the view's main axis, as they are drawn, and in each by distance.
    """
    found = bricks_in(bricks)
    if not len(found):
        return found
    low, high = brick_bounds(found, 0, geometry, brick_zyx)
    depth = view.depth_world((low + high) / 2)
    axis_xyz = view.main_axis
    along = found[:, 2 - axis_xyz] * math.copysign(1, view.forward_world[axis_xyz])
    if view.eye_world_is_point:  # bricks on both sides of an eye within the volume
        eye = view.eye_world[axis_xyz]
        along = np.maximum(np.maximum(low[:, axis_xyz] - eye, eye - high[:, axis_xyz]), 0)
    return np.asarray(found[np.lexsort((depth, along))])


def brick_bounds(
    bricks_zyx: NDArray[np.intp], k: int, geometry: SourceLevel, brick_zyx: Zyx
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """World corners (n, 3) of where samples of cubes of 2^k³ bricks lie.

    Up to half a voxel beyond their base voxels, where that is not the end of the volume.
    """
    spacing, origin = np.array(geometry.spacing_xyz), np.array(geometry.origin_xyz)
    edge = np.array(brick_zyx) << k
    start = bricks_zyx * edge
    stop = np.minimum(start + edge + 1, geometry.shape_zyx)
    corner = origin - spacing / 2
    return corner + start[:, ::-1] * spacing, corner + stop[:, ::-1] * spacing


def bounding_bricks(mask: Mask) -> Box:
    """The smallest box of bricks around those of a mask; empty where there are none."""
    if not mask.any():
        return Box((0, 0, 0), (0, 0, 0))
    start, stop = [], []
    by_row = np.asarray(mask.any(axis=2))  # once, as it is what takes long
    projections = (by_row.any(axis=1), by_row.any(axis=0), mask.any(axis=(0, 1)))
    for used in map(np.asarray, projections):
        start.append(int(used.argmax()))
        stop.append(len(used) - int(used[::-1].argmax()))
    (sz, sy, sx), (ez, ey, ex) = start, stop
    return Box((sz, sy, sx), (ez, ey, ex))


def bricks_in(mask: Mask) -> NDArray[np.intp]:
    """The bricks (n, 3) of a mask as (z, y, x)."""
    box = bounding_bricks(mask)
    return np.asarray(np.argwhere(mask[box.slices]) + box.start_zyx)


def dilated(mask: Mask, brick_zyx: Zyx, margin_zyx: Zyx) -> Mask:
    """The mask grown by the bricks within some voxels, diagonals included."""
    box = bounding_bricks(mask)
    if box.nvoxels == 0:
        return mask.copy()
    reach = [ceil_div(margin, edge) for margin, edge in zip(margin_zyx, brick_zyx, strict=True)]
    around = tuple(
        slice(max(part.start - n, 0), part.stop + n)
        for part, n in zip(box.slices, reach, strict=True)
    )
    grown = np.zeros_like(mask)
    grown[around] = _grown(mask[around], reach)
    return grown


def _grown(mask: Mask, reach_zyx: Sequence[int]) -> Mask:
    for axis, reach in enumerate(reach_zyx):
        grown = mask.copy()
        for distance in range(1, min(reach, mask.shape[axis] - 1) + 1):
            ahead, behind = [slice(None)] * 3, [slice(None)] * 3
            ahead[axis], behind[axis] = slice(distance, None), slice(None, -distance)
            grown[tuple(ahead)] |= mask[tuple(behind)]
            grown[tuple(behind)] |= mask[tuple(ahead)]
        mask = grown
    return mask


def _descend(
    geometry: SourceLevel,
    brick_zyx: Zyx,
    planes: dict[str, NDArray[np.float64]],
    ranges: Sequence[tuple[BrickRanges, RangeTest]],
    counts: dict[str, int],
    at_most: int | None,
) -> NDArray[np.intp] | None:
    """The bricks (n, 3) that pass all tests; the others are counted by the first that they fail.

    Depth first, some thousand cubes at once; None as soon as there are more than `at_most`.
    """
    grid = np.array(geometry.grid_zyx)
    top = max(0, int(grid.max() - 1).bit_length())
    waiting = [(top, np.zeros((1, 3), np.intp))]
    found, nfound = [np.empty((0, 3), np.intp)], 0
    while waiting:
        k, nodes = waiting.pop()
        low, high = brick_bounds(nodes, k, geometry, brick_zyx)
        for reason, half_spaces in planes.items():
            keep = boxes_meet(half_spaces, low, high)
            counts[reason] += _bricks_within(nodes[~keep], k, grid)
            nodes, low, high = nodes[keep], low[keep], high[keep]
        seen = np.zeros(len(nodes), bool)
        at = tuple(nodes.T)
        for tree, test in ranges:
            seen |= test(tree.lows[k][at], tree.highs[k][at])
        counts["transparent"] += _bricks_within(nodes[~seen], k, grid)
        nodes = nodes[seen]
        if k == 0:
            found.append(nodes)
            nfound += len(nodes)
            if at_most is not None and nfound > at_most:
                return None
        elif len(nodes):
            nodes = _children(nodes, k - 1, grid)
            parts = range(0, len(nodes), CUBES_AT_ONCE)
            waiting += [(k - 1, nodes[i : i + CUBES_AT_ONCE]) for i in parts]
    return np.concatenate(found)


_OCTANTS = np.array(list(np.ndindex(2, 2, 2)), np.intp)


def _children(nodes: NDArray[np.intp], k: int, grid: NDArray[np.intp]) -> NDArray[np.intp]:
    children = (2 * nodes[:, np.newaxis] + _OCTANTS).reshape(-1, 3)
    beyond = -(-grid >> k)
    if (2 * nodes.max(axis=0) + 1 < beyond).all():
        return children
    return np.asarray(children[(children < beyond).all(axis=1)])


def _bricks_within(nodes: NDArray[np.intp], k: int, grid: NDArray[np.intp]) -> int:
    """How many bricks the cubes hold."""
    if not len(nodes):
        return 0
    start = nodes << k
    return int(np.prod(np.minimum(start + (1 << k), grid) - start, axis=1).sum())


def _voxels_of(bricks: Box, geometry: SourceLevel, brick_zyx: Zyx) -> Box:
    """The voxels of a box of bricks, clipped to the level."""
    if bricks.nvoxels == 0:
        return bricks
    start, stop = np.array(bricks.start_zyx) * brick_zyx, np.array(bricks.stop_zyx) * brick_zyx
    (sz, sy, sx), (ez, ey, ex) = start.tolist(), stop.tolist()
    return Box((sz, sy, sx), (ez, ey, ex)).intersect(Box.of_shape(geometry.shape_zyx))
