"""The checked arguments of one picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, cast, get_args

import numpy as np

from octobrick.codec.errors import InvalidInputError
from octobrick.renderer.brick_source import BrickSource
from octobrick.renderer.camera import Camera
from octobrick.renderer.classifier import checked_window
from octobrick.renderer.clip import Clip
from octobrick.renderer.direct_bricks import SAMPLINGS
from octobrick.renderer.image import Background, checked_background
from octobrick.renderer.lighting import Lighting
from octobrick.renderer.modes import Isosurface, Mode, Projection, Slice, checked_mode
from octobrick.renderer.selection import checked_level
from octobrick.renderer.transfer_function import TransferFunction
from octobrick.renderer.view import Size, checked_size

STEP_VOXELS_MIN, STEP_VOXELS_MAX = 1 / 64, 16.0
"""Finer steps would take minutes for nothing; coarser ones miss whole blocks."""
CHANNELS_MAX: Final = 4
DEBLOCKING_STRENGTH: Final = 4.0
"""λ of `codec.deblock`, where it is switched on without a number."""

GradientSource = Literal["auto", "stored", "differences"]


@dataclass(frozen=True, slots=True)
class ChannelRequest:
    """One channel, and what its values look like."""

    c: int
    function: TransferFunction
    window: tuple[float, float]


@dataclass(frozen=True, slots=True)
class RenderRequest:
    """What is asked for; see `Renderer.render` for the meaning of each."""

    volume: BrickSource
    camera: Camera
    channels: tuple[ChannelRequest, ...]
    size: Size
    mode: Mode
    lighting: Lighting | None
    gradients: GradientSource
    edges: tuple[float, float] | None
    deblocking: float | None
    clip: Clip
    rgb: bool
    background: Background
    step_voxels: float
    level: int | None
    t: int
    depth: bool
    direct: str | None

    def stored_gradients(self, level: int) -> Any:
        """The volume's gradients where this picture is lit by them at a level; else None."""
        if self.lighting is None or self.gradients == "differences":
            return None
        if self.direct is not None:
            return None
        stored = getattr(self.volume, "gradients", None)
        return stored if stored is not None and level in stored.levels else None

    def sample_margin(self, level: int) -> int:
        """Voxels around the base of a sample that it reads: for interpolation and differences."""
        lit_by_differences = self.lighting is not None and self.stored_gradients(level) is None
        differences = lit_by_differences or self.edges is not None
        return 1 + differences + isinstance(self.mode, Isosurface)


def make_request(
    volume: BrickSource,
    camera: Camera,
    transfer_function: TransferFunction | Sequence[TransferFunction],
    size: tuple[int, int],
    *,
    mode: Mode | str = "dvr",
    window: Any = None,
    shading: bool | Lighting = True,
    gradients: str = "auto",
    edges: tuple[float, float] | None = None,
    deblocking: bool | float = False,
    clip: Clip | None = None,
    background: Sequence[float] | None = (0.0, 0.0, 0.0),
    step_voxels: float = 0.5,
    level: int | None = None,
    t: int = 0,
    c: int | Sequence[int] = 0,
    rgb: bool = False,
    depth: bool = False,
    direct: str | None = None,
    size_max: int | None = None,
) -> RenderRequest:
    """The arguments of `Renderer.render`, checked.

    Args:
        size_max: pixels along a side of a picture; for the others see there.

    Raises:
        InvalidInputError: an argument is out of its range, or two do not go together.
    """
    mode = checked_mode(mode)
    lit = bool(shading) and not isinstance(mode, Projection | Slice)
    request = RenderRequest(
        volume=volume,
        camera=camera,
        channels=checked_channels(volume, c, transfer_function, window),
        size=checked_size(size, size_max),
        mode=mode,
        lighting=(shading if isinstance(shading, Lighting) else Lighting()) if lit else None,
        gradients=checked_gradients(gradients),
        edges=checked_edges(edges),
        deblocking=checked_deblocking(deblocking),
        clip=clip or Clip(),
        rgb=rgb,
        background=checked_background(background),
        step_voxels=checked_step(step_voxels),
        level=checked_level(volume, level),
        t=checked_index("t", t, volume.nt),
        depth=depth,
        direct=direct,
    )
    return checked_combination(request)


def checked_channels(
    volume: BrickSource,
    c: int | Sequence[int],
    functions: TransferFunction | Sequence[TransferFunction],
    window: Any,
) -> tuple[ChannelRequest, ...]:
    """Channels with a transfer function and a window each.

    Args:
        volume: whose channels.
        c: one channel or up to four.
        functions: one for all, or as many as channels.
        window: one for all, one for each, or None for the volume's own.

    Raises:
        InvalidInputError: no such channel, or counts that do not fit.
    """
    indices = [c] if isinstance(c, (int, np.integer)) else list(c)
    if not 1 <= len(indices) <= CHANNELS_MAX or len(set(indices)) != len(indices):
        raise InvalidInputError(
            f"c {c!r}: give one channel, or up to {CHANNELS_MAX} different ones", option="c"
        )
    for index in indices:
        checked_index("c", index, volume.nc)
    all_functions = (
        [functions] * len(indices) if isinstance(functions, TransferFunction) else list(functions)
    )
    if len(all_functions) != len(indices):
        raise InvalidInputError(
            f"{len(all_functions)} transfer functions for {len(indices)} channels; give one for "
            "all, or one for each",
            option="transfer_function",
        )
    several = (
        isinstance(window, (list, tuple)) and bool(window) and isinstance(window[0], (list, tuple))
    )
    windows = list(window) if several else [window] * len(indices)
    if len(windows) != len(indices):
        raise InvalidInputError(
            f"{len(windows)} windows for {len(indices)} channels; give one for all or one for each",
            option="window",
        )
    return tuple(
        ChannelRequest(int(index), function, checked_window(own, volume.window))
        for index, function, own in zip(indices, all_functions, windows, strict=True)
    )


def checked_combination(request: RenderRequest) -> RenderRequest:
    """The request, if its parts can go together.

    Raises:
        InvalidInputError: naming the two that cannot.
    """
    nchannels = len(request.channels)
    if request.rgb and nchannels != 3:
        raise InvalidInputError(
            f"rgb needs three channels (red, green, blue), not {nchannels}; give c=(0, 1, 2)",
            option="rgb",
        )
    if isinstance(request.mode, Isosurface):
        if nchannels != 1:
            raise InvalidInputError(
                f"an isosurface is that of one channel, not of {nchannels}", option="c"
            )
        if request.step_voxels > 1:
            raise InvalidInputError(
                f"step_voxels {request.step_voxels}: an isosurface needs steps of at most 1 voxel",
                option="step_voxels",
            )
    if request.edges is not None and (request.rgb or request.mode.name != "dvr"):
        raise InvalidInputError(
            f"edges are drawn in mode dvr and without rgb only, not in {request.mode.name}",
            option="edges",
        )
    if request.direct is not None:
        _require_direct(request)
    if request.gradients == "stored":
        stored = getattr(request.volume, "gradients", None)
        if stored is None or not stored.levels:
            raise InvalidInputError(
                "gradients='stored': the volume has none; ingest it with --gradients, or leave "
                "the choice to 'auto'",
                option="gradients",
            )
    return request


def _require_direct(request: RenderRequest) -> None:
    if request.direct not in SAMPLINGS:
        raise InvalidInputError(
            f"direct {request.direct!r}: choose one of {list(SAMPLINGS)}, or None for slabs",
            option="direct",
        )
    if len(request.channels) > 1 or request.deblocking is not None:
        raise InvalidInputError(
            "direct rendering is that of one channel without deblocking; leave out direct",
            option="direct",
        )


def checked_step(step_voxels: float) -> float:
    """Distance of samples in voxels.

    Raises:
        InvalidInputError: out of range.
    """
    if not STEP_VOXELS_MIN <= step_voxels <= STEP_VOXELS_MAX:
        raise InvalidInputError(
            f"step_voxels {step_voxels} must be between {STEP_VOXELS_MIN} and {STEP_VOXELS_MAX}",
            option="step_voxels",
        )
    return float(step_voxels)


def checked_index(name: str, index: int, count: int) -> int:
    """An index below a count.

    Raises:
        InvalidInputError: it is not.
    """
    whole = isinstance(index, (int, np.integer)) and not isinstance(index, bool)
    if not (whole and 0 <= index < count):
        raise InvalidInputError(f"{name} {index!r}: there are 0 to {count - 1}", option=name)
    return int(index)


def checked_deblocking(deblocking: bool | float) -> float | None:
    """The filter's strength, or None where it is off.

    Raises:
        InvalidInputError: no finite number.
    """
    if isinstance(deblocking, bool):
        return DEBLOCKING_STRENGTH if deblocking else None
    if not math.isfinite(deblocking):
        raise InvalidInputError(
            f"deblocking {deblocking}: give True, False, or a finite strength such as "
            f"{DEBLOCKING_STRENGTH:g}",
            option="deblocking",
        )
    return float(deblocking)


def checked_gradients(gradients: str) -> GradientSource:
    """Where gradients come from.

    Raises:
        InvalidInputError: another word.
    """
    if gradients not in get_args(GradientSource):
        raise InvalidInputError(
            f"gradients {gradients!r}: choose one of {list(get_args(GradientSource))}",
            option="gradients",
        )
    return cast("GradientSource", gradients)


def checked_edges(edges: tuple[float, float] | None) -> tuple[float, float] | None:
    """Magnitudes of gradients for opacity 0 and 1.

    Raises:
        InvalidInputError: not two ascending finite numbers from 0 up.
    """
    if edges is None:
        return None
    try:
        low, high = (float(edge) for edge in edges)
    except (TypeError, ValueError):
        low = high = math.nan
    if not 0 <= low < high < math.inf:
        raise InvalidInputError(
            f"edges {edges!r}: give two magnitudes from 0 up, the lower first", option="edges"
        )
    return low, high
