"""Where the frames of a movie go: into one file, or into files of their own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from octobrick.codec.errors import InvalidInputError
from octobrick.server.cli.frame_files import FrameFiles
from octobrick.server.cli.view_options import require_folder, require_no_annotations

if TYPE_CHECKING:
    from octobrick.renderer import RenderedImage
    from octobrick.server.views.view import View


@dataclass(frozen=True, slots=True)
class Writing:
    """How frames are written."""

    fps: float
    quality: int | None
    resume: bool
    overwrite: bool


class MovieOutput:
    """Where frames go: a movie file, or files of their own."""

    def __init__(self, out: Path, how: Writing, files: FrameFiles | None) -> None:
        self._out, self._how, self._files = out, how, files

    @contextmanager
    def opened(self, shown: dict[str, Any]) -> Iterator[Callable[[int, RenderedImage], None]]:
        """What writes a frame at an index, until the block ends."""
        if self._files is None:
            from octobrick.renderer.movie_files import movie_file

            how = self._how
            with movie_file(
                self._out, fps=how.fps, quality=how.quality, overwrite=how.overwrite
            ) as add:
                yield lambda _index, image: add(image)
        else:
            files, quality = self._files, self._how.quality
            files.begin(shown, resume=self._how.resume, overwrite=self._how.overwrite)
            yield lambda index, image: image.save(files.path(index), quality=quality)

    def has(self, index: int) -> bool:
        """Whether a frame need not be made."""
        return self._files is not None and self._files.path(index).exists()

    def nbytes(self, nframes: int) -> int:
        """The size of all that was written."""
        if self._files is None:
            return self._out.stat().st_size
        return sum(self._files.path(index).stat().st_size for index in range(nframes))


def movie_output(out: Path, view: View, how: Writing) -> MovieOutput:
    """The output that a name asks for, checked before the work.

    Raises:
        InvalidInputError: a name that says neither, or what its kind of file cannot hold.
        NotFoundError: its folder is missing.
        ResourceError: the package that writes it is not installed.
    """
    from octobrick.renderer.movie_files import is_movie, require_movie
    from octobrick.renderer.picture_files import holds_floats, is_picture, require_picture

    transparent = view.background is None
    if "%" not in out.name and is_movie(out) and not out.is_dir():
        require_folder(out)
        require_movie(out, how.fps, how.quality, transparent=transparent)
        if how.resume:
            raise click.UsageError("--resume keeps frames in a folder; a movie file has none.")
        return MovieOutput(out, how, None)
    if "%" not in out.name and (is_picture(out) or out.suffix) and not out.is_dir():
        raise InvalidInputError(
            f"{out}: is neither a movie (.mp4, .webm, .webp, .gif), nor a folder, nor a pattern of "
            "frames with a number such as frame_%04d.png; choose one of them"
        )
    files = FrameFiles(out)
    require_folder(files.pattern if "%" in out.name else out)
    require_picture(files.pattern, how.quality, transparent=transparent)
    if holds_floats(files.pattern):
        require_no_annotations(view, files.pattern)
    return MovieOutput(out, how, files)
