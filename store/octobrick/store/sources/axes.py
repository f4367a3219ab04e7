"""Which axis of an array is which: from letters such as ``"tczyx"`` to boxes of (z, y, x).

The letters are t (time), c (channel), z, y, x (space) and s (samples of one colour, which are
channels too). Any order is possible; an axis that is not there has length 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from octobrick.codec.errors import InvalidInputError
from octobrick.store.box import Box, Zyx
from octobrick.store.errors import SourceError, UnsupportedSourceError
from octobrick.store.sources.base import RGB, RGBA, Channel
from octobrick.store.sources.head import printable
from octobrick.store.sources.location import Location
from octobrick.store.sources.voxels import require_shape

LETTERS = "tczyxs"
_QUOTED_SIZES = 12


class Strides(NamedTuple):
    """The distance of neighbours along each axis, in samples; 0 where there is no such axis."""

    t: int
    c: int
    z: int
    y: int
    x: int


@dataclass(frozen=True, slots=True)
class Axes:
    """The axes of an array, in its own order, slowest first.

    Attributes:
        letters: one letter for each axis, none twice, x and y among them.
        sizes: the length of each axis, all positive.
    """

    letters: str
    sizes: tuple[int, ...]

    @property
    def shape_zyx(self) -> Zyx:
        """Voxels along z, y and x."""
        return (self._size("z"), self._size("y"), self._size("x"))

    @property
    def nt(self) -> int:
        """Time steps."""
        return self._size("t")

    @property
    def nc(self) -> int:
        """Channels, or samples of one colour."""
        return self._size(self._channel)

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Red, green, blue (and alpha) where an axis s has three (or four) samples; else none."""
        if self._channel == "s":
            return {3: RGB, 4: RGBA}.get(self.nc, ())
        return ()

    @property
    def is_zyx(self) -> bool:
        """Whether z, y and x follow each other as they do in a box."""
        return "".join(letter for letter in self.letters if letter in "zyx") == "zyx"

    def strides(self, *, fortran: bool = False) -> Strides:
        """Distances in samples when the array lies in memory without gaps.

        Args:
            fortran: whether the first axis varies fastest, not the last.
        """
        step, found = 1, dict.fromkeys("tczyx", 0)
        sized = list(zip(self.letters, self.sizes, strict=True))
        for letter, size in sized if fortran else reversed(sized):
            found["c" if letter == self._channel else letter] = step
            step *= size
        return Strides(**{letter: found[letter] for letter in "tczyx"})

    def index(self, box: Box, t: int, c: int | None) -> tuple[int | slice, ...]:
        """What selects a box from the array; channel None stands for all of them."""
        z, y, x = box.slices
        every: dict[str, int | slice] = {"z": z, "y": y, "x": x, "t": t, "c": 0, "s": 0}
        every[self._channel] = slice(None) if c is None else c
        return tuple(every[letter] for letter in self.letters)

    def to_zyx(self, part: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """What `index` has selected of one channel, as a view of (z, y, x)."""
        return self._ordered(part, "zyx")

    def to_czyx(self, part: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """What `index` has selected of all channels, as a view of (c, z, y, x)."""
        return self._ordered(part, self._channel + "zyx")

    def of_zyx(self, values: Sequence[Any], missing: Any) -> tuple[Any, Any, Any]:
        """Of one value for each axis those of z, y and x; ``missing`` for one that is not there."""
        given = dict(zip(self.letters, values, strict=True))
        return (given.get("z", missing), given["y"], given["x"])

    @property
    def _channel(self) -> str:
        """The letter of the axis of channels; c where there is none."""
        return "s" if "s" in self.letters and self._size("c") == 1 else "c"

    def _size(self, letter: str) -> int:
        at = self.letters.find(letter)
        return 1 if at < 0 else self.sizes[at]

    def _ordered(self, part: npt.NDArray[Any], wanted: str) -> npt.NDArray[Any]:
        kept = [letter for letter in self.letters if letter in wanted]
        ordered = part.transpose([kept.index(letter) for letter in wanted if letter in kept])
        return ordered[tuple(slice(None) if letter in kept else np.newaxis for letter in wanted)]


def axes_of(shape: Sequence[int], letters: str | None, path: Location) -> Axes:
    """The axes of an array of this shape: those that a caller names, else z, y, x for three.

    Raises:
        InvalidInputError: the letters are none, or not as many as axes; or none are given and
            there are not three axes.
        UnsupportedSourceError: fewer than two axes, or both several channels and several samples.
        SourceError: an axis has no elements.
    """
    sizes = tuple(int(size) for size in shape)
    if len(sizes) < 2:
        raise UnsupportedSourceError(
            f"{path}: the array has {len(sizes)} axes of {list(sizes)} elements; "
            "a volume has at least y and x; reshape it, or choose another array",
            path=str(path),
            sizes=list(sizes),
        )
    if letters is None and len(sizes) == 3:
        letters = "zyx"
    if letters is None:
        raise InvalidInputError(
            f"{path}: the array has {len(sizes)} axes of {list(sizes[:_QUOTED_SIZES])} elements, "
            "and nothing says what they are; name them, slowest first, such as --axes tzyx "
            "(t time, c channel, z, y, x, s samples of a colour), zyxs for colours, or "
            "yx for one plane",
            path=str(path),
            sizes=list(sizes[:_QUOTED_SIZES]),
        )
    _require_letters(letters, sizes, path)
    axes = Axes(letters, sizes)
    require_shape(axes.shape_zyx[::-1], path)
    given = dict(zip(letters, sizes, strict=True))
    if min(sizes) < 1:
        raise SourceError(
            f"{path}: the array has axes {letters} of {list(sizes)} elements; every axis needs at "
            "least 1; save the array again",
            path=str(path),
            sizes=list(sizes),
        )
    if given.get("c", 1) > 1 and given.get("s", 1) > 1:
        raise UnsupportedSourceError(
            f"{path}: the array has {given['c']} channels of {given['s']} samples each; one of "
            "both is read; save one channel on its own",
            path=str(path),
            sizes=list(sizes),
        )
    return axes


def _require_letters(letters: str, sizes: tuple[int, ...], path: Location) -> None:
    known = set(letters) <= set(LETTERS) and len(set(letters)) == len(letters)
    if known and {"x", "y"} <= set(letters) and len(letters) == len(sizes):
        return
    raise InvalidInputError(
        f"{path}: the axes are given as {printable(letters)!r} for an array of {len(sizes)} axes "
        f"of {list(sizes[:_QUOTED_SIZES])} elements; one letter of t, c, z, y, x, s for each "
        "is expected, none twice, x and y among them",
        path=str(path),
        axes=printable(letters),
        sizes=list(sizes[:_QUOTED_SIZES]),
    )
