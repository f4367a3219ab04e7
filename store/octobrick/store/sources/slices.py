"""A folder or pattern of 2D pictures as the planes of one volume, decoded one file at a time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy.typing as npt

from octobrick.store.errors import SourceError, UnsupportedSourceError
from octobrick.store.sources.base import Description, Source
from octobrick.store.sources.pictures import Picture, decode, describe, probe
from octobrick.store.sources.planes import PlaneSource, Tile


def open_slices(path: Path, files: Sequence[Path], notes: tuple[str, ...] = ()) -> Source:
    """The volume whose plane z is the z-th picture.

    Args:
        path: the folder or pattern, as the name of the whole.
        files: the pictures, from z = 0 on.
        notes: warnings that were found on the way.

    Raises:
        SourceError: a picture is damaged, or differs from the first in size or type, with both.
        UnsupportedSourceError: a file that is no picture, or holds several.
    """
    first = probe(files[0])
    for file in files:
        require_alike(file, probe(file), files[0], first)
    ny, nx = first.shape_yx
    description = Description(
        f"{first.kind} slices",
        (len(files), ny, nx),
        first.dtype,
        first.spacing_zyx,
        first.unit,
        warnings=notes,
        nc=first.nc,
        channels=first.channels,
        chunk_zyx=(1, ny, nx),
    )
    return SliceSource(path, description, files, first)


def is_slice(file: Path) -> bool:
    """Whether the file of a picture holds one, and not a stack; raises what `probe` does."""
    return probe(file).nplanes == 1


class SliceSource(PlaneSource):
    """Pictures of one size and type, none of them held open."""

    def __init__(
        self, path: Path, description: Description, files: Sequence[Path], picture: Picture
    ) -> None:
        super().__init__(path, description, picture.nc)
        self._files = tuple(files)
        self._picture = picture

    @property
    def files(self) -> tuple[Path, ...]:
        """All pictures, in the order of z."""
        return self._files

    def _decode(self, tile: Tile) -> npt.NDArray[Any]:
        return decode(self._files[tile.z], self._picture)


def require_alike(file: Path, found: Picture, first_file: Path, first: Picture) -> None:
    """Refuse a picture that is not one, or of another size or type than the first.

    Raises:
        SourceError: with both.
        UnsupportedSourceError: a file of several pictures.
    """
    if found.nplanes != 1:
        raise UnsupportedSourceError(
            f"{file}: holds {found.nplanes} pictures; slices are files of one picture each; "
            "open the file on its own",
            path=str(file),
            pictures=found.nplanes,
        )
    if found[1:4] != first[1:4]:
        raise SourceError(
            f"{file}: is {describe(found)}, but {first_file.name} is "
            f"{describe(first)}; all must have the same size and type: convert or leave out the "
            "file",
            path=str(file),
            first=first_file.name,
            shape_yx=list(found.shape_yx),
            first_shape_yx=list(first.shape_yx),
        )
