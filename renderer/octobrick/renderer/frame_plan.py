"""What a picture will take: the level, the bricks, the slabs. Pure: no GL and no bricks read."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from octobrick.renderer.brick_descent import RangeTest
from octobrick.renderer.brick_ranges import BrickRanges, brick_ranges, luminance_ranges
from octobrick.renderer.brick_source import BrickSource, SourceLevel
from octobrick.renderer.classifier import Classifier, ValueScale
from octobrick.renderer.code_layout import CodeLayout
from octobrick.renderer.errors import PictureTooLargeError
from octobrick.renderer.modes import Slice
from octobrick.renderer.render_request import RenderRequest
from octobrick.renderer.selection import Selection, finest_useful_level, select_within
from octobrick.renderer.slab_set import SlabLayout
from octobrick.renderer.slabs import SlabPlan, plan_slabs
from octobrick.renderer.transfer_function import TransferFunction
from octobrick.renderer.view import View, make_view
from octobrick.store.box import Zyx

LUMINANCE = (0.2126, 0.7152, 0.0722)
"""Of red, green and blue (Rec. 709), as shaders/classify.glsl has it."""


@dataclass(frozen=True, slots=True)
class Limits:
    """What a plan must keep to.

    Attributes:
        brick_nbytes: for compressed bricks.
        slab_nbytes: for the buffers of a slab; None plans no slabs.
        volume_side_max: voxels along a side of a 3D texture.
    """

    brick_nbytes: int
    slab_nbytes: int | None = None
    volume_side_max: int = 2048


@dataclass(frozen=True, slots=True)
class FramePlan:
    """What a call will do at the level chosen.

    Attributes:
        level: of the pyramid.
        view: the rays.
        classifiers: of each channel.
        selection: the bricks.
        layout: of the slab buffers.
        slabs: None where there is nothing to see, or none were asked for.
        step_world: distance of samples.
        reference_length_world: what the first transfer function's opacities are meant for.
    """

    level: int
    view: View
    classifiers: tuple[Classifier, ...]
    selection: Selection
    layout: SlabLayout
    slabs: SlabPlan | None
    step_world: float
    reference_length_world: float


def plan_frame(
    request: RenderRequest, limits: Limits, *, cull: bool = True, finest: int | None = None
) -> FramePlan:
    """The plan at the level asked for, or at the finest useful one that fits.

    Args:
        request: what is asked for.
        limits: what the plan keeps to.
        cull: whether bricks are left out.
        finest: the finest useful level, where it is known.

    Raises:
        PictureTooLargeError: not even a thin slab of the view fits.
    """
    nlevels = len(request.volume.levels)
    if finest is None:
        finest = finest_useful_level(request.volume, request.camera, request.size)
    levels = [request.level] if request.level is not None else range(finest, nlevels)
    too_large = None
    for level in levels:
        # Coarser, so that the working set stays resident; but the coarsest is shown anyhow.
        anyhow = request.level is not None or level == nlevels - 1
        bricks_max = None if anyhow else limits.brick_nbytes // needed_brick_nbytes(request, level)
        try:
            plan = plan_level(request, level, limits, cull=cull, bricks_max=bricks_max)
        except PictureTooLargeError as error:
            too_large = error
            continue
        if plan is not None:
            return plan
    assert too_large is not None
    raise too_large


def working_set_nbytes(request: RenderRequest, plan: FramePlan) -> int:
    """Bytes of the bricks that the plan needs, compressed, of all channels, with directions."""
    return plan.selection.nneeded * needed_brick_nbytes(request, plan.level)


def needed_brick_nbytes(request: RenderRequest, level: int) -> int:
    """Bytes of a brick, compressed, of all channels, with directions where they give light."""
    nbytes = brick_nbytes(request.volume, level)
    if request.stored_gradients(level) is not None:
        nbytes += 3 * math.prod(request.volume.brick_shape_zyx)
    return nbytes * len(request.channels)


STORED_TO_CODE = 1.5
"""What the entropy layer takes off codes with a width per block, and off zerobit's, at most."""


def brick_nbytes(volume: BrickSource, level: int) -> int:
    """Bytes of a compressed brick; where each has its own number, about the mean."""
    layout = CodeLayout.of(volume, level)
    stored_nbytes: int | None = getattr(volume.levels[level], "stored_nbytes", None)
    if layout.has_one_size or stored_nbytes is None:
        return layout.code_nbytes
    mean = STORED_TO_CODE * stored_nbytes / math.prod(volume.levels[level].grid_zyx)
    return min(layout.code_nbytes, math.ceil(mean / (volume.nt * volume.nc)))


def plan_level(
    request: RenderRequest,
    level: int,
    limits: Limits,
    *,
    cull: bool = True,
    bricks_max: int | None = None,
) -> FramePlan | None:
    """The plan at one level; None where it needs more bricks than a number, if that is given.

    Raises:
        PictureTooLargeError: not even a thin slab of the view fits.
    """
    volume, geometry = request.volume, request.volume.levels[level]
    step_world = request.step_voxels * min(geometry.spacing_xyz)
    scale = ValueScale.of(volume.dtype, volume.value_range)
    classifiers = tuple(
        Classifier(
            channel.function,
            scale,
            channel.window,
            step_world / _reference_length(request, channel.function),
            request.mode,
        )
        for channel in request.channels
    )
    view = make_view(request.camera, request.size, geometry)
    layout = SlabLayout.of(request, level)
    selection = select_within(
        math.prod(geometry.grid_zyx) if bricks_max is None else bricks_max,
        geometry,
        volume.brick_shape_zyx,
        view,
        _range_tests(request, level, classifiers),
        clip_planes_world=_clip_planes(request),
        margin_zyx=layout.brick_margin_zyx,
        cull=cull,
    )
    if selection is None or (bricks_max is not None and selection.nneeded > bricks_max):
        return None
    slabs = None
    if selection.box.nvoxels > 0 and limits.slab_nbytes is not None:
        slabs = _plan_slabs(request, level, view, selection, layout, limits)
    reference = _reference_length(request, request.channels[0].function)
    return FramePlan(level, view, classifiers, selection, layout, slabs, step_world, reference)


def _reference_length(request: RenderRequest, function: TransferFunction) -> float:
    finest = request.volume.levels[0]
    return function.reference_length_world(finest.spacing_xyz, finest.shape_zyx)


def _range_tests(
    request: RenderRequest, level: int, classifiers: tuple[Classifier, ...]
) -> list[tuple[BrickRanges, RangeTest]]:
    volume, t, deblocked = request.volume, request.t, request.deblocking is not None
    channels = [channel.c for channel in request.channels]
    if request.rgb:
        tree = luminance_ranges(volume, level, t, channels, LUMINANCE, deblocked=deblocked)
        return [(tree, classifiers[0].visible)]
    trees = [brick_ranges(volume, level, t, c, deblocked=deblocked) for c in channels]
    return [(tree, c.visible) for tree, c in zip(trees, classifiers, strict=True)]


def _clip_planes(request: RenderRequest) -> NDArray[np.float64]:
    """Outside of which nothing is shown; a slice is what two half-spaces have in common."""
    planes = request.clip.planes_world()
    if isinstance(request.mode, Slice):
        plane = request.mode.plane_world()
        planes = np.concatenate([planes, [plane, -plane]])
    return planes


def _plan_slabs(
    request: RenderRequest,
    level: int,
    view: View,
    selection: Selection,
    layout: SlabLayout,
    limits: Limits,
) -> SlabPlan:
    geometry, slab_nbytes = request.volume.levels[level], limits.slab_nbytes
    assert slab_nbytes is not None
    plan = plan_slabs(
        selection.box,
        geometry.shape_zyx,
        request.volume.brick_shape_zyx,
        2 - view.main_axis,
        _eye_on_axis(view, geometry),
        margin=layout.sample_margin,
        fits=lambda side_zyx: layout.nbytes(side_zyx) <= slab_nbytes,
        side_max=limits.volume_side_max,
    )
    if plan is None:
        raise PictureTooLargeError(
            f"level {level} of this view is {selection.box.shape_zyx} voxels (z, y, x), of "
            f"which not even a thin slab fits {slab_nbytes} bytes and "
            f"{limits.volume_side_max} voxels a side; raise memory_budget, show a "
            "coarser level, or move closer",
            level=level,
            box_zyx=list(selection.box.shape_zyx),
            slab_nbytes=slab_nbytes,
        )
    return plan


def _eye_on_axis(view: View, geometry: SourceLevel) -> float:
    """The eye's position on the main axis in voxel space; ±inf for parallel rays."""
    axis_xyz = view.main_axis
    if not view.eye_world_is_point:
        return -math.copysign(math.inf, view.forward_world[axis_xyz])
    origin, spacing = geometry.origin_xyz[axis_xyz], geometry.spacing_xyz[axis_xyz]
    return float((view.eye_world[axis_xyz] - origin) / spacing + 0.5)


def brick_list(mask: NDArray[np.bool_], box_slices: tuple[slice, ...]) -> list[Zyx]:
    """The bricks (z, y, x) of a mask within a part of it."""
    start = [part.start or 0 for part in box_slices]
    found = np.argwhere(mask[box_slices]) + start
    return [(z, y, x) for z, y, x in found.tolist()]
