"""A finished picture: pixels, what is known of their truth, and what they cost."""

from __future__ import annotations

import io
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import InvalidInputError, ResourceError

Background = tuple[float, float, float] | None


@dataclass(frozen=True, slots=True)
class Fidelity:
    """How true a picture is to the data.

    Attributes:
        level: that was shown.
        finest_level_wanted: the one that has a voxel for every pixel.
        max_error: largest difference between a decoded voxel and that level's own, in values, over
            the bricks that were sampled.
        converged: True if no more detail is to be had by waiting or by a larger budget.
    """

    level: int
    finest_level_wanted: int
    max_error: float
    converged: bool

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready fields."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class RenderStats:
    """What a picture cost.

    Attributes:
        level: that was shown.
        bricks: of the level, by what became of them: "total" is the sum of "frustum" (out of
            view), "clipped", "transparent", "occluded" (behind what is opaque) and "sampled";
            "decoded" counts the sampled and their neighbours, once for each slab and channel that
            they are in; "absent" those that had no bytes; "substituted" those shown by coarser
            ones.
        slabs: decoded and ray-cast; fewer than planned where all rays ended early.
        slabs_planned: into which the view was cut.
        uploaded_nbytes: compressed bytes sent to the GPU for this picture.
        resident_nbytes: compressed bytes on the GPU after it.
        decoded_nbytes: voxels decoded for this picture; 0 if the slab still held them.
        slab_nbytes: size of the slab buffer.
        step_world: distance between samples, in world units.
        reference_length_world: length that the transfer function's opacities are meant for.
        window: values at relative positions 0 and 1.
        milliseconds: by pass; "total" is the time of the whole call.
        gl_renderer: the driver's name of the device.
    """

    level: int
    bricks: dict[str, int]
    slabs: int
    slabs_planned: int
    uploaded_nbytes: int
    resident_nbytes: int
    decoded_nbytes: int
    slab_nbytes: int
    step_world: float
    reference_length_world: float
    window: tuple[float, float]
    milliseconds: dict[str, float]
    gl_renderer: str

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready fields."""
        return asdict(self) | {"window": list(self.window)}


@dataclass(frozen=True, slots=True)
class RenderedImage:
    """A picture. Rows from the top.

    Attributes:
        rgba: (height, width, 4) uint8, straight alpha; opaque where there is a background.
        premultiplied: (height, width, 4) float32, what the rays gathered, without the background.
        fidelity: how true it is.
        stats: what it cost.
        depth: (height, width) float32, world distance from the eye's plane to where the ray's
            opacity passes one half, or to what a projection or slice shows; inf where nothing is.
            None where it was not asked for.
    """

    rgba: NDArray[np.uint8]
    premultiplied: NDArray[np.float32]
    fidelity: Fidelity
    stats: RenderStats
    depth: NDArray[np.float32] | None = None

    def png(self) -> bytes:
        """The picture as PNG: RGBA, or RGB where every pixel is opaque.

        Raises:
            ResourceError: Pillow is not installed.
        """
        try:
            from PIL import Image
        except ImportError as error:
            raise ResourceError(
                "writing PNG needs Pillow, which is not installed: pip install 'octobrick[render]'",
                package="pillow",
            ) from error
        opaque = bool((self.rgba[..., 3] == 255).all())
        buffer = io.BytesIO()
        Image.fromarray(self.rgba[..., :3] if opaque else self.rgba).save(buffer, format="PNG")
        return buffer.getvalue()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the picture to a file whose name ends in .png.

        Raises:
            InvalidInputError: the name ends otherwise.
        """
        path = Path(path)
        if path.suffix.lower() != ".png":
            raise InvalidInputError(
                f"{path}: pictures are written as PNG only; choose a name that ends in .png",
                path=str(path),
            )
        path.write_bytes(self.png())


def checked_background(background: Sequence[float] | None) -> Background:
    """Three components 0..1, or None for transparent.

    Raises:
        InvalidInputError: anything else.
    """
    if background is None:
        return None
    try:
        red, green, blue = (float(component) for component in background)
    except (TypeError, ValueError):
        red = green = blue = -1.0
    if not all(0 <= component <= 1 for component in (red, green, blue)):
        raise InvalidInputError(
            f"background {background!r} must be three numbers 0..1 (red, green, blue), or None for "
            "transparent"
        )
    return (red, green, blue)
