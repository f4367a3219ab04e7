"""Which pictures a page shows, and in which order it gives them up where they are too many."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from PIL import Image

from octobrick.measure.measurement import Measurement, PictureRow
from octobrick.measure.pictures.difference_picture import CLASSES, class_shares
from octobrick.measure.report.numbers import percent

SLAB: Final = "slab"
_CARDS_MAX: Final = 8
_DIFFERENCE: Final = "-difference"


@dataclass(frozen=True, slots=True)
class Card:
    """Pictures of one row, a pair for each view.

    Attributes:
        row: how they were made.
        recommended: whether its setting is.
        own: key of the picture itself, of the first view; None where it was not kept.
        differences: keys, by view; None where it was not kept.
    """

    row: PictureRow
    recommended: bool
    own: str | None
    differences: tuple[str | None, ...]


@dataclass(frozen=True, slots=True)
class LegendEntry:
    """One colour of the difference pictures."""

    name: str
    first: str
    last: str


def cards(measurement: Measurement, kept: Mapping[str, bytes], labels: Sequence[str]) -> list[Card]:
    """The slab pictures of settings: the recommended first, then those on the front, then others.

    Args:
        measurement: whose rows.
        kept: images that the page has room for.
        labels: of the settings that are recommended.
    """
    rows = [row for row in measurement.pictures if row.path == SLAB and row.differences]
    order = {False: len(labels) + 1, True: len(labels)}

    def rank(row: PictureRow) -> int:
        label = row.setting.label
        return labels.index(label) if label in labels else order[label in measurement.front]

    chosen = sorted(rows, key=rank)[:_CARDS_MAX]
    return [_card(row, kept, row.setting.label in labels) for row in chosen]


def other_paths(measurement: Measurement, kept: Mapping[str, bytes]) -> list[Card]:
    """Other ways to draw than by slabs, of which the difference is known."""
    rows = [row for row in measurement.pictures if row.path != SLAB and row.differences]
    return [card for card in (_card(row, kept, False) for row in rows) if any(card.differences)]


def by_importance(measurement: Measurement, labels: Sequence[str]) -> Iterator[str]:
    """Keys of the images that a page may show, those that it should keep first."""
    images = measurement.images
    shown = cards(measurement, images, labels)
    others = other_paths(measurement, images)
    wanted: list[str | None] = [f"view-{number}" for number in range(len(images))]
    wanted += [card.differences[0] for card in shown]
    wanted += [card.own for card in shown]
    wanted += [card.differences[0] for card in others]
    wanted += [key for card in shown for key in card.differences[1:]]
    for key in dict.fromkeys(wanted):
        if key is not None and key in images:
            yield key


def data_uri(png: bytes) -> str:
    """A PNG inside a page."""
    return "data:image/png;base64," + base64.b64encode(png).decode()


def size_of(png: bytes) -> tuple[int, int]:
    """(width, height) in pixels."""
    with Image.open(io.BytesIO(png)) as picture:
        return picture.size


def shares_text(png: bytes) -> str:
    """How many pixels of a difference picture have each colour; empty of another picture."""
    with Image.open(io.BytesIO(png)) as picture:
        if picture.mode != "P":
            return ""
        errors = np.asarray(picture)
    shares = zip(CLASSES, class_shares(errors), strict=True)
    return ", ".join(f"{kind.name}: {percent(share)}" for kind, share in shares if share)


def legend() -> list[LegendEntry]:
    """The colours of difference pictures, for the page."""
    return [LegendEntry(c.name, _css(c.first), _css(c.last)) for c in CLASSES]


def _card(row: PictureRow, kept: Mapping[str, bytes], recommended: bool) -> Card:
    differences = tuple(key if key in kept else None for key in row.differences)
    own = row.differences[0].removesuffix(_DIFFERENCE)
    return Card(row, recommended, own if own in kept else None, differences)


def _css(rgb: tuple[int, int, int]) -> str:
    return "#{:02x}{:02x}{:02x}".format(*rgb)
