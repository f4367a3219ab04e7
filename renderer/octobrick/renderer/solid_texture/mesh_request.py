"""The checked arguments of one picture of a mesh in its solid texture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, get_args

import numpy as np

from octobrick.codec.errors import InvalidInputError
from octobrick.renderer.brick_source import BrickSource
from octobrick.renderer.camera import Camera, world_bounds
from octobrick.renderer.classifier import checked_window
from octobrick.renderer.image import Background, checked_background
from octobrick.renderer.lighting import Lighting
from octobrick.renderer.render_request import checked_index
from octobrick.renderer.selection import checked_level
from octobrick.renderer.transfer_function import TransferFunction
from octobrick.renderer.view import Size, checked_size
from octobrick.store.surface import Mesh, Placement
from octobrick.store.surface.placement import UpAxis

Sampling = Literal["nearest", "linear"]
_UINT8_WINDOW: Final = (0.0, 255.0)


@dataclass(frozen=True, slots=True)
class MeshRequest:
    """One picture of a mesh.

    Attributes:
        volume: the texture.
        mesh: what is drawn.
        placement: where it lies in the texture.
        camera: where from.
        size: columns and rows of the picture.
        sampling: of the texture.
        channels: three of red, green and blue; or one, coloured by the function.
        windows: values at 0 and 1 of each channel.
        function: of a single channel.
        lighting: None for the texture's own colours.
        background: None for transparent.
        level: None for the one that fits the picture.
        t: time step.
    """

    volume: BrickSource
    mesh: Mesh
    placement: Placement
    camera: Camera
    size: Size
    sampling: Sampling
    channels: tuple[int, ...]
    windows: tuple[tuple[float, float], ...]
    function: TransferFunction | None
    lighting: Lighting | None
    background: Background
    level: int | None
    t: int


def make_mesh_request(
    volume: BrickSource,
    mesh: Mesh,
    camera: Camera,
    size: tuple[int, int],
    *,
    placement: Placement | None,
    up: UpAxis,
    sampling: str,
    transfer_function: TransferFunction | None,
    window: Any,
    shading: bool | Lighting,
    background: Sequence[float] | None,
    level: int | None,
    t: int,
    c: int | Sequence[int] | None,
    size_max: int | None,
) -> MeshRequest:
    """The arguments of `Renderer.render_mesh`, checked.

    Raises:
        InvalidInputError: an argument is out of its range, or two do not go together.
    """
    if not isinstance(mesh, Mesh):
        raise InvalidInputError(f"mesh {mesh!r:.80}: give what read_mesh returns, or a Mesh")
    if sampling not in get_args(Sampling):
        raise InvalidInputError(
            f"sampling {sampling!r:.40}: choose one of {list(get_args(Sampling))}",
            option="sampling",
        )
    channels = _channels(volume, c, transfer_function)
    return MeshRequest(
        volume=volume,
        mesh=mesh,
        placement=placement_in(volume, mesh, placement, up),
        camera=camera,
        size=checked_size(size, size_max),
        sampling=sampling,  # type: ignore[arg-type]
        channels=channels,
        windows=_windows(volume, window, len(channels)),
        function=transfer_function,
        lighting=shading if isinstance(shading, Lighting) else Lighting() if shading else None,
        background=checked_background(background),
        level=checked_level(volume, level),
        t=checked_index("t", t, volume.nt),
    )


def placement_in(
    volume: BrickSource, mesh: Mesh, placement: Placement | None, up: UpAxis = "z"
) -> Placement:
    """Where a mesh lies: as told, else where the volume was made for one, else fitted into it."""
    if placement is not None:
        return placement
    surface = getattr(volume, "surface", None)
    if surface is not None:
        stored: Placement = surface.placement
        return stored
    return Placement.fitted(mesh, *world_bounds(volume), up)


def _channels(
    volume: BrickSource, c: int | Sequence[int] | None, function: TransferFunction | None
) -> tuple[int, ...]:
    if c is None:
        c = (0, 1, 2) if function is None else 0
        if function is None and volume.nc < 3:
            raise InvalidInputError(
                f"a texture needs three channels (red, green, blue), the volume has {volume.nc}; "
                "give a transfer_function that colours one",
                option="c",
            )
    indices = (c,) if isinstance(c, (int, np.integer)) else tuple(c)
    for index in indices:
        checked_index("c", index, volume.nc)
    wanted = 3 if function is None else 1
    if len(indices) != wanted:
        raise InvalidInputError(
            f"c {c!r}: a texture is three channels (red, green, blue), or one with a "
            "transfer_function",
            option="c",
        )
    return tuple(int(index) for index in indices)


def _windows(volume: BrickSource, window: Any, count: int) -> tuple[tuple[float, float], ...]:
    several = isinstance(window, (list, tuple)) and bool(window)
    several = several and isinstance(window[0], (list, tuple))
    windows = list(window) if several else [window] * count
    if len(windows) != count:
        raise InvalidInputError(
            f"{len(windows)} windows for {count} channels; give one for all or one for each",
            option="window",
        )
    # Bytes of a colour picture are the colours that are to be seen.
    is_colour = count == 3 and np.dtype(volume.dtype) == np.uint8
    default = _UINT8_WINDOW if is_colour else volume.window
    return tuple(checked_window(own, default) for own in windows)
