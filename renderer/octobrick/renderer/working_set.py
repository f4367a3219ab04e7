"""Which bricks to fetch for a view, in which order: for clients, and for servers that tell them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from octobrick.renderer.brick_ranges import brick_errors
from octobrick.renderer.brick_source import BrickSource, SourceLevel
from octobrick.renderer.camera import Camera
from octobrick.renderer.frame_plan import Limits, plan_frame, working_set_nbytes
from octobrick.renderer.render_request import make_request
from octobrick.renderer.selection import finest_useful_level, ordered
from octobrick.renderer.transfer_function import TransferFunction
from octobrick.renderer.view import View
from octobrick.store.box import Zyx

MARGIN_WEIGHT: Final = 1 / 16
"""Of a brick of which only a margin is read: some voxels of 64."""


@dataclass(frozen=True, slots=True)
class WorkingSet:
    """The bricks that one view needs, at one level.

    Attributes:
        level: of the pyramid.
        t: time step.
        channels: of each of which all of the bricks are needed.
        directions: whether their stored gradients are needed too.
        finest_level_wanted: the one that has a voxel for every pixel.
        bricks_zyx: (n, 3) the bricks to fetch, in the order of their use: front to back. Those
            that the caller has are left out.
        pixels: (n,) of the picture that each brick covers about; of those that nothing but
            interpolation and filters reach into, a sixteenth. More is worth fetching sooner.
        counts: bricks of the level by what became of them: "total" is the sum of "frustum",
            "clipped", "transparent" and "sampled"; "needed" counts the sampled and the neighbours
            that interpolation and filters reach into, "had" those of them that the caller has.
        nbytes: of all that are needed, compressed, of all channels.
        max_error: largest error of the codec in the bricks that are sampled, in values.
    """

    level: int
    t: int
    channels: tuple[int, ...]
    directions: bool
    finest_level_wanted: int
    bricks_zyx: NDArray[np.intp]
    pixels: NDArray[np.float64]
    counts: dict[str, int]
    nbytes: int
    max_error: float


def select(
    volume: BrickSource,
    camera: Camera,
    size: tuple[int, int],
    transfer_function: TransferFunction,
    *,
    budget_nbytes: int = 512 << 20,
    have: Callable[[int, Zyx], bool] | None = None,
    **scene: Any,
) -> WorkingSet:
    """The bricks that a picture needs: a pure function of its arguments, without GL or I/O.

    The level is the finest that has a voxel for every pixel, or the first coarser one whose bricks
    fit the budget. Then bricks by frustum, clip planes and what their range of values can show.
    Leaving the others out changes no pixel; `Renderer.render` uses the same code.

    Args:
        volume: whose bricks; only its tables of ranges and errors are read.
        camera: where from.
        size: (width, height) in pixels.
        transfer_function: which colour and opacity a value has; or one for each channel.
        budget_nbytes: for compressed bricks.
        have: tells for (level, brick) whether the caller has it already.
        **scene: what else `Renderer.render` takes: mode, window, shading, clip, level, t, c …

    Raises:
        InvalidInputError: an argument is out of its range.
    """
    request = make_request(volume, camera, transfer_function, size, **scene)
    finest = finest_useful_level(volume, camera, request.size)
    plan = plan_frame(request, Limits(budget_nbytes), finest=finest)
    geometry = volume.levels[plan.level]
    selection = plan.selection
    needed = ordered(selection.needed, geometry, volume.brick_shape_zyx, plan.view, selection.part)
    wanted = needed
    if have is not None:
        places = needed.tolist()
        wanted = needed[[not have(plan.level, (z, y, x)) for z, y, x in places]]
    sampled = selection.sampled
    sampled_part = sampled[selection.part]
    pixels = pixels_covered(wanted, geometry, volume.brick_shape_zyx, plan.view)
    errors = [
        brick_errors(volume, plan.level, request.t, channel.c)[selection.part]
        for channel in request.channels
    ]
    return WorkingSet(
        level=plan.level,
        t=request.t,
        channels=tuple(channel.c for channel in request.channels),
        directions=plan.layout.directions,
        finest_level_wanted=finest,
        bricks_zyx=wanted,
        pixels=np.where(sampled[tuple(wanted.T)], pixels, pixels * MARGIN_WEIGHT),
        counts=selection.counts | {"needed": len(needed), "had": len(needed) - len(wanted)},
        nbytes=working_set_nbytes(request, plan),
        max_error=max((float(e[sampled_part].max(initial=0)) for e in errors), default=0.0),
    )


def pixels_covered(
    bricks_zyx: NDArray[np.intp], geometry: SourceLevel, brick_zyx: Zyx, view: View
) -> NDArray[np.float64]:
    """About how many pixels (n,) a face of each brick covers, no more than the picture has."""
    edges_world = np.multiply(brick_zyx[::-1], geometry.spacing_xyz)
    corner = np.array(geometry.origin_xyz) - np.array(geometry.spacing_xyz) / 2
    centres = corner + (bricks_zyx[:, ::-1] + 0.5) * edges_world
    base, slope = view.pixel_size
    # A brick around the eye is as near as its middle is from its border.
    depth = np.maximum(view.depth_world(centres), edges_world.min() / 2)
    face_world = float(np.prod(edges_world)) ** (2 / 3)
    width, height = view.size
    pixels = face_world / (base + slope * depth) ** 2
    return np.asarray(np.minimum(pixels, float(width) * height))
