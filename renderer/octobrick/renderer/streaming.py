"""Pictures while bricks arrive: coarse at once, finer later; and the steps of a time series."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from octobrick.codec.errors import InvalidInputError
from octobrick.renderer.brick_request import BrickAddress, BrickRequest
from octobrick.renderer.brick_source import BrickSource
from octobrick.renderer.camera import Camera
from octobrick.renderer.frame_plan import FramePlan
from octobrick.renderer.host_decoder import kind_of
from octobrick.renderer.render_request import RenderRequest
from octobrick.renderer.selection import ordered

if TYPE_CHECKING:
    from octobrick.renderer.image import RenderedImage
    from octobrick.renderer.renderer import Renderer
    from octobrick.renderer.transfer_function import TransferFunction

ARRIVAL_SECONDS = 0.02
"""How long a frame waits for the first brick to arrive before it is drawn again."""


def wanted_bricks(request: RenderRequest, plan: FramePlan) -> Iterator[BrickRequest]:
    """All bricks of a frame, in the order of their use: front to back, all channels of each."""
    volume, level = request.volume, plan.level
    gradients = request.stored_gradients(level)
    kind = kind_of(volume.level_codec(level))
    geometry = volume.levels[level]
    for z, y, x in ordered(
        plan.selection.needed, geometry, volume.brick_shape_zyx, plan.view
    ).tolist():
        for channel in request.channels:
            place = (level, request.t, channel.c, (z, y, x))
            yield BrickRequest(BrickAddress(volume.revision, kind, *place), volume)
            if gradients is not None:
                address = BrickAddress(volume.revision, "directions", *place)
                yield BrickRequest(address, gradients)


def continued(before: Camera, now: Camera) -> Camera | None:
    """Where a camera that moved goes next, if it goes on as it did; None where it stands still."""
    if before == now or (before.fov_degrees, before.height_world) != (
        now.fov_degrees,
        now.height_world,
    ):
        return None
    moved = {
        name: tuple(2 * np.array(getattr(now, name)) - np.array(getattr(before, name)))
        for name in ("eye_world_xyz", "target_world_xyz", "up_world_xyz")
    }
    try:
        return Camera(**moved, fov_degrees=now.fov_degrees, height_world=now.height_world)
    except InvalidInputError:  # the eye would meet its target
        return None


def frames(
    renderer: Renderer,
    volume: BrickSource,
    camera: Camera,
    transfer_function: TransferFunction | Sequence[TransferFunction],
    size: tuple[int, int] = (768, 768),
    **scene: Any,
) -> Iterator[RenderedImage]:
    """Pictures of one view, the first at once, each with more bricks, until it has converged.

    Args:
        renderer: that draws them.
        volume, camera, transfer_function, size: as `Renderer.render` takes them.
        **scene: what else it takes.
    """
    while True:
        image = renderer.render(volume, camera, transfer_function, size, wait=False, **scene)
        yield image
        if not image.stats.bricks["substituted"]:
            return
        renderer.wait_for_arrivals(ARRIVAL_SECONDS)


def play(
    renderer: Renderer,
    volume: BrickSource,
    camera: Camera,
    transfer_function: TransferFunction | Sequence[TransferFunction],
    size: tuple[int, int] = (768, 768),
    *,
    times: Sequence[int] | None = None,
    **scene: Any,
) -> Iterator[RenderedImage]:
    """A picture of each time step, in order; the next step is read while one is drawn.

    Every picture is complete: no step is skipped, and none shows bricks of another.

    Args:
        renderer: that draws them.
        volume, camera, transfer_function, size: as `Renderer.render` takes them.
        times: which steps; None for all.
        **scene: what else it takes.
    """
    steps = list(range(volume.nt)) if times is None else list(times)
    for i, t in enumerate(steps):
        if i + 1 < len(steps):
            renderer.prefetch(volume, camera, transfer_function, size, t=steps[i + 1], **scene)
        yield renderer.render(volume, camera, transfer_function, size, t=t, **scene)
