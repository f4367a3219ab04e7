"""Which axis of a NRRD file is which: from its kinds, else from its space directions.

Source: https://teem.sourceforge.net/nrrd/format.html, fields ``kinds`` and ``space directions``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from octobrick.codec.errors import InvalidInputError
from octobrick.store.errors import UnsupportedSourceError
from octobrick.store.sources.head import printable

_COLOURS = ("rgb-color", "rgba-color", "3-color", "4-color")
_OPEN = ("", "???", "none", "domain", "space")
# Kinds whose samples belong to one voxel: vectors, lists, matrices and other colours.
_CHANNELS = (
    *("list", "point", "vector", "covariant-vector", "normal", "stub", "scalar", "complex"),
    *("2-vector", "3-gradient", "3-normal", "3-vector", "4-vector", "quaternion"),
    *("hsv-color", "xyz-color"),
    *("2d-symmetric-matrix", "2d-masked-symmetric-matrix", "2d-matrix", "2d-masked-matrix"),
    *("3d-symmetric-matrix", "3d-masked-symmetric-matrix", "3d-matrix", "3d-masked-matrix"),
)
_QUOTED_AXES = 8

_SPACE = "?"
_DROPPED = " "


def letters_of(
    sizes: Sequence[int],
    kinds: Sequence[Any] | None,
    directions: Sequence[Sequence[float]] | None,
    path: Path,
) -> str:
    """One letter for each axis, fastest first: x, y, z, t, c or s; a blank for one to be left out.

    What is left out has one sample.

    Args:
        sizes: samples along each axis.
        kinds: the field ``kinds``, if it is there.
        directions: a vector for each axis, NaN for one that is not of space; None without them.
        path: the file, for messages.

    Raises:
        InvalidInputError: the header leaves open which axis is which.
        UnsupportedSourceError: two axes of channels or of time.
    """
    letters = [
        _letter(axis, None if kinds is None else kinds[axis], directions)
        for axis in range(len(sizes))
    ]
    for letter in (_SPACE, "", "t", "s", "c"):  # of axes of one sample only what is needed
        wanted = {_SPACE: 3, "": 0}.get(letter, 1)
        for axis in reversed(range(len(sizes))):
            if sizes[axis] == 1 and letters[axis] == letter and letters.count(letter) > wanted:
                letters[axis] = _DROPPED
    if letters.count("") == 1 and letters[0] == "":
        letters[0] = "c"  # samples that lie beside each other belong to one voxel
    if letters.count(_SPACE) != 3 or "" in letters:
        raise _left_open(sizes, path)
    for letter, what in (("t", "time"), ("c", "channels"), ("s", "colours")):
        if letters.count(letter) > 1:
            raise UnsupportedSourceError(
                f"{path}: the header describes several axes of {what} "
                f"(sizes {list(sizes[:_QUOTED_AXES])}, fastest first); one is read; "
                "extract one and save it on its own",
                path=str(path),
                sizes=list(sizes[:_QUOTED_AXES]),
            )
    space = iter("xyz")
    return "".join(next(space) if letter == _SPACE else letter for letter in letters)


def _letter(axis: int, kind: Any, directions: Sequence[Sequence[float]] | None) -> str:
    """The letter of an axis; ``?`` for one of space, nothing where the header leaves it open."""
    name = str(kind or "").lower()
    if name == "time":
        return "t"
    if name in _COLOURS:
        return "s"
    if name in _CHANNELS:
        return "c"
    is_outside = directions is not None and math.isnan(directions[axis][0])
    return "" if is_outside or name not in _OPEN else _SPACE


def _left_open(sizes: Sequence[int], path: Path) -> InvalidInputError:
    found = printable(str(list(sizes[:_QUOTED_AXES])))
    return InvalidInputError(
        f"{path}: the header describes {len(sizes)} axes of {found} samples (fastest first) and "
        "leaves open which of them are space; name them, slowest first, such as --axes tzyx "
        "(t time, c channel, z, y, x, s samples of a colour), or zyxc for samples that lie "
        "beside each other",
        path=str(path),
        sizes=list(sizes[:_QUOTED_AXES]),
    )
