"""Colours and marks of the plots, which the page turns into its own for light and dark.

matplotlib wants numbers; the page wants names. So plots are drawn in stand-ins that occur nowhere
else, and `svg.py` puts the page's variables in their place.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

INK: Final = "#010101"
MUTED: Final = "#020202"
GRID: Final = "#030303"
PAPER: Final = "#040404"
_NSERIES: Final = 8
_SERIES: Final = tuple(f"#0a00{number:02x}" for number in range(1, _NSERIES + 1))
"""As many colours as people with any colour vision tell apart; marks differ too."""

VARIABLES: Final = {
    INK: "var(--ink)",
    MUTED: "var(--muted)",
    GRID: "var(--grid)",
    PAPER: "var(--paper)",
    **{color: f"var(--series-{number})" for number, color in enumerate(_SERIES, 1)},
}
"""What the page calls each stand-in."""

_MARKS: Final = {
    "o": '<circle cx="8" cy="8" r="4.5"/>',
    "s": '<rect x="4" y="4" width="8" height="8"/>',
    "^": '<path d="M8 3 13 12.5H3z"/>',
    "D": '<path d="M8 2.5 13.5 8 8 13.5 2.5 8z"/>',
    "v": '<path d="M8 13 3 3.5h10z"/>',
    "<": '<path d="M3 8 12.5 3v10z"/>',
    ">": '<path d="M13 8 3.500 3v10z"/>',
    "P": '<path d="M6 3h4v3h3v4h-3v3H6v-3H3V6h3z"/>',
    "X": '<path d="M3 5.5 5.5 3 8 5.5 10.500 3 13 5.500 10.500 8 13 10.500 10.500 13 8 10.500'
    ' 5.500 13 3 10.500 5.500 8z"/>',
}


@dataclass(frozen=True, slots=True)
class Style:
    """How one series is drawn.

    Attributes:
        color: the stand-in, for matplotlib.
        marker: matplotlib's name of the mark.
    """

    color: str
    marker: str

    @property
    def variable(self) -> str:
        """The colour as the page names it."""
        return VARIABLES[self.color]

    @property
    def mark_svg(self) -> str:
        """The mark in the page's colour, for a legend: safe HTML."""
        return (
            '<svg class="mark" viewBox="0 0 16 16" aria-hidden="true" '
            f'style="fill: {self.variable}">{_MARKS[self.marker]}</svg>'
        )


def styles_of(names: Iterable[str]) -> dict[str, Style]:
    """A style for each name, in the order in which they first come.

    There are eight colours and nine marks, so that a colour that returns has another mark, and each
    way to draw has a mark of its own.
    """
    marks = tuple(_MARKS)
    return {
        name: Style(_SERIES[i % _NSERIES], marks[i % len(marks)])
        for i, name in enumerate(dict.fromkeys(names))
    }
