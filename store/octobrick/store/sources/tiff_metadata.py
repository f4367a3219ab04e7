"""What microscopes and ImageJ write into TIFF files beside the pixels: spacing, unit, channels."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from octobrick.store.errors import SourceError, UnsupportedSourceError
from octobrick.store.sources.base import Channel, Vector
from octobrick.store.sources.head import printable
from octobrick.store.sources.voxels import clean_spacing

# A description with more planes than this is damaged: readers make a list with a place for each.
_PLANES_LIMIT = 1 << 22
_OME_COUNTS = re.compile(
    r'\b(?:Size[TCZ]|First[TCZ]|IFD|NumPlanes|PlaneCount|SamplesPerPixel)\s*=\s*["\']\s*'
    r'([^"\']*)["\']'
)

_UNIT_OF_NAME = {
    "nm": "nanometer",
    "nanometer": "nanometer",
    "µm": "micrometer",
    "μm": "micrometer",
    "um": "micrometer",
    "micron": "micrometer",
    "microns": "micrometer",
    "micrometer": "micrometer",
    "mm": "millimeter",
    "millimeter": "millimeter",
    "cm": "centimeter",
    "centimeter": "centimeter",
    "m": "meter",
    "meter": "meter",
    "å": "angstrom",
    "pm": "picometer",
    "inch": "inch",
    "in": "inch",
}
# Relative to a micrometer, where the axes of a file have units of their own.
_SIZE_OF_UNIT = {
    "picometer": 1e-6,
    "angstrom": 1e-4,
    "nanometer": 1e-3,
    "micrometer": 1.0,
    "millimeter": 1e3,
    "centimeter": 1e4,
    "meter": 1e6,
    "inch": 25400.0,
}


@dataclass(frozen=True, slots=True)
class TiffMetadata:
    """What is known beside the pixels; ``channels`` are empty where nothing is."""

    spacing_zyx: Vector = (1.0, 1.0, 1.0)
    unit: str | None = None
    channels: tuple[Channel, ...] = ()
    notes: list[str] = field(default_factory=list)


def require_sane_ome(xml: str, path: Path) -> None:
    """Refuse OME-XML that would make its reader allocate for planes that nobody has.

    Raises:
        SourceError: a count is no number or beyond reason.
        UnsupportedSourceError: axes are split into sub-axes (``ModuloAlongZ`` and the like).
    """
    if re.search(r"<(?:\w+:)?ModuloAlong", xml):
        raise UnsupportedSourceError(
            f"{path}: the OME-XML splits an axis in two (ModuloAlong), which is not read; "
            "export one part on its own",
            path=str(path),
        )
    for pixels in re.findall(r"<(?:\w+:)?Pixels\b[^>]*>", xml):
        planes = 1
        for count in re.findall(r'\bSize[TCZ]\s*=\s*["\']\s*(\d{1,18})\s*["\']', pixels):
            planes *= int(count)
        _require_count(planes, path)
    for count in _OME_COUNTS.findall(xml):
        _require_count(int(count) if re.fullmatch(r"\d{1,18}\s*", count) else count, path)


def _require_count(count: int | str, path: Path) -> None:
    if isinstance(count, str) or count > _PLANES_LIMIT:
        raise SourceError(
            f"{path}: the OME-XML counts {printable(str(count))!r} planes or channels; at most "
            f"{_PLANES_LIMIT} are read; export the file again",
            path=str(path),
        )


def of_ome(xml: str, image: int) -> TiffMetadata:
    """Spacing, unit and channels of the ``image``-th image of OME-XML."""
    try:
        root = ElementTree.fromstring(xml)  # noqa: S314  (expat bounds what entities expand to)
    except ElementTree.ParseError:
        return TiffMetadata()
    pixels = [
        found for element in _children(root, "Image") for found in _children(element, "Pixel")
    ]
    if image >= len(pixels):
        return TiffMetadata()
    attributes = pixels[image].attrib
    sizes, units = [], []
    for axis in "XYZ":
        sizes.append(_number(attributes.get(f"PhysicalSize{axis}")))
        units.append(unit_of(attributes.get(f"PhysicalSize{axis}Unit", "µm")))
    notes: list[str] = []
    unit = units[0] if sizes[0] is not None else None
    known = [
        _converted(size, own, unit) if size is not None else 1.0
        for size, own in zip(sizes, units, strict=True)
    ]
    channels = tuple(
        Channel(element.get("Name") or None, _color(element.get("Color")))
        for element in _children(pixels[image], "Channel")
    )
    return TiffMetadata(clean_spacing(known, notes), unit, channels, notes)


def of_imagej(meta: dict[str, Any], resolution_xy: tuple[float, float]) -> TiffMetadata:
    """Spacing and unit of ImageJ's description, and pixels for each unit along x and y."""
    unit = unit_of(str(meta.get("unit", "")))
    notes: list[str] = []
    x, y = (1 / found if found else 1.0 for found in resolution_xy)
    z = _number(str(meta.get("spacing", 1.0)))
    return TiffMetadata(clean_spacing([x, y, 1.0 if z is None else z], notes), unit, (), notes)


def unit_of(name: str) -> str | None:
    """The UDUNITS name of a unit; None for pixels and whatever else is no length."""
    plain = name.strip().replace("\\u00B5", "µ").casefold()
    return _UNIT_OF_NAME.get(plain) or _UNIT_OF_NAME.get(plain.replace("μ", "µ"))


def _converted(size: float, own: str | None, unit: str | None) -> float:
    if own is None or unit is None or own == unit:
        return size
    return size * _SIZE_OF_UNIT[own] / _SIZE_OF_UNIT[unit]


def _children(element: ElementTree.Element, name: str) -> Iterator[ElementTree.Element]:
    """Children by the beginning of their name, whatever the version of the schema."""
    for child in element:
        if child.tag.rpartition("}")[2].startswith(name):
            yield child


def _number(text: str | None) -> float | None:
    try:
        return None if text is None else float(text)
    except ValueError:
        return None


def _color(text: str | None) -> str | None:
    """OME writes a colour as red, green, blue, alpha in one signed 32-bit number."""
    try:
        rgba = int(text) & 0xFFFFFFFF if text is not None else None
    except ValueError:
        return None
    return None if rgba is None else f"{rgba >> 8:06x}"
