"""TIFF, BigTIFF and OME-TIFF: stacks of pages, decoded tile by tile or strip by strip.

tifffile reads the directories and says which page holds which plane; the pixels are read from the
file here, by position, and decoded one segment at a time. Strips that are not compressed are read
by rows, so that a page in one strip costs no more memory than a box of it.
"""

from __future__ import annotations

import logging
import os
import threading
from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from octobrick.codec.errors import OctobrickError
from octobrick.store.errors import SourceError, TruncatedSourceError
from octobrick.store.sources.base import RGB, RGBA, Channel, Description, Pick, Source
from octobrick.store.sources.head import missing_package, open_file, parsing, printable
from octobrick.store.sources.jpeg_size import coded_npixels
from octobrick.store.sources.planes import PlaneSource, Tile
from octobrick.store.sources.tiff_axes import Axes, axes_of, choose_series
from octobrick.store.sources.tiff_chain import count_pages
from octobrick.store.sources.tiff_metadata import (
    TiffMetadata,
    of_imagej,
    of_ome,
    require_sane_ome,
)
from octobrick.store.sources.voxels import require_dtype, require_shape

# tifffile writes what it works around to a log that nobody asked for; errors come from here.
logging.getLogger("tifffile").addHandler(logging.NullHandler())

# Rows of an uncompressed strip that are read at once.
_ROWS_NBYTES = 1 << 18
# What one segment may decode to; its compressed size times the best ratio of any codec, at most.
_SEGMENT_LIMIT_NBYTES = 1 << 31
_RATIO_LIMIT = 1 << 16
_PAGES_KEPT = 64
_JPEGS = (6, 7, 33003, 33004, 33005, 34712, 34892)  # JPEG and JPEG 2000, by several names
_RGB_PHOTOMETRICS = (2, 6)  # RGB; YCbCr, which the JPEG decoder turns into RGB
_MINISWHITE = 0


class _Page(NamedTuple):
    """Where the segments of a page lie: file, offsets, sizes, and the tables of its JPEGs."""

    path: Path
    offsets: Sequence[int]
    nbytes: Sequence[int]
    jpegtables: bytes | None
    jpegheader: bytes | None


def open_tiff(path: Path, pick: Pick = Pick()) -> Source:  # noqa: B008  (immutable)
    """The stack of pages of a TIFF file; ``pick.dataset`` is the number of an image in it.

    Raises:
        SourceError: a directory is damaged; `TruncatedSourceError` if one or the last page ends
            too early.
        UnsupportedSourceError: several images of which none is picked, axes or samples not read.
    """
    try:
        import tifffile
    except ImportError as error:
        raise missing_package("tifffile", path) from error
    count_pages(path)
    with parsing(path, "TIFF"):
        file = tifffile.TiffFile(path)
    try:
        with parsing(path, "TIFF"):
            return _open(file, path, pick)
    except BaseException:
        file.close()
        raise


def _open(file: Any, path: Path, pick: Pick) -> Source:
    ome = file.ome_metadata if file.is_ome else None
    if ome:
        require_sane_ome(ome, path)
    number = choose_series(file.series, pick.dataset, path)
    series = file.series[number]
    keyframe = series.keyframe
    axes = axes_of(series, pick.axes, path)
    if ome:
        known = of_ome(ome, number)
    elif file.is_imagej and file.imagej_metadata:
        known = of_imagej(file.imagej_metadata, keyframe.get_resolution())
    else:
        known = TiffMetadata()
    if keyframe.photometric == _MINISWHITE:
        known.notes.append("white is stored as zero; samples are read as they are stored")
    dtype = require_dtype(np.dtype(series.dtype), path)
    _require_codec(keyframe, path)
    by_rows = _is_plain(keyframe)
    ny, nx = axes.shape_yx
    if by_rows:
        row_nbytes = nx * axes.nsamples * dtype.itemsize
        tile_yx = (max(1, min(ny, _ROWS_NBYTES // max(1, row_nbytes))), nx)
    elif keyframe.is_tiled:
        tile_yx = (keyframe.tilelength, keyframe.tilewidth)
    else:
        tile_yx = (min(keyframe.rowsperstrip, ny), nx)
    _, tile_ny, tile_nx = require_shape((*tile_yx[::-1], 1), path)
    description = Description(
        _name(file),
        require_shape((nx, ny, axes.nz), path),
        dtype,
        known.spacing_zyx,
        known.unit,
        warnings=tuple(known.notes),
        nt=axes.nt,
        nc=axes.nc,
        channels=_channels(keyframe, axes, known),
        chunk_zyx=(1, tile_ny, tile_nx),
    )
    return TiffSource(path, description, file, series, axes, by_rows=by_rows)


class TiffSource(PlaneSource):
    """One image of a TIFF file, open."""

    def __init__(
        self,
        path: Path,
        description: Description,
        file: Any,
        series: Any,
        axes: Axes,
        *,
        by_rows: bool,
    ) -> None:
        super().__init__(path, description, axes.nsamples)
        self._file = file
        self._series = series
        self._keyframe = series.keyframe
        self._axes = axes
        self._by_rows = by_rows
        self._pages: OrderedDict[int, _Page | None] = OrderedDict()
        self._pages_lock = threading.Lock()
        # A series of contiguous planes has but one directory, and says where they begin.
        one = len(series._pages) == 1 and axes.npages > 1
        self._contiguous_from = series.dataoffset if one else None
        self._grid = _grid(self._keyframe, axes)
        self._require_pages((0, axes.npages - 1))

    @property
    def files(self) -> tuple[Path, ...]:
        """The file, and those that its OME-XML names beside it."""
        if not self._series.is_multifile:
            return (self.path,)
        others = {Path(page.parent.filehandle.path) for page in self._series._pages if page}
        return (self.path, *sorted(others - {self.path.absolute()}))

    def _decode(self, tile: Tile) -> npt.NDArray[Any]:
        index, separate = self._axes.page_of(tile.t, tile.group, tile.z)
        if self._contiguous_from is not None:
            return self._rows_contiguous(index, separate, tile.iy)
        page = self._page(index)
        if page is None:  # OME-XML counts planes that no file has; their samples are zero
            return np.zeros((*self._tile_yx, self._nsamples), self.dtype)
        if self._by_rows:
            return self._rows(page, separate, tile.iy)
        return self._segment(page, separate, tile)

    def _page(self, index: int) -> _Page | None:
        with self._pages_lock:
            if index not in self._pages:
                with parsing(self.path, f"TIFF directory of page {index}"):
                    self._pages[index] = self._look_up(index)
                if len(self._pages) > _PAGES_KEPT:
                    self._pages.popitem(last=False)
            return self._pages[index]

    def _look_up(self, index: int) -> _Page | None:
        page = self._series[index]
        if page is None:
            return None
        nsegments = self._grid[0] * self._grid[1] * self._axes.nseparate
        offsets, nbytes = page.dataoffsets, page.databytecounts
        if len(offsets) != nsegments or len(nbytes) != nsegments:
            raise SourceError(
                f"{self.path}: page {index} has {len(offsets)} strips or tiles, but its size "
                f"takes {nsegments}; export the file again",
                path=str(self.path),
                page=index,
            )
        path = Path(page.parent.filehandle.path) if self._series.is_multifile else self.path
        tables = getattr(page, "jpegtables", None), getattr(page, "jpegheader", None)
        return _Page(path, offsets, nbytes, *tables)

    def _require_pages(self, indices: tuple[int, ...]) -> None:
        """Refuse a file that ends before these pages, or whose segments would be too large."""
        if self._contiguous_from is not None:
            end = self._contiguous_from + self._axes.npages * self._page_nbytes
            if end > (size := self.path.stat().st_size):
                raise _too_short(self.path, self._axes.npages - 1, end, size)
            return
        for index in indices:
            page = self._page(index)
            if page is None:
                continue
            size = page.path.stat().st_size
            ends = [a + n for a, n in zip(page.offsets, page.nbytes, strict=True)]
            if max(ends) > size:
                raise _too_short(page.path, index, max(ends), size)
            if self._by_rows and sum(page.nbytes) < self._page_nbytes:
                raise _damaged(
                    self.path,
                    index,
                    f"its strips are {sum(page.nbytes)} bytes, its pixels {self._page_nbytes}",
                )

    @property
    def _page_nbytes(self) -> int:
        ny, nx = self._axes.shape_yx
        return ny * nx * self._nsamples * self._axes.nseparate * self.dtype.itemsize

    def _rows_contiguous(self, index: int, separate: int, iy: int) -> npt.NDArray[Any]:
        """Rows of planes that lie one after the other without directories of their own."""
        ny, _ = self._axes.shape_yx
        first = iy * self._tile_yx[0]
        nrows = min(self._tile_yx[0], ny - first)
        start = (self._contiguous_from or 0) + index * self._page_nbytes
        start += separate * self._page_nbytes // self._axes.nseparate + first * self._row_nbytes
        data = self._bytes(self.path, start, nrows * self._row_nbytes, index)
        return self._samples(data, nrows)

    def _rows(self, page: _Page, separate: int, iy: int) -> npt.NDArray[Any]:
        """Rows out of the uncompressed strips that hold them."""
        ny, _ = self._axes.shape_yx
        strip_ny = min(self._keyframe.rowsperstrip, ny)
        first = iy * self._tile_yx[0]
        last = min(first + self._tile_yx[0], ny)
        parts = []
        for strip in range(first // strip_ny, (last - 1) // strip_ny + 1):
            start = max(first, strip * strip_ny)
            stop = min(last, (strip + 1) * strip_ny)
            skip = (start - strip * strip_ny) * self._row_nbytes
            segment = separate * self._grid[0] + strip
            nbytes = (stop - start) * self._row_nbytes
            if skip + nbytes > page.nbytes[segment]:
                raise _damaged(self.path, segment, "its strip is shorter than its rows")
            parts.append(self._bytes(page.path, page.offsets[segment] + skip, nbytes, segment))
        return self._samples(b"".join(parts), last - first)

    @property
    def _row_nbytes(self) -> int:
        return self._axes.shape_yx[1] * self._nsamples * self.dtype.itemsize

    def _samples(self, data: bytes, nrows: int) -> npt.NDArray[Any]:
        """Rows of samples in the byte order of the file as they are in memory."""
        order = self._file.byteorder
        samples = np.frombuffer(data, self.dtype.newbyteorder(order)).astype(self.dtype, copy=False)
        return samples.reshape(nrows, self._axes.shape_yx[1], self._nsamples)

    def _segment(self, page: _Page, separate: int, tile: Tile) -> npt.NDArray[Any]:
        """One tile or strip, decoded whole."""
        segment = (separate * self._grid[0] + tile.iy) * self._grid[1] + tile.ix
        ny, nx = self._tile_yx
        nbytes, stored = ny * nx * self._nsamples * self.dtype.itemsize, page.nbytes[segment]
        if not stored:  # what sparse files leave out
            return np.full((ny, nx, self._nsamples), self._keyframe.nodata, self.dtype)
        if nbytes > min(_SEGMENT_LIMIT_NBYTES, max(stored * _RATIO_LIMIT, 1 << 20)):
            raise _damaged(
                self.path, segment, f"{stored} bytes are to hold {nbytes}; tiles must be smaller"
            )
        if stored > 2 * nbytes + (1 << 20):
            raise _damaged(self.path, segment, f"{stored} bytes hold no more than {nbytes}")
        data = self._bytes(page.path, page.offsets[segment], stored, segment)
        if self._keyframe.compression in _JPEGS:
            npixels = coded_npixels((page.jpegheader or b"") + data)
            if npixels is None or npixels > 2 * ny * nx:
                raise _damaged(
                    self.path, segment, f"its code is of {npixels} pixels, not {ny * nx}"
                )
        tables: dict[str, Any] = {}
        if page.jpegtables is not None:
            tables["jpegtables"] = page.jpegtables
        if page.jpegheader is not None:
            tables["jpegheader"] = page.jpegheader
        try:
            samples = self._decoder()(data, segment, **tables)[0]
        except OctobrickError:
            raise
        except Exception as error:  # codecs of others promise nothing about hostile bytes
            reason = printable(str(error) or type(error).__name__)
            raise _damaged(self.path, segment, reason) from error
        decoded: npt.NDArray[Any] = samples[0]
        return decoded

    def _decoder(self) -> Any:
        with self._pages_lock:
            return self._keyframe.decode

    def _bytes(self, path: Path, position: int, nbytes: int, page: int) -> bytes:
        """Bytes of a file; opened each time, for an OME-TIFF may be a thousand files."""
        with open_file(path) as file:
            size = os.fstat(file.fileno()).st_size
            if position < 0 or position + nbytes > size:
                raise _too_short(path, page, position + nbytes, size)
            try:
                data = os.pread(file.fileno(), nbytes, position)
            except OSError as error:
                raise _damaged(path, page, error.strerror) from error
            while len(data) < nbytes:  # a read ends at 2 GiB
                more = os.pread(file.fileno(), nbytes - len(data), position + len(data))
                if not more:
                    raise _too_short(path, page, position + nbytes, position + len(data))
                data += more
            return data

    def _close(self) -> None:
        super()._close()
        self._file.close()


def _require_codec(keyframe: Any, path: Path) -> None:
    if keyframe.compression == 1 and _is_plain(keyframe):
        return
    try:
        import imagecodecs  # noqa: F401  (tifffile calls it)
    except ImportError as error:
        raise missing_package("imagecodecs", path) from error


def _is_plain(keyframe: Any) -> bool:
    """Whether rows can be read out of strips as they are."""
    return bool(
        keyframe.compression == 1
        and keyframe.predictor == 1
        and keyframe.fillorder == 1
        and not keyframe.is_tiled
        and not keyframe.is_subsampled
        and keyframe.bitspersample == np.dtype(keyframe.dtype).itemsize * 8
    )


def _grid(keyframe: Any, axes: Axes) -> tuple[int, int]:
    """How many segments a page has along y and x."""
    ny, nx = axes.shape_yx
    if keyframe.is_tiled:
        return -(-ny // keyframe.tilelength), -(-nx // keyframe.tilewidth)
    return -(-ny // min(max(1, keyframe.rowsperstrip), ny)), 1


def _name(file: Any) -> str:
    kind = "bigtiff" if file.is_bigtiff else "tiff"
    return f"ome-{kind}" if file.is_ome else kind


def _channels(keyframe: Any, axes: Axes, known: TiffMetadata) -> tuple[Channel, ...]:
    """RGB or RGBA where the samples of a pixel are a colour; else the names that are known."""
    if keyframe.photometric in _RGB_PHOTOMETRICS and axes.ncolors == axes.nc:
        if axes.nc == 3:
            return RGB
        if axes.nc == 4:
            return RGBA
    return known.channels if len(known.channels) == axes.nc else ()


def _too_short(path: Path, page: int, end: int, size: int) -> TruncatedSourceError:
    return TruncatedSourceError(
        f"{path}: the pixels of page {page} go up to byte {end}, but the file has {size} bytes; "
        "copy or export the file again",
        path=str(path),
        page=page,
        expected_nbytes=end,
        actual_nbytes=size,
    )


def _damaged(path: Path, segment: int, reason: str | None) -> SourceError:
    return SourceError(
        f"{path}: strip or tile {segment} of a page cannot be decoded: {reason}; "
        "copy or export the file again",
        path=str(path),
        segment=segment,
    )
