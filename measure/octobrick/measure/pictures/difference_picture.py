"""How far two pictures are apart, in the S3Dc paper's colours.

The paper (section 5.1): blue below 5 % of error, green from 5 to 10 %, yellow or red above 15 %. It
does not say what a pixel's error is, and leaves 10 to 15 % without a colour. Here an error is the
greatest difference of red, green and blue, of 255; yellow begins at 10 %, and red is approached
from 15 %. Equal pixels are black.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import InvalidInputError

Rgb = tuple[int, int, int]
Pixels = NDArray[np.uint8]

_PEAK: Final = 255
_REDDEST: Final = 0.30
"""Share of 255 from which on the colour is plain red: twice where the paper calls errors large."""


@dataclass(frozen=True, slots=True)
class ErrorClass:
    """Errors that have one colour's name.

    Attributes:
        name: "5–10 %".
        low: share of 255 from which on errors belong here; the first class holds equal pixels only.
        first, last: colours of the least and of the greatest error, linear between them.
    """

    name: str
    low: float
    first: Rgb
    last: Rgb


CLASSES: Final = (
    ErrorClass("equal", 0.0, (0, 0, 0), (0, 0, 0)),
    ErrorClass("under 5 %", 0.5 / _PEAK, (10, 16, 90), (40, 90, 255)),
    ErrorClass("5–10 %", 0.05, (0, 140, 60), (60, 210, 90)),
    ErrorClass("10–15 %", 0.10, (255, 240, 80), (255, 215, 0)),
    ErrorClass("over 15 %", 0.15, (255, 160, 0), (230, 0, 0)),
)
"""Blue darkens towards nothing, so that rounding to 8 bits does not look like a loss."""


def difference_picture(a_rgb: Pixels, b_rgb: Pixels) -> Pixels:
    """What differs between two pictures, in the colours of `CLASSES`.

    Args:
        a_rgb: (h, w, 3) uint8.
        b_rgb: likewise, of the same size.

    Returns:
        (h, w, 3) uint8; black where they are equal.

    Raises:
        InvalidInputError: no such pictures, or of two sizes.
    """
    return error_colours()[pixel_errors(a_rgb, b_rgb)]


def pixel_errors(a_rgb: Pixels, b_rgb: Pixels) -> Pixels:
    """The greatest difference of a pixel's red, green and blue: (h, w) uint8.

    Raises:
        InvalidInputError: no such pictures, or of two sizes.
    """
    for pixels in (a_rgb, b_rgb):
        if pixels.ndim != 3 or pixels.shape[2] != 3 or pixels.dtype != np.uint8:
            raise InvalidInputError(
                f"a picture of shape {pixels.shape} and type {pixels.dtype} has no colours to "
                "compare; give (h, w, 3) uint8"
            )
    if a_rgb.shape != b_rgb.shape:
        raise InvalidInputError(
            f"pictures of shapes {a_rgb.shape} and {b_rgb.shape} cannot be compared; draw both in "
            "one size"
        )
    high, low = np.maximum(a_rgb, b_rgb), np.minimum(a_rgb, b_rgb)
    greatest: Pixels = (high - low).max(axis=2)
    return greatest


def error_colours() -> Pixels:
    """The colour of each error 0 to 255: (256, 3) uint8."""
    classes = error_classes()
    colours = np.empty((_PEAK + 1, 3), np.uint8)
    ends = np.minimum(np.append([c.low for c in CLASSES[1:]], _REDDEST) * _PEAK, _PEAK)
    for error, index in enumerate(classes.tolist()):
        kind = CLASSES[index]
        span = max(float(ends[index]) - kind.low * _PEAK, 1.0)
        along = np.clip((error - kind.low * _PEAK) / span, 0, 1)
        colours[error] = np.rint(np.array(kind.first) * (1 - along) + np.array(kind.last) * along)
    return colours


def error_classes() -> NDArray[np.intp]:
    """The place in `CLASSES` of each error 0 to 255."""
    lows = [kind.low * _PEAK for kind in CLASSES]
    return np.searchsorted(lows, np.arange(_PEAK + 1), side="right") - 1


def class_shares(errors: Pixels) -> tuple[float, ...]:
    """Which share of `pixel_errors` is in each of `CLASSES`; they add up to 1."""
    counts = np.bincount(error_classes()[errors].ravel(), minlength=len(CLASSES))
    return tuple(float(count) / max(errors.size, 1) for count in counts)


def difference_png(errors: Pixels) -> bytes:
    """Pixels' errors as a PNG of 256 colours, whose indices are the errors."""
    from PIL import Image

    picture = Image.fromarray(errors)
    picture.putpalette(error_colours().tobytes())
    stream = io.BytesIO()
    picture.save(stream, "PNG", optimize=True)
    return stream.getvalue()
