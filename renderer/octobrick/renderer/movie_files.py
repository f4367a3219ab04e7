"""Movie files: frames go in one by one, and the file appears when the last one is in.

``.mp4`` (H.264) and ``.webm`` (VP9) are made by FFmpeg's libraries through PyAV, a frame at a time;
``.webp`` and ``.gif`` by Pillow, which wants all frames in memory.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import InvalidInputError
from octobrick.renderer.image import RenderedImage
from octobrick.renderer.picture_files import is_opaque, pillow, required
from octobrick.store.staging import staged_file

QUALITY: Final = 75
"""Of 1 to 100, where nobody asks for another: no loss that is seen in motion."""
FPS_MAX: Final = 1000
GIF_FPS_MAX: Final = 50
"""A GIF counts hundredths of a second, and players slow down frames of less than two."""
HELD_NBYTES_MAX: Final = 1 << 30
"""Pixels of all frames that an animated .webp or .gif may hold in memory while it is made."""

Add = Callable[[RenderedImage], None]


def is_movie(path: str | os.PathLike[str]) -> bool:
    """Whether a name ends as a movie file's does."""
    return Path(path).suffix.lower() in _KINDS


def require_movie(
    path: str | os.PathLike[str],
    fps: float,
    quality: int | None = None,
    *,
    transparent: bool = False,
) -> None:
    """Refuse what `movie_file` could not write: before the work, not after it.

    Args:
        path: of the movie.
        fps: frames per second that will be asked for.
        quality: that will be asked for.
        transparent: whether the frames will have no background.

    Raises:
        InvalidInputError: no kind of movie has that suffix, or it has no such rate or quality or
            no transparency.
        ResourceError: the package that writes it is not installed; the message names the extra.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in _KINDS:
        raise InvalidInputError(
            f"{path}: no movie file ends in {path.suffix!r}; choose a name that ends in one of "
            f"{', '.join(_KINDS)}",
            path=str(path),
            suffixes=list(_KINDS),
        )
    fps_max = GIF_FPS_MAX if suffix == ".gif" else FPS_MAX
    if not 0 < fps <= fps_max:
        raise InvalidInputError(
            f"{path}: {fps} frames per second; choose a number above 0, up to {fps_max}",
            path=str(path),
        )
    if quality is not None and (suffix == ".gif" or not 1 <= quality <= 100):
        raise InvalidInputError(
            f"{path}: quality is {quality}; choose a whole number from 1 to 100, and none for .gif",
            path=str(path),
            quality=quality,
        )
    if transparent:
        _require_transparency(path)
    if suffix in _CODECS:
        _av(suffix)
    else:
        pillow()


@contextlib.contextmanager
def movie_file(
    path: str | os.PathLike[str],
    *,
    fps: float = 25.0,
    quality: int | None = None,
    overwrite: bool = False,
) -> Iterator[Add]:
    """A function that adds a frame to a movie; the file appears when the block ends well.

    If it does not, by an error or Ctrl-C, nothing is left. All frames have one size. Sides of
    ``.mp4`` and ``.webm`` are even: an odd one is made longer by a copy of its last pixels.

    Args:
        path: the file; its suffix is .mp4, .webm, .webp or .gif.
        fps: frames per second; up to 50 in a .gif.
        quality: 1 to 100; 75 unless given. None for .gif, which has 256 colours a frame.
        overwrite: replace a file that is there.

    Raises:
        InvalidInputError: see `require_movie`; frames that differ in size or, but for .webp, are
            transparent; no frames; an animation that is too large for memory.
        ResourceError: the package that writes it is not installed; the message names the extra.
        DestinationExistsError: there is such a file, and `overwrite` is not set.
        DestinationError: the system refuses to write.
    """
    require_movie(path, fps, quality)
    path = Path(path).absolute()
    kind = _KINDS[path.suffix.lower()]
    with (
        staged_file(path, overwrite=overwrite) as partial,
        contextlib.closing(kind(partial, fps, quality)) as writer,
    ):
        size: tuple[int, int] | None = None

        def add(image: RenderedImage) -> None:
            nonlocal size
            _require_fitting(image, path, size)
            size = image.size
            writer.add(image.rgba)

        yield add
        if size is None:
            raise InvalidInputError(f"{path}: a movie of no frames; give at least one")
        writer.finish()


def save_movie(
    frames: Iterable[RenderedImage],
    path: str | os.PathLike[str],
    *,
    fps: float = 25.0,
    quality: int | None = None,
    overwrite: bool = False,
) -> None:
    """Write frames to a movie file, taking them one at a time; arguments as for `movie_file`."""
    with movie_file(path, fps=fps, quality=quality, overwrite=overwrite) as add:
        for frame in frames:
            add(frame)


def _require_fitting(image: RenderedImage, path: Path, size: tuple[int, int] | None) -> None:
    """Refuse a frame that the movie cannot hold; `size` is that of the frames before it."""
    if size not in (None, image.size):
        raise InvalidInputError(
            f"{path}: a frame of {image.size} pixels after frames of {size}; make all of one size"
        )
    if not is_opaque(image.rgba):
        _require_transparency(path)


def _require_transparency(path: Path) -> None:
    if path.suffix.lower() != ".webp":
        raise InvalidInputError(
            f"{path}: {path.suffix} has no transparency; give the frames a background, or choose "
            ".webp"
        )


class _Writer(Protocol):
    """Makes one kind of file."""

    def add(self, rgba: NDArray[np.uint8]) -> None:
        """Take the next frame: (height, width, 4)."""

    def finish(self) -> None:
        """Write what is left, so that the file is whole."""

    def close(self) -> None:
        """Let go of the file, whole or not."""


@dataclass(frozen=True, slots=True)
class _Codec:
    """How FFmpeg makes one kind of file.

    Attributes:
        container: FFmpeg's name of the format.
        codec: FFmpeg's name of the encoder.
        crf: constant rate factors at qualities 0 and 100.
        options: of the encoder.
        container_options: of the format.
    """

    container: str
    codec: str
    crf: tuple[float, float]
    options: dict[str, str]
    container_options: dict[str, str]

    def options_at(self, quality: int) -> dict[str, str]:
        """The encoder's options at a quality of 1 to 100."""
        worst, best = self.crf
        return self.options | {"crf": str(round(worst + (best - worst) * quality / 100))}


_CODECS: Final = {
    # The index goes to the front, so that a browser can begin before it has all.
    ".mp4": _Codec("mp4", "libx264", (51, 6), {"preset": "medium"}, {"movflags": "+faststart"}),
    # A bit rate of 0: the quality alone counts.
    ".webm": _Codec("webm", "libvpx-vp9", (63, 13), {"b": "0", "row-mt": "1", "cpu-used": "4"}, {}),
}


class _Video:
    """H.264 or VP9, in 4:2:0 with BT.709 colours, which every player shows alike."""

    def __init__(self, path: Path, fps: float, quality: int | None) -> None:
        self._av = _av(path.suffix.lower())
        self._codec = _CODECS[path.suffix.lower()]
        self._options = self._codec.options_at(quality or QUALITY)
        self._fps = Fraction(fps).limit_denominator(10_000)
        self._file = self._av.open(
            str(path), "w", format=self._codec.container, options=self._codec.container_options
        )
        self._stream: Any = None

    def add(self, rgba: NDArray[np.uint8]) -> None:
        rgb = _even(rgba[..., :3])
        if self._stream is None:
            self._stream = self._make_stream(rgb.shape[1], rgb.shape[0])
        frame = self._av.VideoFrame.from_ndarray(rgb, format="rgb24").reformat(
            format="yuv420p", dst_colorspace="ITU709", dst_color_range="MPEG"
        )
        for packet in self._stream.encode(frame):
            self._file.mux(packet)

    def _make_stream(self, width: int, height: int) -> Any:
        stream = self._file.add_stream(self._codec.codec, rate=self._fps, options=self._options)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        context = stream.codec_context
        bt709, limited = 1, 1  # as ISO/IEC 23091-2 numbers them, and FFmpeg's AVCOL_RANGE_MPEG
        context.color_primaries = context.color_trc = context.colorspace = bt709
        context.color_range = limited
        return stream

    def finish(self) -> None:
        for packet in self._stream.encode(None):
            self._file.mux(packet)

    def close(self) -> None:
        self._file.close()


class _Animation:
    """Frames held by Pillow until the file is written in one go."""

    def __init__(self, path: Path, fps: float, quality: int | None) -> None:
        self._path, self._quality = path, quality or QUALITY
        self._is_gif = path.suffix.lower() == ".gif"
        self._fps = fps
        self._frames: list[Any] = []

    def add(self, rgba: NDArray[np.uint8]) -> None:
        channels = 1 if self._is_gif else 3 if is_opaque(rgba) else 4
        nbytes = (len(self._frames) + 1) * rgba.shape[0] * rgba.shape[1] * channels
        if nbytes > HELD_NBYTES_MAX:
            raise InvalidInputError(
                f"an animated {self._path.suffix} of more than {len(self._frames)} such frames "
                f"takes more than {HELD_NBYTES_MAX >> 20} MiB while it is made; make fewer or "
                "smaller frames, or choose .mp4 or .webm"
            )
        image = pillow().fromarray(np.ascontiguousarray(rgba[..., : max(channels, 3)]))
        self._frames.append(image.quantize(256) if self._is_gif else image)

    def finish(self) -> None:
        # Each frame ends at the tick nearest to its due time, so that rounding never adds up.
        tick = 10 if self._is_gif else 1
        ends = [round(1000 * n / self._fps / tick) * tick for n in range(len(self._frames) + 1)]
        options: dict[str, Any] = {"duration": np.diff(ends).tolist(), "loop": 0, "save_all": True}
        if not self._is_gif:
            options |= {"quality": self._quality, "method": 4}
        first, *rest = self._frames
        first.save(self._path, append_images=rest, **options)

    def close(self) -> None:
        self._frames.clear()


_KINDS: Final[dict[str, Callable[[Path, float, int | None], _Writer]]] = {
    ".mp4": _Video,
    ".webm": _Video,
    ".webp": _Animation,
    ".gif": _Animation,
}


def _even(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The picture with even sides, as 4:2:0 has one colour for 2×2 pixels."""
    height, width = rgb.shape[:2]
    return np.ascontiguousarray(np.pad(rgb, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge"))


def _av(suffix: str) -> Any:
    return required("av", "PyAV", f"writing {suffix}", "movie")
