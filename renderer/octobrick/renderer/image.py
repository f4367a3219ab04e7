"""A finished picture: pixels, what is known of their truth, and what they cost."""

from __future__ import annotations

import base64
import html
import os
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import InvalidInputError
from octobrick.renderer.picture_files import png, save_picture

Background = tuple[float, float, float] | None


@dataclass(frozen=True, slots=True)
class Fidelity:
    """How true a picture is to the data.

    Attributes:
        level: that was shown.
        coarsest_level: that stands for bricks which are still to come; None where none is.
        finest_level_wanted: the one that has a voxel for every pixel.
        max_error: largest difference between a decoded voxel and that level's own, in values, over
            the bricks that were sampled.
        converged: True if no more detail is to be had by waiting or by a larger budget.
    """

    level: int
    finest_level_wanted: int
    max_error: float
    converged: bool
    coarsest_level: int | None = None

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


@dataclass(frozen=True, slots=True, repr=False)
class RenderedImage:
    """A picture. Rows from the top. In a notebook it shows itself, with what is known of it.

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

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        height, width = self.rgba.shape[:2]
        return width, height

    def png(self) -> bytes:
        """The picture as PNG: RGBA, or RGB where every pixel is opaque.

        Raises:
            ResourceError: Pillow is not installed.
        """
        return png(self.rgba)

    def save(self, path: str | os.PathLike[str], *, quality: int | None = None) -> None:
        """Write the picture to a file whose suffix says how; what is there is replaced.

        ``.png``, ``.webp`` and, where nothing is transparent, ``.jpg`` hold the finished picture;
        ``.exr`` and ``.npy`` what the rays gathered, in float32, premultiplied, and ``.exr`` the
        depth as channel Z where it is known. The file appears whole, or not at all.

        Args:
            path: the file.
            quality: 1 to 100, of ``.jpg`` (92 unless given) and ``.webp`` (lossless unless given).

        Raises:
            InvalidInputError: another suffix (the message lists these), a quality of what has
                none, or transparency in a JPEG.
            ResourceError: the package that writes it is missing; the message names the extra.
            DestinationError: the system refuses to write.
        """
        save_picture(self, path, quality)

    def __repr__(self) -> str:
        return f"<RenderedImage {self._caption()}>"

    def _repr_mimebundle_(
        self, include: Iterable[str] | None = None, exclude: Iterable[str] | None = None
    ) -> dict[str, Any]:
        """What Jupyter shows: the picture with a caption. PNG alone only where it asks for that."""
        wanted = {"text/plain", "text/html"} if include is None else set(include)
        bundle: dict[str, Any] = {}
        for kind, make in (
            ("text/plain", self.__repr__),
            ("text/html", self._html),
            ("image/png", lambda: base64.b64encode(self.png()).decode()),
        ):
            if kind in wanted and kind not in (exclude or ()):
                bundle[kind] = make()
        return bundle

    def _caption(self) -> str:
        fidelity, seconds = self.fidelity, self.stats.milliseconds.get("total", 0.0) / 1000
        level = f"level {fidelity.level}"
        if fidelity.level != fidelity.finest_level_wanted:
            level += f" instead of {fidelity.finest_level_wanted}"
        return ", ".join(
            (
                "×".join(map(str, self.size)),
                level,
                f"worst error {fidelity.max_error:g}",
                "converged" if fidelity.converged else "not converged",
                f"{seconds:.2f} s",
            )
        )

    def _html(self) -> str:
        width, height = self.size
        data, caption = base64.b64encode(self.png()).decode(), html.escape(self._caption())
        return (
            '<figure style="margin:0">'
            f'<img src="data:image/png;base64,{data}" width="{width}" height="{height}" '
            f'alt="{caption}" style="max-width:100%;height:auto">'
            f'<figcaption style="font-size:85%;opacity:.75">{caption}</figcaption></figure>'
        )


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
