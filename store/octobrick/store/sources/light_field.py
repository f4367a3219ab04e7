"""A grid of pictures, the views of a light field, as the slices of one volume.

docs/spec/volume-format.md says in which order; `octobrick.store.camera_grid` holds the rule.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from octobrick.store.camera_grid import CameraGrid, CameraStep
from octobrick.store.errors import SourceError, UnsupportedSourceError
from octobrick.store.sources.base import RGB, Description
from octobrick.store.sources.pictures import Picture, describe, probe
from octobrick.store.sources.planes import Tile
from octobrick.store.sources.several import files_of, is_several, pictures_of
from octobrick.store.sources.slices import SliceSource, require_alike

_ROW_COLUMN = re.compile(r"([0-9]+)[^0-9]+([0-9]+)$")
_DTYPES = ("uint8", "uint16")
_NAMED = 3  # of the views that are missing, so that a message stays short


class Place(NamedTuple):
    """Where a view stands in its grid, by the numbers in its name."""

    row: int
    column: int


def open_light_field(path: Path, step: CameraStep) -> LightFieldSource:
    """The light field of a folder or pattern of pictures, one for each camera of a grid.

    Names end in the numbers of row and column, such as ``view_03_12.jpg``; they may begin at any
    number, and be every other one, say. Views are decoded one at a time, in the order of slices.

    Args:
        path: the folder or pattern.
        step: distance of the cameras.

    Raises:
        SourceNotFoundError: there is no file.
        SourceError: a view is missing, there twice, damaged, or unlike the first.
        UnsupportedSourceError: one file, a name without row and column, or pixels that are
            neither gray nor RGB of 8 or 16 bits.
    """
    if not is_several(path):
        raise UnsupportedSourceError(
            f"{path}: a light field is a folder, or a pattern in quotes, of pictures whose names "
            "end in ROW_COLUMN, such as view_03_12.jpg",
            path=str(path),
        )
    pictures, notes = pictures_of(path, files_of(path))
    if not pictures:
        raise UnsupportedSourceError(
            f"{path}: has no pictures (PNG, JPEG, TIFF) whose names end in ROW_COLUMN, such as "
            "view_03_12.jpg",
            path=str(path),
        )
    places = _places(path, pictures)
    rows, columns = (_evenly(set(numbers)) for numbers in zip(*places, strict=True))
    _require_grid(path, places, rows, columns)
    grid = CameraGrid(len(columns), len(rows), step)
    first_file = places[Place(rows[0], columns[0])]
    first = _require_colours(first_file)
    for file in pictures:
        require_alike(file, probe(file), first_file, first)
    return LightFieldSource(
        path,
        Description(
            f"light field of {grid.nu} × {grid.nv} {first.kind} views",
            (grid.nslices, *first.shape_yx),
            first.dtype,
            warnings=notes,
            nc=first.nc,
            channels=first.channels,
            chunk_zyx=(1, *first.shape_yx),
            light_field=grid,
        ),
        [places[Place(row, column)] for row in rows for column in columns],
        first,
    )


class LightFieldSource(SliceSource):
    """Views of one size and type, none of them held open.

    Args:
        path: the folder or pattern.
        description: with `light_field`.
        files: of all views, row after row.
        picture: what each of them is.
    """

    def _decode(self, tile: Tile) -> npt.NDArray[Any]:
        grid = self.light_field
        assert grid is not None
        u, v = grid.view_of(tile.z)
        return super()._decode(tile._replace(z=v * grid.nu + u))

    def describe(self) -> dict[str, Any]:
        """What is known of the volume, and of its cameras."""
        grid = self.light_field
        assert grid is not None
        return super().describe() | {
            "views_uv": [grid.nu, grid.nv],
            "camera_step_uv": list(grid.step.uv),
            "camera_unit": grid.step.unit,
        }


def _places(path: Path, pictures: Sequence[Path]) -> dict[Place, Path]:
    """The picture at each row and column."""
    places: dict[Place, Path] = {}
    for file in pictures:
        found = _ROW_COLUMN.search(file.stem)
        if found is None:
            raise UnsupportedSourceError(
                f"{file}: the name of a view ends in ROW_COLUMN, such as view_03_12{file.suffix}; "
                "rename it, or choose the views by a pattern",
                path=str(file),
            )
        place = Place(int(found[1]), int(found[2]))
        if place in places:
            raise SourceError(
                f"{path}: {file.name} and {places[place].name} are both of row {place.row}, "
                f"column {place.column}; choose the views by a pattern",
                path=str(path),
            )
        places[place] = file
    return places


def _evenly(numbers: set[int]) -> range:
    """The fewest numbers at one distance from each other that are all of these."""
    first, last = min(numbers), max(numbers)
    step = math.gcd(*(number - first for number in numbers)) or 1
    return range(first, last + 1, step)


def _require_grid(path: Path, places: dict[Place, Path], rows: range, columns: range) -> None:
    """All rows have all columns; what a name says costs no time, however great the number."""
    # Not by len(), which ends at 2^63.
    nrows, ncolumns = ((r[-1] - r[0]) // r.step + 1 for r in (rows, columns))
    nmissing = nrows * ncolumns - len(places)
    if nmissing:
        every = (Place(row, column) for row in rows for column in columns)
        missing = itertools.islice((p for p in every if p not in places), _NAMED)
        named = ", ".join(f"({row}, {column})" for row, column in missing)
        more = ", ..." if nmissing > _NAMED else ""
        raise SourceError(
            f"{path}: {len(places)} views of rows {rows[0]} to {rows[-1]} and columns "
            f"{columns[0]} to {columns[-1]}, of which {nmissing} are missing, by (row, column): "
            f"{named}{more}; add them, or choose a full grid by a pattern",
            path=str(path),
            missing=nmissing,
        )
    if len(places) < 2:
        raise SourceError(
            f"{path}: has one view, {next(iter(places.values())).name}; a light field needs "
            "neighbours, so give all of them",
            path=str(path),
        )


def _require_colours(file: Path) -> Picture:
    picture = probe(file)
    is_known = picture.channels in ((), RGB) and picture.nc in (1, len(RGB))
    if not is_known or picture.dtype not in [np.dtype(name) for name in _DTYPES]:
        raise UnsupportedSourceError(
            f"{file}: is {describe(picture)}; views are gray or RGB of 8 or 16 bits, without "
            "alpha: convert them",
            path=str(file),
        )
    return picture
