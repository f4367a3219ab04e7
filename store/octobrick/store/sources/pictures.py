"""Single 2D pictures: what is in a PNG, JPEG or TIFF file, and its pixels."""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from octobrick.store.box import Box
from octobrick.store.errors import SourceError, TruncatedSourceError, UnsupportedSourceError
from octobrick.store.sources.base import RGB, RGBA, Channel, Vector
from octobrick.store.sources.head import (
    missing_package,
    open_file,
    parsing,
    printable,
    read_head,
    require_file,
)
from octobrick.store.sources.tiff import open_tiff
from octobrick.store.sources.tiff_chain import is_tiff

PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff")

_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8\xff"
# deflate reaches 1032 times, of 8 pixels a byte at most; a block of 64 takes a JPEG a few bits.
_RATIO_LIMIT = 1 << 14
_GRAY_ALPHA = (Channel("gray"), Channel("alpha"))
# By Pillow's mode: sample type, and the channels of a pixel where there are several.
_MODES: dict[str, tuple[str, tuple[Channel, ...]]] = {
    "1": ("bool", ()),
    "L": ("uint8", ()),
    "LA": ("uint8", _GRAY_ALPHA),
    "I;16": ("uint16", ()),
    "I;16B": ("uint16", ()),
    "I": ("uint16", ()),  # what older versions of Pillow make of 16-bit PNG
    "RGB": ("uint8", RGB),
    "RGBA": ("uint8", RGBA),
}
# By the colour type of a PNG file: channels of 16-bit pixels that Pillow would cut to 8.
_PNG_COLORS = {2: RGB, 4: _GRAY_ALPHA, 6: RGBA}


class Picture(NamedTuple):
    """What a picture is, before its pixels are decoded.

    Attributes:
        kind: ``"png"``, ``"jpeg"`` or ``"tiff"``.
        shape_yx: pixels.
        dtype: native-endian sample type.
        nc: samples of a pixel.
        channels: what they are, where that is known.
        spacing_zyx: 1 where the file does not say.
        unit: of the spacing.
        nplanes: pictures in the file: more than 1 only in TIFF.
    """

    kind: str
    shape_yx: tuple[int, int]
    dtype: np.dtype[Any]
    nc: int
    channels: tuple[Channel, ...]
    spacing_zyx: Vector = (1.0, 1.0, 1.0)
    unit: str | None = None
    nplanes: int = 1


def probe(path: Path) -> Picture:
    """What is in the file of a picture.

    Raises:
        SourceError: its header is damaged, or asks for more pixels than the file can hold.
        UnsupportedSourceError: it is no picture, or one of colours that are not read.
    """
    size = require_file(path)
    head = read_head(path, 32)
    if is_tiff(head):
        with open_tiff(path) as tiff:
            shape_yx = (tiff.shape_zyx[1], tiff.shape_zyx[2])
            nplanes = tiff.shape_zyx[0] * tiff.nt
            return Picture(
                "tiff",
                shape_yx,
                tiff.dtype,
                tiff.nc,
                tiff.channels,
                tiff.spacing_zyx,
                tiff.unit,
                nplanes,
            )
    with parsing(path, "picture"), _opened(path, head) as image:
        nx, ny = image.size
        if (deep := _deep_png_channels(head)) is not None:
            dtype, channels = "uint16", deep
        else:
            dtype, channels = _mode(image, path)
    found = Picture(
        "png" if head.startswith(_PNG) else "jpeg",
        (ny, nx),
        np.dtype(dtype),
        max(1, len(channels)),
        channels,
    )
    if min(nx, ny) < 1 or nx * ny * found.nc * found.dtype.itemsize > size * _RATIO_LIMIT:
        raise SourceError(
            f"{path}: the header gives {nx} x {ny} pixels (x, y), which a file of {size} bytes "
            "cannot hold; copy or export it again",
            path=str(path),
            nbytes=size,
        )
    return found


def decode(path: Path, expected: Picture) -> npt.NDArray[Any]:
    """The pixels of a picture, (y, x, samples).

    Args:
        path: the file.
        expected: what it was when it was looked at first.

    Raises:
        SourceError: its bytes are damaged, or it is another picture by now.
        TruncatedSourceError: it ends too early.
    """
    found = probe(path)
    if found.shape_yx != expected.shape_yx or found.dtype != expected.dtype:
        raise SourceError(
            f"{path}: is {describe(found)} now, and was {describe(expected)} when the source was "
            "opened; open it again",
            path=str(path),
        )
    if found.kind == "tiff":
        with open_tiff(path) as tiff:
            channels = tiff.read_channels(Box((0, 0, 0), (1, *found.shape_yx)))
            return np.ascontiguousarray(np.moveaxis(channels[:, 0], 0, -1))
    try:
        pixels = _pixels(path)
    except Exception as error:  # decoders of others promise nothing about hostile bytes
        reason = printable(str(error) or type(error).__name__)
        kind = TruncatedSourceError if "truncated" in reason else SourceError
        raise kind(
            f"{path}: the picture cannot be decoded: {reason}; copy or export it again",
            path=str(path),
            reason=reason,
        ) from error
    return pixels.reshape(*pixels.shape[:2], -1).astype(found.dtype, copy=False)


def describe(picture: Picture) -> str:
    """Size and type of a picture, for messages."""
    ny, nx = picture.shape_yx
    return f"{nx} x {ny} pixels (x, y) of {picture.nc} {picture.dtype}"


def _pixels(path: Path) -> npt.NDArray[Any]:
    head = read_head(path, 32)
    if _deep_png_channels(head) is not None:
        import imagecodecs

        pixels: npt.NDArray[Any] = imagecodecs.png_decode(path.read_bytes())
        return pixels
    with _opened(path, head) as image:
        if image.mode == "P":
            image = image.convert(_palette_mode(image))
        return np.asarray(image)


@contextmanager
def _opened(path: Path, head: bytes) -> Iterator[Any]:
    """A PNG or JPEG file by Pillow.

    Not by `Image.open`: it knows many formats that nobody wants guessed, and refuses pictures of
    more than 179 million pixels, as electron microscopes make them; `probe` compares the size with
    that of the file instead.
    """
    try:
        from PIL import JpegImagePlugin, PngImagePlugin
    except ImportError as error:
        raise missing_package("pillow", path) from error
    if head.startswith(_PNG):
        plugin: Any = PngImagePlugin.PngImageFile
    elif head.startswith(_JPEG):
        plugin = JpegImagePlugin.JpegImageFile
    else:
        raise UnsupportedSourceError(
            f"{path}: is neither PNG, JPEG nor TIFF, whatever its name; convert or rename it",
            path=str(path),
        )
    with io.BufferedReader(open_file(path)) as file, plugin(file) as image:
        yield image


def _mode(image: Any, path: Path) -> tuple[str, tuple[Channel, ...]]:
    mode = _palette_mode(image) if image.mode == "P" else image.mode
    if mode not in _MODES:
        raise UnsupportedSourceError(
            f"{path}: pixels are {printable(mode)}; gray, gray with alpha, RGB and RGBA are read; "
            "convert the picture",
            path=str(path),
            mode=printable(mode),
        )
    return _MODES[mode]


def _palette_mode(image: Any) -> str:
    """What the colours of a palette are turned into."""
    return "RGBA" if "transparency" in image.info else "RGB"


def _deep_png_channels(head: bytes) -> tuple[Channel, ...] | None:
    """The channels of a PNG of 16-bit colours, which Pillow would cut to 8 bits; else None."""
    if not head.startswith(_PNG) or len(head) < 26:
        return None
    depth, color = struct.unpack_from("BB", head, 24)
    return _PNG_COLORS.get(color) if depth == 16 else None
