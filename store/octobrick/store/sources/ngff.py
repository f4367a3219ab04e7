"""What OME-Zarr (OME-NGFF 0.1 to 0.5) says of an image, from the attributes of its group.

Source: https://ngff.openmicroscopy.org/0.5/, and the specifications of the versions before.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from octobrick.store.sources.axes import LETTERS
from octobrick.store.sources.base import Channel
from octobrick.store.sources.head import printable

_LETTER_OF_TYPE = {"time": "t", "channel": "c"}
_OLD_AXES = "tczyx"  # of versions before axes were named
_COLOR = re.compile(r"[0-9A-Fa-f]{6}")


class Ngff(NamedTuple):
    """An image of several resolutions, of which one is read.

    Attributes:
        dataset: path of the array in the group.
        letters: its axes.
        scale: distance of neighbours along each axis.
        translation: where the first sample lies along each axis.
        unit: the unit of the axes of space, where they have one and the same.
        channels: names and colours, as many as the image has or none.
        labels: whether samples are names of objects.
    """

    dataset: str
    letters: str
    scale: tuple[float, ...]
    translation: tuple[float, ...]
    unit: str | None
    channels: tuple[Channel, ...]
    labels: bool


def parse_ngff(attributes: Mapping[str, Any], dataset: str | None, notes: list[str]) -> Ngff | None:
    """The image that the attributes of a group describe; None if they describe none.

    Args:
        attributes: of the group; those of 0.5 are under ``ome``.
        dataset: path of the resolution that is wanted; None for the finest.
        notes: takes a sentence for each thing that is not used.

    Raises:
        Exception: any kind, where the attributes are not as specified.
    """
    ome = attributes.get("ome", attributes)
    if not isinstance(ome, Mapping) or not ome.get("multiscales"):
        return None
    images = ome["multiscales"]
    if len(images) > 1:
        notes.append(f"there are {len(images)} multiscale images; the first is read")
    image = images[0]
    levels = {str(level["path"]).strip("/"): level for level in image["datasets"]}
    path = str(image["datasets"][0]["path"]).strip("/") if dataset is None else dataset
    if path not in levels:
        return None
    letters, unit = _axes(image.get("axes"), notes)
    scale, translation = [1.0] * len(letters), [0.0] * len(letters)
    for part in (levels[path], image):
        for step in part.get("coordinateTransformations") or ():
            _apply(step, scale, translation, notes)
    return Ngff(
        path,
        letters,
        tuple(scale),
        tuple(translation),
        unit,
        _channels(ome.get("omero")),
        "image-label" in ome,
    )


def _axes(given: Sequence[Any] | None, notes: list[str]) -> tuple[str, str | None]:
    """The letters of the axes, and the unit of those of space."""
    if given is None:
        return _OLD_AXES, None
    letters, units = "", set()
    for axis in given:
        described = {"name": axis} if isinstance(axis, str) else axis
        name = str(described["name"]).lower()
        letter = _LETTER_OF_TYPE.get(described.get("type", ""), name)
        if len(letter) != 1 or letter not in LETTERS or letter in letters:
            raise ValueError(f"axis {printable(name)!r} is none of t, c, z, y, x")
        letters += letter
        if letter in "zyx":
            units.add(described.get("unit"))
    if len(units) == 1:
        unit = units.pop()
        return letters, None if unit is None else printable(str(unit))
    notes.append("the axes of space have different units; none is used")
    return letters, None


def _apply(
    step: Mapping[str, Any], scale: list[float], translation: list[float], notes: list[str]
) -> None:
    """One transformation after those before it."""
    kind = step["type"]
    values = [float(value) for value in step.get(kind, ())]
    if kind not in ("scale", "translation", "identity") or (kind in step) != (kind != "identity"):
        notes.append(f"a transformation of type {printable(str(kind))} is not used")
        return
    if kind != "identity" and len(values) != len(scale):
        raise ValueError(f"{kind} has {len(values)} numbers for {len(scale)} axes")
    for axis, value in enumerate(values):
        if kind == "scale":
            scale[axis] *= value
            translation[axis] *= value
        else:
            translation[axis] += value


def _channels(omero: Any) -> tuple[Channel, ...]:
    if not isinstance(omero, Mapping):
        return ()
    return tuple(
        Channel(_name(channel.get("label")), _color(channel.get("color")))
        for channel in omero.get("channels") or ()
    )


def _name(label: Any) -> str | None:
    return printable(label) if isinstance(label, str) and label else None


def _color(color: Any) -> str | None:
    is_color = isinstance(color, str) and _COLOR.fullmatch(color)
    return color.lower() if is_color else None
