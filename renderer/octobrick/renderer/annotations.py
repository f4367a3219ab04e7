"""What is written on a finished picture: a scale bar, and a legend of the transfer function.

Each stands on a dark plate of its own, so that its white text is readable on any picture. Only the
8-bit picture is drawn on; what the rays gathered stays as it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import InvalidInputError
from octobrick.renderer.camera import Camera
from octobrick.renderer.image import RenderedImage
from octobrick.renderer.picture_files import required
from octobrick.renderer.scale import SIDE_MIN, format_length, round_length, round_ticks
from octobrick.renderer.transfer_function import TransferFunction

_WHITE: Final = (255, 255, 255, 255)
_PLATE: Final = (0, 0, 0, 176)
"""White text on it has a contrast of 8 to 1 even where the picture is white."""
_CHECKERS: Final = (0.36, 0.64)
"""Grays under the legend's colours: neither black nor white, which functions often have."""
_TABLE: Final = 1024
EM_MIN: Final = 12
"""Pixels: below it the letters of the font run together."""


def with_scale_bar(image: RenderedImage, camera: Camera, unit: str | None = None) -> RenderedImage:
    """The picture with a bar of a round length in the bottom left corner.

    The bar is as long as what lies at the camera's target. In a perspective picture nearer things
    are larger, so its label says that it holds there.

    Args:
        image: a picture that the camera took.
        camera: where from.
        unit: of the world, by its UDUNITS name, as `octobrick.store.Volume` has it.

    Raises:
        InvalidInputError: the picture is too small to write on.
        ResourceError: Pillow is not installed.
    """
    sheet = _Sheet.of(image)
    width, height = image.size
    pixel_world = _height_world(camera) / min(width, height)
    length = round_length(pixel_world * width / 4)
    label = format_length(length, unit)
    if camera.fov_degrees is not None:
        label += " at the target"
    bar, (text_width, text_height) = round(length / pixel_world), sheet.measure(label)
    gap, tick = sheet.gap, max(3, sheet.em // 2)
    inner = (max(bar, text_width), text_height + gap + tick)
    left, top = sheet.plate(inner, right=False, bottom=True)

    def draw(pen: Any) -> None:
        pen.text((left, top), label, fill=_WHITE, font=sheet.font, anchor="la")
        bottom, line = top + inner[1], max(1, sheet.em // 8)
        pen.rectangle((left, bottom - line, left + bar - 1, bottom - 1), fill=_WHITE)
        for at in (left, left + bar - line):
            pen.rectangle((at, bottom - tick, at + line - 1, bottom - 1), fill=_WHITE)

    return replace(image, rgba=sheet.drawn(draw))


def with_legend(image: RenderedImage, transfer_function: TransferFunction) -> RenderedImage:
    """The picture with the colours of its values in the top right corner.

    A strip from the lowest to the highest value of the function, each in its colour and, by its
    opacity, over a checkerboard; under it the values at both ends and round ones between them.

    Args:
        image: a picture made with the function; its window is taken from there.
        transfer_function: what turned values into colours.

    Raises:
        InvalidInputError: the picture is too small to write on.
        ResourceError: Pillow is not installed.
    """
    sheet = _Sheet.of(image)
    low, high = transfer_function.value_domain(image.stats.window)
    length, thick = max(4 * sheet.em, round(image.size[0] * 0.3)), sheet.em
    strip = _strip(transfer_function, length, thick)
    tick = max(2, sheet.em // 4)
    ends = f"{low:g}", f"{high:g}"
    # The texts at the ends reach out of the strip by half of their width.
    margins = [sheet.measure(text)[0] // 2 for text in ends]
    text_height = sheet.measure("0")[1]
    inner = (length + sum(margins), thick + tick + sheet.gap + text_height)
    left, top = sheet.plate(inner, right=True, bottom=False)
    left += margins[0]

    def draw(pen: Any) -> None:
        below = top + thick
        for value, text in _spread(round_ticks(low, high), (low, high), length, sheet):
            at = left + round((value - low) / (high - low) * (length - 1))
            pen.line((at, below, at, below + tick), fill=_WHITE, width=max(1, sheet.em // 12))
            place = (at, below + tick + sheet.gap)
            pen.text(place, text, fill=_WHITE, font=sheet.font, anchor="ma")

    rgba = sheet.drawn(draw)
    rgba[top : top + thick, left : left + length] = strip
    return replace(image, rgba=rgba)


def _height_world(camera: Camera) -> float:
    """World units across the shorter side of the picture, at the target."""
    height = camera.orthographic().height_world
    assert height is not None
    return height


def _strip(function: TransferFunction, length: int, thick: int) -> NDArray[np.uint8]:
    """Colours by opacity over a checkerboard: (thick, length, 4)."""
    table = function.table(_TABLE)
    # The entries under a pixel are averaged: a narrow peak would fall between pixels otherwise.
    edges = np.linspace(0, _TABLE, length + 1)
    columns = np.stack(
        [
            table[int(start) : max(int(stop), int(start) + 1)].mean(axis=0)
            for start, stop in pairwise(edges)
        ]
    )
    side = max(2, thick // 3)
    y, x = np.ogrid[:thick, :length]
    under = np.where((y // side + x // side) % 2, *_CHECKERS)[..., None]
    color = columns[:, :3] + (1 - columns[:, 3:]) * under
    rgba = np.concatenate([color, np.ones_like(color[..., :1])], axis=-1)
    return np.asarray(np.rint(np.clip(rgba, 0, 1) * 255), np.uint8)


def _spread(
    ticks: list[float], ends: tuple[float, float], length: int, sheet: _Sheet
) -> list[tuple[float, str]]:
    """The ends, and of the ticks those whose texts stay clear of them, with their texts.

    None where they touch one another: some of them alone would look like an uneven scale.
    """
    low, high = ends

    def reach(value: float) -> tuple[float, float]:
        at = (value - low) / (high - low) * length
        half = (sheet.measure(f"{value:g}")[0] + sheet.gap) / 2
        return at - half, at + half

    def apart(left: float, right: float) -> bool:
        return reach(left)[1] <= reach(right)[0]

    crowded = not all(apart(*two) for two in pairwise(ticks))
    clear = [tick for tick in ticks if not crowded and apart(low, tick) and apart(tick, high)]
    return [(value, f"{value:g}") for value in (low, *clear, high)]


@dataclass(frozen=True, slots=True)
class _Sheet:
    """A picture to write on: its pixels and the sizes that follow from them.

    Attributes:
        rgba: (height, width, 4), not changed.
        font: Pillow's own, so that a picture is the same on every machine. ASCII only.
        em: the font's size in pixels.
        plates: corners (left, top, right, bottom) of what has to be darkened.
    """

    rgba: NDArray[np.uint8]
    font: Any
    em: int
    plates: list[tuple[int, int, int, int]]

    @classmethod
    def of(cls, image: RenderedImage) -> _Sheet:
        """A sheet whose text is as large as the picture bears.

        Raises:
            InvalidInputError: no text that can be read would fit.
        """
        if min(image.size) < SIDE_MIN:
            raise InvalidInputError(
                f"a picture of {image.size[0]}×{image.size[1]} pixels is too small to write on; "
                f"make both sides at least {SIDE_MIN}, or leave scale bar and legend out"
            )
        fonts = required("PIL.ImageFont", "Pillow", "writing on pictures", "render")
        em = max(EM_MIN, round(min(image.size) / 45))
        return cls(image.rgba, fonts.load_default(em), em, [])

    @property
    def gap(self) -> int:
        """Pixels between things."""
        return max(2, self.em // 4)

    def measure(self, text: str) -> tuple[int, int]:
        """Width and height of a text; the height is the same for all."""
        return math.ceil(self.font.getlength(text)), sum(self.font.getmetrics())

    def plate(self, inner: tuple[int, int], *, right: bool, bottom: bool) -> tuple[int, int]:
        """Put a plate for so many pixels into a corner; where they begin (left, top)."""
        height, width = self.rgba.shape[:2]
        margin, padding = self.em, max(3, self.em // 2)
        across, down = inner[0] + 2 * padding, inner[1] + 2 * padding
        left = width - margin - across if right else margin
        top = height - margin - down if bottom else margin
        # A label that is longer than a narrow picture is cut at the right, not at its number.
        left = max(0, left)
        self.plates.append((left, top, left + across - 1, top + down - 1))
        return left + padding, top + padding

    def drawn(self, draw: Callable[[Any], None]) -> NDArray[np.uint8]:
        """The pixels with plates and what is drawn over them: a new array."""
        images = required("PIL.Image", "Pillow", "writing on pictures", "render")
        pens = required("PIL.ImageDraw", "Pillow", "writing on pictures", "render")
        under = images.fromarray(self.rgba)
        over = images.new("RGBA", under.size)
        pen = pens.Draw(over)
        for plate in self.plates:
            pen.rounded_rectangle(plate, radius=self.em // 3, fill=_PLATE)
        draw(pen)
        return np.array(images.alpha_composite(under, over))
