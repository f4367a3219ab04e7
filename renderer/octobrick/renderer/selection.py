"""Which bricks a view needs: pure geometry and range tests, no GL and no bricks read.

A sample belongs to the brick that holds its *base voxel*, floor(p - ½) on each axis, which is the
lowest of the eight voxels that it is interpolated from. Brick ranges reach one voxel beyond the
brick, so a brick's range covers all of its samples.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import InvalidInputError
from octobrick.renderer.brick_source import BrickSource, SourceLevel
from octobrick.renderer.camera import Camera
from octobrick.renderer.classifier import Classifier
from octobrick.renderer.view import Size, View, box_depths_world, make_view
from octobrick.store.box import Box, Zyx, ceil_div

SAMPLE_MARGIN = 2
"""Voxels around a sample's base that shading can touch: interpolation 1, differences 1."""

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Selection:
    """The working set of one view at one level.

    Attributes:
        sampled: (nz, ny, nx) bricks in which a sample can be visible.
        needed: those and the neighbours that interpolation and gradients reach into.
        box: voxels of the sampled bricks, clipped to the level; empty where there are none.
        counts: bricks of the level by what became of them; the reasons add up to "total".
    """

    sampled: Mask
    needed: Mask
    box: Box
    counts: dict[str, int]


def select_bricks(
    source: BrickSource,
    level: int,
    view: View,
    classifier: Classifier,
    *,
    t: int = 0,
    c: int = 0,
    cull: bool = True,
) -> Selection:
    """The bricks of a level that a view needs. Dropping the others changes no pixel.

    Args:
        cull: False keeps every brick: the reference that dropping is tested against.
    """
    geometry, brick = source.levels[level], source.brick_shape_zyx
    shape = tuple(geometry.grid_zyx)
    if cull:
        in_view = _in_view(geometry, brick, view)
        visible = classifier.visible(*_decoded_ranges(source, level, t, c))
    else:
        in_view = visible = np.ones(shape, dtype=bool)
    sampled = in_view & visible
    total, nsampled = sampled.size, int(sampled.sum())
    outside = total - int(in_view.sum())
    counts = {
        "total": total,
        "frustum": outside,
        "transparent": total - outside - nsampled,
        "sampled": nsampled,
    }
    needed = _dilate(sampled, brick)
    return Selection(sampled, needed, _bounding_box(sampled, geometry, brick), counts)


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


def _in_view(geometry: SourceLevel, brick: Zyx, view: View) -> Mask:
    """Which bricks' samples may be in view."""
    spacing, origin = np.array(geometry.spacing_xyz), np.array(geometry.origin_xyz)
    lows, highs = [], []
    for nvoxels, nbricks, edge in zip(geometry.shape_zyx, geometry.grid_zyx, brick, strict=True):
        start = np.arange(nbricks) * edge
        # Base voxels [start, start + edge): positions up to half a voxel beyond the brick, where
        # that is not the end of the volume.
        lows.append(start.astype(float))
        highs.append(np.minimum(start + edge + 1.0, nvoxels))
    low_zyx = np.stack(np.meshgrid(*lows, indexing="ij"), axis=-1)
    high_zyx = np.stack(np.meshgrid(*highs, indexing="ij"), axis=-1)
    corner = origin - spacing / 2
    return view.meets(corner + low_zyx[..., ::-1] * spacing, corner + high_zyx[..., ::-1] * spacing)


def _decoded_ranges(
    source: BrickSource, level: int, t: int, c: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Bounds of what interpolation between *decoded* voxels can give in each brick.

    Stored ranges are those of the originals. Inside a brick S3Dc stays within them; the one voxel
    beyond was decoded from another brick, so it may lie outside by that brick's error.
    """
    ranges = np.asarray(source.ranges(level, t, c), dtype=np.float64)
    errors = np.asarray(source.fidelity(level, t, c), dtype=np.float64)[..., 0]
    slack = _neighbourhood_max(errors)
    return ranges[..., 0] - slack, ranges[..., 1] + slack


def _neighbourhood_max(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """The largest of each cell and its 26 neighbours."""
    for axis in range(3):
        padded = np.pad(values, [(1, 1) if a == axis else (0, 0) for a in range(3)], mode="edge")
        n = values.shape[axis]
        values = np.maximum.reduce([padded.take(range(i, i + n), axis) for i in range(3)])
    return values


def _dilate(mask: Mask, brick: Zyx) -> Mask:
    """The mask grown by the bricks within SAMPLE_MARGIN voxels, diagonals included."""
    for axis, edge in enumerate(brick):
        radius = ceil_div(SAMPLE_MARGIN, edge)
        n = mask.shape[axis]
        padded = np.pad(mask, [(radius, radius) if a == axis else (0, 0) for a in range(3)])
        mask = np.logical_or.reduce(
            [padded.take(range(i, i + n), axis) for i in range(2 * radius + 1)]
        )
    return mask


def _bounding_box(mask: Mask, geometry: SourceLevel, brick: Zyx) -> Box:
    if not mask.any():
        return Box((0, 0, 0), (0, 0, 0))
    start, stop = [], []
    for axis, edge in enumerate(brick):
        used = np.flatnonzero(mask.any(axis=tuple(a for a in range(3) if a != axis)))
        start.append(int(used[0]) * edge)
        stop.append((int(used[-1]) + 1) * edge)
    sz, sy, sx = start
    ez, ey, ex = stop
    return Box((sz, sy, sx), (ez, ey, ex)).intersect(Box.of_shape(geometry.shape_zyx))
