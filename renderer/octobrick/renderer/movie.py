"""Movies as lists of shots, and the pictures that a renderer makes of them, one at a time.

A shot is a camera and a time step. Lists of shots are values: cut, join and reverse them freely.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from octobrick.codec.errors import InvalidInputError
from octobrick.renderer.brick_source import BrickSource, Xyz
from octobrick.renderer.camera import Camera
from octobrick.renderer.image import RenderedImage
from octobrick.renderer.renderer import Renderer
from octobrick.renderer.transfer_function import TransferFunction


@dataclass(frozen=True, slots=True)
class Shot:
    """What one frame of a movie shows.

    Args:
        camera: where from.
        t: time step.
    """

    camera: Camera
    t: int = 0


def turntable(camera: Camera, nframes: int, *, t: int = 0, degrees: float = 360.0) -> list[Shot]:
    """Shots that go around the camera's target, about the vertical line through it.

    The first is the camera's own. A whole turn is a seamless loop: the step from the last frame to
    the first is as large as all others, so no frame is there twice.

    Args:
        camera: where to begin.
        nframes: how many.
        t: time step of all.
        degrees: how far in all; positive moves towards +x when looking along +y, as azimuth does.

    Raises:
        InvalidInputError: no frames, or an angle that is not finite.
    """
    _require_frames(nframes)
    if not math.isfinite(degrees):
        raise InvalidInputError(f"turntable: degrees is {degrees}; choose a finite angle")
    return [Shot(_turned(camera, degrees * index / nframes), t) for index in range(nframes)]


def through_time(camera: Camera, times: Iterable[int]) -> list[Shot]:
    """Shots of one camera at time steps, in the order given."""
    return [Shot(camera, t) for t in times]


def render_frames(
    renderer: Renderer,
    volume: BrickSource,
    shots: Sequence[Shot],
    transfer_function: TransferFunction,
    size: tuple[int, int] = (768, 768),
    **options: Any,
) -> Iterator[RenderedImage]:
    """The pictures of shots, each rendered when it is asked for.

    Args:
        renderer: that makes them; bricks that neighbouring frames share are uploaded once.
        volume: what they are of.
        shots: from first to last.
        transfer_function: which colour and opacity a value has.
        size: (width, height) in pixels.
        options: any other of `Renderer.render`, but for camera and t.

    Raises:
        OctobrickError: as `Renderer.render`, at the frame that cannot be made.
    """
    for shot in shots:
        yield renderer.render(volume, shot.camera, transfer_function, size, t=shot.t, **options)


def _turned(camera: Camera, degrees: float) -> Camera:
    """The camera moved about the vertical line through its target."""
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))

    def turned(x: float, y: float, z: float) -> Xyz:
        return cos * x - sin * y, sin * x + cos * y, z

    target = camera.target_world_xyz
    dx, dy, dz = (e - c for e, c in zip(camera.eye_world_xyz, target, strict=True))
    x, y, z = turned(dx, dy, dz)
    return replace(
        camera,
        eye_world_xyz=(target[0] + x, target[1] + y, target[2] + z),
        up_world_xyz=turned(*camera.up_world_xyz),
    )


def _require_frames(nframes: int) -> None:
    if nframes < 1:
        raise InvalidInputError(f"movie: {nframes} frames; ask for at least 1", nframes=nframes)
