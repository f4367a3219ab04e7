"""Uncompressed flat voxels, by positioned reads.

Not by a memory map: pages of a map count as resident memory, up to the whole volume, and a file
that is cut short while mapped ends the process with SIGBUS instead of an error.
"""

from __future__ import annotations

import os
from pathlib import Path

from octobrick.store.errors import SourceError, TruncatedSourceError
from octobrick.store.sources.base import Description
from octobrick.store.sources.flat import FlatSource, Layout
from octobrick.store.sources.head import open_file, require_file


class RawSource(FlatSource):
    """A source whose voxels lie uncompressed in a file.

    Raises:
        TruncatedSourceError: the file is too short for the shape, with both byte counts.
        SourceNotFoundError: the file of the voxels does not exist.
    """

    def __init__(self, path: Path, description: Description, layout: Layout) -> None:
        super().__init__(path, description, layout)
        size = require_file(layout.path, named_by=None if layout.path == path else path)
        nbytes = layout.nbytes_of(description)
        end = layout.offset_nbytes + nbytes
        if size < end:
            raise _too_short(path, description, layout, nbytes, size)
        if size > end and description.format.startswith("raw"):
            self.warnings += (
                f"{size - end} bytes follow the last voxel; check shape, dtype and offset",
            )
        self._file = open_file(layout.path)

    def _read_at(self, position: int, into: memoryview) -> None:
        descriptor = self._file.fileno()
        while into:
            try:
                nbytes = os.preadv(descriptor, [into], position)
            except OSError as error:
                raise SourceError(
                    f"{self._layout.path}: reading {len(into)} bytes at byte {position} failed: "
                    f"{error.strerror}; check the disk",
                    path=str(self._layout.path),
                    position=position,
                ) from error
            if nbytes == 0:
                raise TruncatedSourceError(
                    f"{self._layout.path}: the file has been cut short since it was opened: "
                    f"it ends before byte {position + len(into)}; open it again",
                    path=str(self._layout.path),
                    expected_nbytes=position + len(into),
                )
            into = into[nbytes:]
            position += nbytes

    def _close(self) -> None:
        self._file.close()


def _too_short(
    path: Path, description: Description, layout: Layout, nbytes: int, size: int
) -> TruncatedSourceError:
    z, y, x = description.shape_zyx
    many = f", {description.nt} time steps, {description.nc} channels"
    many = many if description.nt * description.nc > 1 else ""
    have = max(0, size - layout.offset_nbytes)
    if description.format.startswith("raw"):
        advice = "check shape, dtype and offset"
    else:
        advice = "copy or export the file again, or correct the sizes in the header"
    named_by = "" if layout.path == path else f" named by {path}"
    return TruncatedSourceError(
        f"{layout.path}{named_by}: data end after {have} of {nbytes} bytes "
        f"({x} x {y} x {z} voxels (x, y, z){many} of {description.dtype.name} "
        f"from byte {layout.offset_nbytes}); {advice}",
        path=str(layout.path),
        expected_nbytes=nbytes,
        actual_nbytes=have,
    )
