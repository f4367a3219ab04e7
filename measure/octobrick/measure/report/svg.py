"""A matplotlib figure as SVG inside a page: no ids that clash, no fonts, the page's colours."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from html import escape
from typing import TYPE_CHECKING, Any, Final

from octobrick.measure.report.theme import GRID, INK, MUTED, VARIABLES
from octobrick.renderer.picture_files import required

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH_INCHES: Final = 4.9
"""Small, so that text is legible on a phone, where a figure is as wide as the screen."""
FONT_POINTS: Final = 9.5
_SMALL_POINTS: Final = 8.5
_FEW_DECADES: Final = 3e3


def new_figure(
    x_label: str, y_label: str, *, height_inches: float = 3.5, grid: str = "both"
) -> tuple[Figure, Axes]:
    """A figure with one pair of axes, in the style of the page.

    Raises:
        ResourceError: matplotlib is not installed.
    """
    module: Any = required("matplotlib.figure", "matplotlib", "a report's plots", "measure")
    figure: Figure = module.Figure(figsize=(WIDTH_INCHES, height_inches), layout="constrained")
    axes = figure.subplots()
    axes.set_xlabel(plain(x_label), color=INK, fontsize=FONT_POINTS)
    axes.set_ylabel(plain(y_label), color=INK, fontsize=FONT_POINTS)
    axes.tick_params(which="both", colors=MUTED, labelsize=_SMALL_POINTS, length=0)
    axes.set_facecolor("none")
    axes.set_axisbelow(True)
    axes.grid(visible=True, axis=grid, color=GRID, linewidth=0.7)  # type: ignore[arg-type]
    for side, spine in axes.spines.items():
        spine.set_visible(side == "bottom")
        spine.set_color(MUTED)
    return figure, axes


def readable_log(axis: Any) -> None:
    """Numbers at 1, 2 and 5 of each decade, or at its beginning only where there are many."""

    def number(value: float, _: object) -> str:
        low, high = axis.get_view_interval()
        begins = f"{value:.0e}".startswith("1")
        return f"{value:g}" if begins or high / low < _FEW_DECADES else ""

    ticker: Any = required("matplotlib.ticker", "matplotlib", "a report's plots", "measure")
    axis.set_major_locator(ticker.LogLocator(10, subs=(1.0, 2.0, 5.0), numticks=12))
    axis.set_major_formatter(number)
    axis.set_minor_formatter(ticker.NullFormatter())


def plain(text: str) -> str:
    """Text in which matplotlib finds no formulas."""
    return text.replace("$", r"\$")


def inline_svg(figure: Figure, name: str, label: str, titles: Mapping[str, str]) -> str:
    """The figure as an ``<svg>`` element, equal for equal figures.

    Not from several threads at once: matplotlib keeps what it salts ids with in one place, which is
    changed while the figure is written.

    Args:
        figure: what is drawn; text is escaped.
        name: of the figure, unique in the page.
        label: what it shows, for those who do not see it.
        titles: by gid of an artist, what is shown when it is pointed at.
    """
    matplotlib: Any = required("matplotlib", "matplotlib", "a report's plots", "measure")
    stream = io.BytesIO()
    nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    with matplotlib.rc_context({"svg.hashsalt": name, "svg.fonttype": "none"}):
        figure.savefig(stream, format="svg", facecolor="none", metadata=nothing)
    text = stream.getvalue().decode()
    text = text[text.index("<svg") :].strip()
    text = re.sub(r"<defs>\s*<style.*?</style>\s*</defs>", "", text, flags=re.S)
    text = re.sub(r"font-family: [^;\"]*;?", "", text)
    for gid, title in titles.items():
        text = text.replace(f'<g id="{gid}">', f"<g><title>{escape(title)}</title>")
    text = _own_ids(text, name)
    for stand_in, variable in VARIABLES.items():
        text = text.replace(stand_in, variable)
    head = re.match(r'<svg[^>]*viewBox="([^"]*)"[^>]*>', text, flags=re.S)
    assert head is not None
    opened = f'<svg class="plot" viewBox="{head[1]}" role="img" aria-label="{escape(label)}">'
    return opened + text[head.end() :]


def _own_ids(text: str, name: str) -> str:
    """Only ids that are referred to, and these with the figure's name."""
    used = set(re.findall(r'(?:url\(#|href="#)([^)"]+)', text))
    text = re.sub(r' id="([^"]*)"', lambda m: f' id="{name}-{m[1]}"' if m[1] in used else "", text)
    text = re.sub(r'xlink:href="#', f'href="#{name}-', text)
    return re.sub(r"url\(#", f"url(#{name}-", text)
