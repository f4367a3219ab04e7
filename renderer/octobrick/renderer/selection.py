"""Which bricks a view needs: pure geometry and range tests, no GL and no bricks read.

A sample belongs to the brick that holds its *base voxel*, floor(p - ½) on each axis, which is the
lowest of the eight voxels that it is interpolated from. Brick ranges reach one voxel beyond the
brick, so a brick's range covers all of its samples.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import InvalidInputError
from octobrick.renderer.brick_descent import RangeTest, descend
from octobrick.renderer.brick_ranges import BrickRanges
from octobrick.renderer.brick_source import BrickSource, SourceLevel
from octobrick.renderer.camera import Camera
from octobrick.renderer.view import Size, View, nearest_pixel_world
from octobrick.store.box import Box, Zyx, ceil_div

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Selection:
    """The working set of one view at one level.

    Attributes:
        sampled: (nz, ny, nx) bricks in which a sample can be visible.
        needed: those and the neighbours that interpolation, gradients and filters reach into.
        box: voxels of the sampled bricks, clipped to the level; empty where there are none.
        counts: bricks of the level by what became of them; the reasons add up to "total".
        part: slices of the masks, outside of which no brick is needed.
        nneeded: how many bricks are.
    """

    sampled: Mask
    needed: Mask
    box: Box
    counts: dict[str, int]
    part: tuple[slice, slice, slice]
    nneeded: int

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
) -> Selection:
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
    """
    total = math.prod(geometry.grid_zyx)
    selection = select_within(
        total,
        geometry,
        brick_zyx,
        view,
        ranges,
        clip_planes_world=clip_planes_world,
        margin_zyx=margin_zyx,
        cull=cull,
    )
    assert selection is not None
    return selection


def select_within(
    bricks_max: int,
    geometry: SourceLevel,
    brick_zyx: Zyx,
    view: View,
    ranges: Sequence[tuple[BrickRanges, RangeTest]],
    *,
    clip_planes_world: NDArray[np.float64] | None = None,
    margin_zyx: Zyx = (2, 2, 2),
    cull: bool = True,
) -> Selection | None:
    """What `select_bricks` gives; None as soon as more bricks than that are sampled."""
    total = math.prod(geometry.grid_zyx)
    counts = {"total": total, "frustum": 0, "clipped": 0, "transparent": 0}
    if not cull:
        every = np.ones(geometry.grid_zyx, dtype=bool)
        part = (slice(None), slice(None), slice(None))
        box = Box.of_shape(geometry.shape_zyx)
        return Selection(every, every, box, counts | {"sampled": total}, part, total)
    planes = {"frustum": view.planes_world}
    if clip_planes_world is not None and len(clip_planes_world):
        planes["clipped"] = clip_planes_world
    descent = descend(geometry, brick_zyx, planes, ranges, bricks_max)
    if descent is None:
        return None
    found, dropped = descent
    counts |= dropped | {"sampled": found.shape[1]}
    sampled, needed = (np.zeros(geometry.grid_zyx, bool) for _ in range(2))
    if not found.size:
        nothing = (slice(0, 0), slice(0, 0), slice(0, 0))
        return Selection(sampled, needed, Box((0, 0, 0), (0, 0, 0)), counts, nothing, 0)
    sampled[tuple(found)] = True
    low, high = found.min(axis=1), found.max(axis=1) + 1
    sz, sy, sx = (
        slice(max(0, int(a) - reach), min(n, int(b) + reach))
        for a, b, n, reach in zip(
            low, high, geometry.grid_zyx, _reach(brick_zyx, margin_zyx), strict=True
        )
    )
    part = (sz, sy, sx)
    needed[part] = dilated(sampled[part], brick_zyx, margin_zyx)
    box = _box_of(low, high, geometry, brick_zyx)
    return Selection(sampled, needed, box, counts, part, int(np.count_nonzero(needed[part])))


def finest_useful_level(source: BrickSource, camera: Camera, size: Size) -> int:
    """The coarsest level that still has a voxel per pixel where the volume is nearest.

    One level for the whole picture (design §7). A finer one would be sampled with gaps, a
    coarser one would show its voxels.
    """
    finest = source.levels[0]
    pixel = nearest_pixel_world(camera, size, finest)
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


def ordered(
    bricks: Mask,
    geometry: SourceLevel,
    brick_zyx: Zyx,
    view: View,
    part: tuple[slice, slice, slice] = (slice(None), slice(None), slice(None)),
) -> NDArray[np.intp]:
    """The bricks of a part of a mask (n, 3) as (z, y, x), front to back.

    By slabs of bricks across the view's main axis, as they are drawn, and in each by distance.
    """
    found: NDArray[np.intp] = np.argwhere(bricks[part])
    found += [axis.start or 0 for axis in part]
    if not len(found):
        return np.asarray(found)
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


def dilated(mask: Mask, brick_zyx: Zyx, margin_zyx: Zyx) -> Mask:
    """The mask grown by the bricks within some voxels, diagonals included."""
    for axis, reach in enumerate(_reach(brick_zyx, margin_zyx)):
        grown = mask.copy()
        for distance in range(1, min(reach, mask.shape[axis] - 1) + 1):
            ahead, behind = [slice(None)] * 3, [slice(None)] * 3
            ahead[axis], behind[axis] = slice(distance, None), slice(None, -distance)
            grown[tuple(ahead)] |= mask[tuple(behind)]
            grown[tuple(behind)] |= mask[tuple(ahead)]
        mask = grown
    return mask


def _reach(brick_zyx: Zyx, margin_zyx: Zyx) -> list[int]:
    """Bricks along each axis that some voxels reach across."""
    return [ceil_div(margin, edge) for edge, margin in zip(brick_zyx, margin_zyx, strict=True)]


def _box_of(
    low: NDArray[np.intp], high: NDArray[np.intp], geometry: SourceLevel, brick_zyx: Zyx
) -> Box:
    """The voxels of bricks from one to before another, clipped to the level."""
    sz, sy, sx = (int(n) * edge for n, edge in zip(low, brick_zyx, strict=True))
    ez, ey, ex = (int(n) * edge for n, edge in zip(high, brick_zyx, strict=True))
    return Box((sz, sy, sx), (ez, ey, ex)).intersect(Box.of_shape(geometry.shape_zyx))
