"""What OpenVDB and NanoVDB have in common: grids chosen by name, and where they lie."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from octobrick.codec.errors import InvalidInputError
from octobrick.store.errors import SourceError
from octobrick.store.sources.base import RGB, Channel, Direction, Vector
from octobrick.store.sources.head import printable
from octobrick.store.sources.voxels import clean_spacing, direction_of

# Names that are quoted in a message: scenes have tens, a hostile file thousands.
_QUOTED_GRIDS = 20

Xyz = tuple[int, int, int]


class Place(NamedTuple):
    """Where a grid lies: spacing (z, y, x), direction where axes are turned, first voxel."""

    spacing_zyx: Vector
    direction: Direction | None
    origin_xyz: Vector


def choose_grid(grids: Sequence[tuple[str, str]], name: str | None, path: Path) -> int:
    """Which grid of a file is meant.

    Args:
        grids: the name and the type of values of each.
        name: that of the one wanted; None for the only one.
        path: the file, for messages.

    Raises:
        SourceError: there is none.
        InvalidInputError: several and none named, or none of that name.
    """
    names = [grid for grid, _ in grids]
    if not names:
        raise SourceError(f"{path}: holds no grid; export the file again", path=str(path))
    if name is None and len(names) == 1:
        return 0
    if name in names:
        return names.index(name)
    listed = ", ".join(
        f"{printable(grid)} ({printable(kind)})" for grid, kind in grids[:_QUOTED_GRIDS]
    )
    found = "holds several grids" if name is None else f"holds no grid {printable(name)!r}"
    raise InvalidInputError(
        f"{path}: {found}; choose one by --dataset NAME: {listed}",
        path=str(path),
        grids=names[:_QUOTED_GRIDS],
    )


def no_active_voxel(name: str, path: Path) -> SourceError:
    """The error for a grid that holds nothing."""
    return SourceError(
        f"{path}: grid {printable(name)!r} has no active voxel; nothing is there to read",
        path=str(path),
        grid=name,
    )


def vector_channels(name: str) -> tuple[Channel, ...]:
    """The components of a vector: red, green and blue by the custom of the name, else x, y, z."""
    if name.lower() in ("cd", "color", "colour", "rgb", "albedo"):
        return RGB
    return tuple(Channel(axis) for axis in "xyz")


def place_of(
    axes: Sequence[Sequence[float]],
    translation: Sequence[float],
    start_xyz: Xyz,
    notes: list[str],
) -> Place:
    """Where the voxels of a grid lie, from an affine transform.

    Args:
        axes: row i is the step in the world along index axis i of (x, y, z).
        translation: where index (0, 0, 0) lies.
        start_xyz: the index of the first voxel.
        notes: takes a sentence for what has been put right.
    """
    matrix = np.array(axes, dtype=np.float64)
    with np.errstate(all="ignore"):
        spacing_zyx = clean_spacing([float(np.linalg.norm(axis)) for axis in matrix], notes)
        origin = np.array(start_xyz) @ matrix + np.array(translation)
    if not np.isfinite(origin).all():
        notes.append("the transform places the grid nowhere; origin 0 is used")
        origin = np.zeros(3)
    is_turned = not np.array_equal(matrix, np.abs(np.diag(np.diag(matrix))))
    direction = direction_of(matrix.tolist(), notes) if is_turned else None
    x, y, z = (float(at) for at in origin)
    return Place(spacing_zyx, direction, (x, y, z))


def finite_background(background: float, notes: list[str]) -> float:
    """A background that can be stored: 0 for one that is no number."""
    if np.isfinite(background):
        return background
    notes.append(f"the background is {background} in the grid; 0 is used where it is asked for")
    return 0.0
