"""One DICOM file: the frames in it, what their header says, and where their pixels lie."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from octobrick.store.errors import SourceError, TruncatedSourceError, UnsupportedSourceError
from octobrick.store.sources.base import Rescale, Vector
from octobrick.store.sources.head import missing_package, open_file, parsing, printable

_FRAMES_LIMIT = 1 << 20
_DEFLATED = "1.2.840.10008.1.2.1.99"
_BIG_ENDIAN = "1.2.840.10008.1.2.2"
_IMPLICIT = "1.2.840.10008.1.2"
_UNDEFINED_LENGTH = 0xFFFFFFFF
# Pixel Data, Float Pixel Data, Double Float Pixel Data: the element, and its type if it has one.
_PIXEL_ELEMENTS = {0x0010: None, 0x0008: "float32", 0x0009: "float64"}


@dataclass(frozen=True, slots=True)
class Pixels:
    """How the frames of a file are stored; those of one series are all alike.

    Attributes:
        shape_yx: pixels of a frame.
        nsamples: samples of a pixel.
        dtype: native-endian sample type.
        bits: how many of its bits count.
        photometric: what the samples mean.
        planar: whether the samples of a pixel lie in planes of their own.
    """

    shape_yx: tuple[int, int]
    nsamples: int
    dtype: np.dtype[Any]
    bits: int
    photometric: str
    planar: bool

    @property
    def frame_nbytes(self) -> int:
        """Bytes of a frame, uncompressed."""
        return self.shape_yx[0] * self.shape_yx[1] * self.nsamples * self.dtype.itemsize


@dataclass(frozen=True, slots=True)
class Stored:
    """Where the pixels of a file begin, and how they are coded."""

    path: Path
    offset_nbytes: int
    is_encapsulated: bool
    transfer_syntax: str
    nframes: int

    @property
    def is_big_endian(self) -> bool:
        """Whether uncompressed samples have their most significant bytes first."""
        return self.transfer_syntax == _BIG_ENDIAN


@dataclass(frozen=True, slots=True)
class Frame:
    """One plane: where it is stored and where it lies in the patient (LPS, millimetres)."""

    stored: Stored
    index: int
    pixels: Pixels
    position_xyz: Vector | None
    row_xyz: Vector | None
    column_xyz: Vector | None
    spacing_yx: tuple[float, float] | None
    thickness: float | None
    rescale: Rescale
    order: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class DicomFile:
    """The frames of a file, and the series to which they belong."""

    series: str
    title: str
    instance: str
    frames: tuple[Frame, ...]


def read_dicom(path: Path) -> DicomFile | None:
    """What is in a DICOM file; None if it is one without pixels (DICOMDIR, a report).

    Raises:
        SourceError: the header is damaged, or `TruncatedSourceError`: pixels are missing.
        UnsupportedSourceError: pixels that are not read.
    """
    with lenient(path), open_file(path) as raw:
        from pydicom import filereader

        header = filereader.read_partial(raw, stop_when=_is_pixel_element)
        if "Rows" not in header or "Columns" not in header:
            _require_no_image(header, path)
            return None
        syntax = str(header.file_meta.TransferSyntaxUID)
        if syntax == _DEFLATED:
            raise UnsupportedSourceError(
                f"{path}: the whole file is deflated, which is not read; convert it with: "
                f"dcmconv +ti {path.name} plain.dcm",
                path=str(path),
            )
        element, length = _pixel_element(raw, syntax, path)
        pixels = _pixels(header, element, path)
        nframes = int(header.get("NumberOfFrames") or 1)
        encapsulated = length == _UNDEFINED_LENGTH
        stored = Stored(path, raw.tell(), encapsulated, syntax, nframes)
        _require_bytes(stored, pixels, path.stat().st_size)
        frames = tuple(_frame(header, stored, pixels, i) for i in range(nframes))
        title = " ".join(str(header.get(name) or "") for name in ("Modality", "SeriesDescription"))
        return DicomFile(
            str(header.get("SeriesInstanceUID") or ""),
            printable(title.strip()),
            str(header.get("SOPInstanceUID") or ""),
            frames,
        )


def _require_no_image(header: Any, path: Path) -> None:
    """Refuse a file without pixels whose class says that it has some, or has none."""
    kind = header.file_meta.get("MediaStorageSOPClassUID")
    is_whole = kind is not None and "TransferSyntaxUID" in header.file_meta
    if not is_whole or "Image Storage" in kind.name:
        raise TruncatedSourceError(
            f"{path}: ends before the size of its image; copy or export the file again",
            path=str(path),
        )


def _is_pixel_element(tag: Any, vr: str | None, length: int) -> bool:  # noqa: ARG001
    return tag.group == 0x7FE0 and tag.element in _PIXEL_ELEMENTS


@contextmanager
def lenient(path: Path) -> Iterator[None]:
    """Parse DICOM: what pydicom only warns of is what half of all scanners write."""
    try:
        import pydicom  # noqa: F401
    except ImportError as error:
        raise missing_package("pydicom", path) from error
    with parsing(path, "DICOM"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def _pixel_element(raw: Any, syntax: str, path: Path) -> tuple[int, int]:
    """The element that holds the pixels and its length; the file is then at the first of them."""
    order = "big" if syntax == _BIG_ENDIAN else "little"
    head = raw.read(8)
    group = int.from_bytes(head[:2], order)  # type: ignore[arg-type]
    element = int.from_bytes(head[2:4], order)  # type: ignore[arg-type]
    if syntax == _IMPLICIT:
        length = head[4:]
    elif head[4:6] in (b"OB", b"OW", b"OF", b"OD", b"UN"):
        length = raw.read(4)
    else:
        length = b""
    if group != 0x7FE0 or element not in _PIXEL_ELEMENTS or len(length) != 4:
        raise TruncatedSourceError(
            f"{path}: there are no pixels after the header; copy or export the file again",
            path=str(path),
        )
    return element, int.from_bytes(length, order)  # type: ignore[arg-type]


def _pixels(header: Any, element: int, path: Path) -> Pixels:
    ny, nx, nsamples = int(header.Rows), int(header.Columns), int(header.get("SamplesPerPixel", 1))
    photometric = str(header.get("PhotometricInterpretation") or "MONOCHROME2")
    allocated = int(header.get("BitsAllocated", 16))
    name = _PIXEL_ELEMENTS[element]
    if name is None:
        signed = int(header.get("PixelRepresentation") or 0) == 1
        name = f"{'int' if signed else 'uint'}{allocated}"
    if name not in ("uint8", "int8", "uint16", "int16", "uint32", "int32", "float32", "float64"):
        raise UnsupportedSourceError(
            f"{path}: samples take {allocated} bits; 8, 16 and 32 are read; convert the file",
            path=str(path),
            bits=allocated,
        )
    if ny < 1 or nx < 1:
        raise SourceError(
            f"{path}: the header gives {nx} x {ny} pixels (x, y); export the file again",
            path=str(path),
        )
    if (nsamples, photometric[:4]) not in ((1, "MONO"), (1, "PALE"), (3, "RGB"), (3, "YBR_")):
        raise UnsupportedSourceError(
            f"{path}: pixels are {printable(photometric)} of {nsamples} samples; monochrome, "
            "palette, RGB and compressed YBR are read; convert the file",
            path=str(path),
            photometric=printable(photometric),
        )
    bits = int(header.get("BitsStored") or allocated)
    high = int(header.get("HighBit") or bits - 1)
    dtype = np.dtype(name)
    if not 0 < bits <= dtype.itemsize * 8 or high != bits - 1:
        bits = dtype.itemsize * 8
    planar = int(header.get("PlanarConfiguration") or 0) == 1
    return Pixels((ny, nx), nsamples, dtype, bits, photometric, planar and nsamples > 1)


def _require_bytes(stored: Stored, pixels: Pixels, size: int) -> None:
    """Refuse a header that counts more than the file holds."""
    have = size - stored.offset_nbytes
    # A compressed frame has an item of its own: 8 bytes and its code.
    want = stored.nframes * (9 if stored.is_encapsulated else pixels.frame_nbytes)
    if not 0 < stored.nframes <= _FRAMES_LIMIT:
        raise SourceError(
            f"{stored.path}: the header counts {stored.nframes} frames; 1 to {_FRAMES_LIMIT} are "
            "expected; export the file again",
            path=str(stored.path),
        )
    if have < want:
        raise TruncatedSourceError(
            f"{stored.path}: pixels end after {max(0, have)} of {want} bytes; copy or export the "
            "file again",
            path=str(stored.path),
            expected_nbytes=want,
            actual_nbytes=max(0, have),
        )
    if not stored.is_encapsulated and pixels.photometric.startswith("YBR"):
        raise UnsupportedSourceError(
            f"{stored.path}: pixels are {printable(pixels.photometric)} and not compressed, which "
            "is not read; convert the file to RGB",
            path=str(stored.path),
        )


def _frame(header: Any, stored: Stored, pixels: Pixels, index: int) -> Frame:
    """What the header says of a frame: its own group, the shared one, else the whole file's."""
    own = header.get("PerFrameFunctionalGroupsSequence")
    shared = header.get("SharedFunctionalGroupsSequence")
    places = [
        *([own[index]] if own and index < len(own) else []),
        *([shared[0]] if shared else []),
    ]

    def look(sequence: str, name: str) -> Any:
        for place in places:
            group = place.get(sequence)
            if group and name in group[0]:
                return group[0].get(name)
        return header.get(name)

    orientation = _numbers(look("PlaneOrientationSequence", "ImageOrientationPatient"), 6)
    spacing = _numbers(
        look("PixelMeasuresSequence", "PixelSpacing") or header.get("ImagerPixelSpacing"), 2
    )
    position = _numbers(look("PlanePositionSequence", "ImagePositionPatient"), 3)
    offsets = header.get("GridFrameOffsetVector")
    row, column = (orientation[:3], orientation[3:]) if orientation else (None, None)
    if position and row and column and offsets is not None and index < len(offsets):
        position = tuple(np.add(position, np.cross(row, column) * float(offsets[index])))
    elif stored.nframes > 1 and not own:
        position = None  # one position for all frames says nothing of any
    thickness = look("PixelMeasuresSequence", "SpacingBetweenSlices") or look(
        "PixelMeasuresSequence", "SliceThickness"
    )
    slope = look("PixelValueTransformationSequence", "RescaleSlope")
    intercept = look("PixelValueTransformationSequence", "RescaleIntercept")
    names = ("TemporalPositionIdentifier", "AcquisitionNumber", "EchoNumbers", "InstanceNumber")
    order = [_number(header.get(name)) for name in names]
    return Frame(
        stored,
        index,
        pixels,
        _vector(position),
        _vector(row),
        _vector(column),
        (spacing[0], spacing[1]) if spacing else None,
        float(thickness) if thickness else None,
        Rescale(1.0 if slope is None else float(slope), float(intercept or 0)),
        (*order, index),
    )


def _numbers(values: Any, count: int) -> tuple[float, ...] | None:
    """So many finite numbers, or None."""
    if values is None or isinstance(values, str) or not hasattr(values, "__len__"):
        return None
    numbers = tuple(float(value) for value in values)
    return numbers if len(numbers) == count and all(map(np.isfinite, numbers)) else None


def _vector(numbers: tuple[float, ...] | None) -> Vector | None:
    return None if numbers is None else (float(numbers[0]), float(numbers[1]), float(numbers[2]))


def _number(value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        return 0.0
