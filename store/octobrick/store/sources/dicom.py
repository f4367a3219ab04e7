"""DICOM series: a folder, a pattern or one file of several frames, decoded frame by frame."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from octobrick.codec.errors import InvalidInputError, OctobrickError
from octobrick.store.errors import SourceError, TruncatedSourceError, UnsupportedSourceError
from octobrick.store.sources.base import RGB, Description, Pick, Rescale, Source
from octobrick.store.sources.dicom_file import DicomFile, Frame, Stored, read_dicom
from octobrick.store.sources.dicom_stack import Stack, stack_frames
from octobrick.store.sources.head import missing_package, open_file, printable
from octobrick.store.sources.jpeg_size import coded_npixels
from octobrick.store.sources.planes import PlaneSource, Tile

# What imagecodecs calls the codes of the transfer syntaxes 1.2.840.10008.1.2.*
_CODECS = {
    "4.50": "jpeg_decode",
    "4.51": "jpeg_decode",
    "4.57": "ljpeg_decode",
    "4.70": "ljpeg_decode",
    "4.80": "jpegls_decode",
    "4.81": "jpegls_decode",
    "4.90": "jpeg2k_decode",
    "4.91": "jpeg2k_decode",
    "4.201": "jpeg2k_decode",
    "4.202": "jpeg2k_decode",
    "4.203": "jpeg2k_decode",
    "5": "dicomrle_decode",
}
_SYNTAX_PREFIX = "1.2.840.10008.1.2."
_LISTED_SERIES = 16


def open_dicom_file(path: Path, pick: Pick = Pick()) -> Source:  # noqa: B008  (immutable)
    """The frames of one file; raises what `open_dicom` does."""
    return open_dicom(path, [path], pick)


def open_dicom(
    path: Path,
    files: Sequence[Path],
    pick: Pick = Pick(),  # noqa: B008  (immutable)
    notes: Sequence[str] = (),
) -> Source:
    """The volume of a series.

    Args:
        path: the file, folder or pattern, as the name of the whole.
        files: DICOM files, in any order.
        pick: which series, by its UID or its number in the list that the error gives.
        notes: warnings that were found on the way.

    Raises:
        SourceError: a file is damaged; frames differ, or are missing.
        UnsupportedSourceError: several series of which none is picked, pixels that are not read.
    """
    if pick.axes is not None:
        raise InvalidInputError(
            f"{path}: DICOM says what its axes are; leave out --axes", path=str(path)
        )
    read = [(file, read_dicom(file)) for file in files]
    found = [content for _, content in read if content is not None]
    without = [file.name for file, content in read if content is None]
    warned = list(notes)
    if not found:
        raise UnsupportedSourceError(f"{path}: holds no pixels; give a file of an image series")
    if without:
        warned.append(f"{len(without)} files without pixels are left aside: {without[0]}")
    chosen = _choose(path, found, pick.dataset)
    _require_distinct(chosen)
    frames = [frame for content in chosen for frame in content.frames]
    stack = stack_frames(path, frames, warned)
    return DicomSource(path, _describe(stack, warned), stack)


class DicomSource(PlaneSource):
    """The frames of a series, none of whose files is held open."""

    def __init__(self, path: Path, description: Description, stack: Stack) -> None:
        super().__init__(path, description, stack.frames[0][0].pixels.nsamples)
        self._frames = stack.frames
        self._rescales = description.dtype != stack.frames[0][0].pixels.dtype

    @property
    def files(self) -> tuple[Path, ...]:
        """The files of the series, in the order of z."""
        return tuple(dict.fromkeys(frame.stored.path for step in self._frames for frame in step))

    def _decode(self, tile: Tile) -> npt.NDArray[Any]:
        frame = self._frames[tile.t][tile.z]
        samples = _samples(frame)
        if self._rescales:
            slope, intercept = frame.rescale
            return (samples * np.float64(slope) + intercept).astype(self.dtype)
        return samples


def _describe(stack: Stack, notes: list[str]) -> Description:
    first = stack.frames[0][0]
    ny, nx = first.pixels.shape_yx
    dtype = first.pixels.dtype
    rescales = {frame.rescale for step in stack.frames for frame in step}
    rescale: Rescale | None = None if first.rescale == (1, 0) else first.rescale
    if not all(np.isfinite(value) for pair in rescales for value in pair):
        rescale, rescales = None, {Rescale(1, 0)}
        notes.append("the rescale of the header is not finite; it is not used")
    if len(rescales) > 1:
        dtype, rescale = np.dtype(np.float32), None
        notes.append("each frame has a rescale of its own; values are rescaled, as float32")
    if first.pixels.photometric == "MONOCHROME1":
        notes.append("high values are shown dark (MONOCHROME1); samples are read as stored")
    return Description(
        "dicom",
        (len(stack.frames[0]), ny, nx),
        dtype,
        stack.spacing_zyx,
        "millimeter" if stack.has_unit else None,
        stack.direction,
        rescale,
        tuple(notes),
        stack.origin_xyz,
        nt=len(stack.frames),
        nc=first.pixels.nsamples,
        channels=RGB if first.pixels.nsamples == 3 else (),
        chunk_zyx=(1, ny, nx),
    )


def _choose(path: Path, found: list[DicomFile], dataset: str | None) -> list[DicomFile]:
    """The files of the series that is asked for, or of the only one."""
    series: dict[str, list[DicomFile]] = {}
    for content in found:
        series.setdefault(content.series, []).append(content)
    if dataset is None and len(series) == 1:
        return found
    if dataset in series:
        return series[dataset]
    if dataset is not None and dataset.isdecimal() and int(dataset) < len(series):
        return list(series.values())[int(dataset)]
    listed = "; ".join(
        f"{i}: {printable(uid)} ({contents[0].title}, {len(contents)} files)"
        for i, (uid, contents) in enumerate(list(series.items())[:_LISTED_SERIES])
    )
    asked = "" if dataset is None else f"; there is no {printable(dataset)!r}"
    raise UnsupportedSourceError(
        f"{path}: holds {len(series)} series: {listed}{asked}; choose one by its number or UID "
        "(--dataset 0)",
        path=str(path),
        series=[printable(uid) for uid in list(series)[:_LISTED_SERIES]],
    )


def _require_distinct(chosen: list[DicomFile]) -> None:
    """Refuse two copies of one file, which would be taken for two time steps."""
    seen: dict[str, DicomFile] = {}
    for content in chosen:
        if content.instance and content.instance in seen:
            path, other = (each.frames[0].stored.path for each in (content, seen[content.instance]))
            raise SourceError(
                f"{path}: is the same image as {other.name}; leave one of them out",
                path=str(path),
                other=other.name,
            )
        seen[content.instance] = content


def _samples(frame: Frame) -> npt.NDArray[Any]:
    """The samples of a frame, (y, x, samples), with the bits that are stored."""
    pixels, stored = frame.pixels, frame.stored
    ny, nx = pixels.shape_yx
    if stored.is_encapsulated:
        samples = _decoded(frame)
    else:
        nbytes = pixels.frame_nbytes
        data = _bytes(stored, stored.offset_nbytes + frame.index * nbytes, nbytes)
        dtype = pixels.dtype.newbyteorder(">" if stored.is_big_endian else "<")
        samples = np.frombuffer(data, dtype)
        samples = samples.astype(pixels.dtype, copy=False)
        if pixels.planar:
            samples = np.moveaxis(samples.reshape(pixels.nsamples, ny, nx), 0, -1)
    if samples.size != ny * nx * pixels.nsamples or samples.dtype.itemsize != pixels.dtype.itemsize:
        raise SourceError(
            f"{stored.path}: frame {frame.index} decodes to {samples.shape} of {samples.dtype}, "
            f"but {nx} x {ny} pixels (x, y) of {pixels.nsamples} {pixels.dtype} are described; "
            "export the file again",
            path=str(stored.path),
            frame=frame.index,
        )
    samples = np.ascontiguousarray(samples).view(pixels.dtype).reshape(ny, nx, pixels.nsamples)
    unused = pixels.dtype.itemsize * 8 - pixels.bits
    if unused and pixels.dtype.kind in "iu":  # what lies above the stored bits is undefined
        samples = (samples << unused) >> unused
    return samples


def _decoded(frame: Frame) -> npt.NDArray[Any]:
    """A compressed frame, by imagecodecs."""
    stored = frame.stored
    name = _CODECS.get(stored.transfer_syntax.removeprefix(_SYNTAX_PREFIX))
    if name is None:
        raise UnsupportedSourceError(
            f"{stored.path}: pixels are coded by {printable(stored.transfer_syntax)}, which is not "
            "read; convert the file with: dcmdjpeg or gdcmconv --raw",
            path=str(stored.path),
            transfer_syntax=printable(stored.transfer_syntax),
        )
    try:
        import imagecodecs
    except ImportError as error:
        raise missing_package("imagecodecs", stored.path) from error
    decode: Callable[..., npt.NDArray[Any]] = getattr(imagecodecs, name)
    try:
        code = _code(frame)
        pixels = frame.pixels
        if name != "dicomrle_decode":
            expected, npixels = pixels.shape_yx[0] * pixels.shape_yx[1], coded_npixels(code)
            if npixels != expected:
                raise ValueError(f"its code is of {npixels} pixels, not {expected}")
            return decode(code)
        # Segments of bytes, most significant first, each a plane; samples come out one by one.
        planes = decode(code, pixels.dtype.newbyteorder("<"))
        planes = np.frombuffer(planes, pixels.dtype.newbyteorder("<")).astype(pixels.dtype)
        return np.moveaxis(planes.reshape(pixels.nsamples, *pixels.shape_yx), 0, -1)
    except OctobrickError:
        raise
    except Exception as error:  # codecs of others promise nothing about hostile bytes
        reason = printable(str(error) or type(error).__name__)
        raise SourceError(
            f"{stored.path}: frame {frame.index} cannot be decoded: {reason}; copy or export the "
            "file again",
            path=str(stored.path),
            frame=frame.index,
        ) from error


def _code(frame: Frame) -> bytes:
    """The bytes of a compressed frame."""
    from pydicom.encaps import get_frame

    with open_file(frame.stored.path) as file:
        file.seek(frame.stored.offset_nbytes)
        code: bytes = get_frame(file, frame.index, number_of_frames=frame.stored.nframes)
        return code


def _bytes(stored: Stored, position: int, nbytes: int) -> bytes:
    with open_file(stored.path) as file:
        data = os.pread(file.fileno(), nbytes, position)
    if len(data) < nbytes:
        raise TruncatedSourceError(
            f"{stored.path}: ends before byte {position + nbytes}: it has been cut short since it "
            "was opened; open it again",
            path=str(stored.path),
            expected_nbytes=position + nbytes,
        )
    return data
