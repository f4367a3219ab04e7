"""Which page of a TIFF file holds which plane: axes as its writer named them, or as asked for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from octobrick.codec.errors import InvalidInputError
from octobrick.store.errors import UnsupportedSourceError
from octobrick.store.sources.head import printable

_KNOWN = "tczyxs"


@dataclass(frozen=True, slots=True)
class Axes:
    """The pages of an image as planes.

    Attributes:
        leading: letter and length of each axis whose elements are pages, slowest first.
        shape_yx: pixels of a page.
        nsamples: samples of a pixel that are interleaved.
        nseparate: samples of a pixel that are stored as planes of one page.
    """

    leading: tuple[tuple[str, int], ...]
    shape_yx: tuple[int, int]
    nsamples: int
    nseparate: int

    @property
    def npages(self) -> int:
        """How many pages hold the image."""
        return math.prod(size for _, size in self.leading)

    @property
    def nt(self) -> int:
        """Time steps."""
        return self._size("t")

    @property
    def nz(self) -> int:
        """Planes of one time step and channel."""
        return self._size("z")

    @property
    def nc(self) -> int:
        """Channels: those that are pages, times the samples of a pixel."""
        return self._size("c") * self.ncolors

    @property
    def ncolors(self) -> int:
        """Samples of a pixel."""
        return self.nsamples * self.nseparate

    def _size(self, letter: str) -> int:
        return dict(self.leading).get(letter, 1)

    def page_of(self, t: int, group: int, z: int) -> tuple[int, int]:
        """The page of a plane, and which of its separate planes; ``group`` counts both."""
        c, separate = divmod(group, self.nseparate)
        at = {"t": t, "c": c, "z": z}
        index = 0
        for letter, size in self.leading:
            index = index * size + at[letter]
        return index, separate


def choose_series(all_series: Sequence[Any], dataset: str | None, path: Path) -> int:
    """The number of the image that is asked for, or of the only one.

    Raises:
        UnsupportedSourceError: there are several and none is asked for, or no such one.
    """
    if dataset is None and len(all_series) == 1:
        return 0
    listed = ", ".join(
        f"{i} ({printable(series.name) or 'unnamed'}: {series.axes} {series.shape})"
        for i, series in enumerate(all_series[:16])
    )
    if dataset is not None and dataset.isdecimal() and int(dataset) < len(all_series):
        return int(dataset)
    asked = "" if dataset is None else f"; there is no {printable(dataset)!r}"
    raise UnsupportedSourceError(
        f"{path}: holds {len(all_series)} images: {listed}{asked}; choose one by its number "
        "(--dataset 0)",
        path=str(path),
        images=len(all_series),
    )


def axes_of(series: Any, asked: str | None, path: Path) -> Axes:
    """The axes of a tifffile series.

    Args:
        series: what tifffile found.
        asked: letters of the axes that are longer than 1, where the caller names them.
        path: the file, for the message.

    Raises:
        UnsupportedSourceError: axes that are not read, or of which it is not known what they are.
        InvalidInputError: the letters that are asked for do not fit.
    """
    nseparate, depth, ny, nx, nsamples = (int(n) for n in series.keyframe.shaped)
    letters = series.get_axes(squeeze=False).replace("B", "S")
    sizes = [int(size) for size in series.get_shape(squeeze=False)]
    head, y, tail = letters.partition("Y")
    fits = (
        y
        and tail in ("X", "XS")
        and depth == 1
        and (sizes[len(head)], sizes[len(head) + 1]) == (ny, nx)
    )
    leading = [(a, n) for a, n in zip(head, sizes, strict=False) if n > 1]
    if fits and nseparate > 1:
        fits = bool(leading) and leading.pop() == ("S", nseparate)
    if not fits or any(letter == "S" for letter, _ in leading):
        raise UnsupportedSourceError(
            f"{path}: the axes are {printable(letters)} of {sizes}, and a page holds "
            f"{series.keyframe.shape}; pages must be planes (y, x) or (y, x, samples); "
            "export the image as such",
            path=str(path),
            axes=printable(letters),
        )
    names = _named([letter for letter, _ in leading], sizes, letters, path)
    if asked is not None:
        own = [*names, *(["s"] if nseparate > 1 else []), "y", "x", *("s" if nsamples > 1 else "")]
        names = _asked(asked, own, path)[: len(names)]
    elif "?" in names:
        raise _unclear(letters, sizes, path)
    pages = tuple(zip(names, (size for _, size in leading), strict=True))
    return Axes(pages, (ny, nx), nsamples, nseparate)


def _named(letters: list[str], sizes: list[int], all_letters: str, path: Path) -> list[str]:
    """t, c and z by their letters; one axis that has none of them is z; ``?`` if unclear."""
    names = [letter.lower() if letter in "TCZ" else "?" for letter in letters]
    if names.count("?") == 1 and "z" not in names:
        names[names.index("?")] = "z"
    known = [name for name in names if name != "?"]
    if len(set(known)) != len(known):
        raise _unclear(all_letters, sizes, path)
    return names


def _asked(asked: str, own: list[str], path: Path) -> list[str]:
    """The letters that a caller gives, if they can be those of this file."""
    letters = list(asked.lower())
    fixed = [name for name in own if name in "yxs"]
    fits = (
        len(letters) == len(own)
        and set(letters) <= set(_KNOWN)
        and len(set(letters)) == len(letters)
        and letters[len(own) - len(fixed) :] == fixed
        and not set(letters[: len(own) - len(fixed)]) & set("yxs")
    )
    if not fits:
        raise InvalidInputError(
            f"{path}: --axes {printable(asked)} does not fit; the file has {len(own)} axes longer "
            f"than 1, of which the last are {''.join(fixed)}; give one each of t, c, z for the "
            "others",
            path=str(path),
            axes=printable(asked),
        )
    return letters


def _unclear(letters: str, sizes: list[int], path: Path) -> UnsupportedSourceError:
    return UnsupportedSourceError(
        f"{path}: of the axes {printable(letters)} of {sizes} it is not clear which are time, "
        "channel and z; name those longer than 1, slowest first (--axes tzyx)",
        path=str(path),
        axes=printable(letters),
        sizes=sizes,
    )
