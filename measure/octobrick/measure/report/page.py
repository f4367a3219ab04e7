"""Puts plots, pictures and tables of a measurement into one page that needs nothing else."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Mapping
from importlib import resources
from typing import Any, Final

from octobrick.measure.measurement import CodeRow, Measurement
from octobrick.measure.report import code_plots, gallery, numbers, picture_plots
from octobrick.measure.report.theme import styles_of
from octobrick.renderer.picture_files import required

REPORT_NBYTES_MAX: Final = 5_000_000
"""Of a page: what mail takes, and what a phone opens at once."""
_TAG_NBYTES: Final = 400  # around an image: its element and what is said of it
_DISTRIBUTIONS_MAX: Final = 6  # curves of one plot


def report_html(measurement: Measurement) -> str:
    """A page about a measurement: one file, below 5 MB, that asks for nothing over the network.

    Equal measurements give equal pages. All text from outside is escaped, and a policy in the page
    forbids every script but its own, and all requests. Where pictures are too large together, the
    least important are left out, and the page says how many.

    Not from several threads at once, as matplotlib writes the plots.

    Raises:
        ResourceError: jinja2, matplotlib or Pillow is not installed.
    """
    context = _context(measurement)
    labels = code_plots.recommended_labels(measurement)
    bare = _page(context | _pictures(measurement, {}, labels))
    room = REPORT_NBYTES_MAX - len(bare.encode())
    kept: dict[str, bytes] = {}
    ndropped = 0
    for key in gallery.by_importance(measurement, labels):
        png = measurement.images[key]
        room -= 4 * -(-len(png) // 3) + _TAG_NBYTES
        if room > 0:
            kept[key] = png
        else:
            ndropped += 1
    return _page(context | _pictures(measurement, kept, labels) | {"ndropped": ndropped})


def _context(measurement: Measurement) -> dict[str, Any]:
    """All that the page shows but pictures."""
    chosen = _chosen(measurement)
    # One colour for a setting, in the plot of its errors and in the legend beside it.
    chosen_styles = styles_of(row.setting.label for row in chosen)
    return {
        "m": measurement,
        "title": numbers.fact_text(measurement.source.get("name", "a volume")),
        "recommended": code_plots.recommended_labels(measurement),
        "families": code_plots.family_styles(measurement),
        "chosen_styles": chosen_styles,
        "path_styles": picture_plots.path_styles(measurement),
        "setting_styles": picture_plots.setting_styles(measurement),
        "level_styles": styles_of(picture_plots.level_curves(measurement)),
        "plots": {
            "disk": code_plots.rate_distortion(measurement, "disk_bits"),
            "resident": code_plots.rate_distortion(measurement, "resident_bits"),
            "max_error": code_plots.error_against_bits(measurement),
            "distribution": code_plots.error_distribution(chosen, chosen_styles),
            "rates": code_plots.coding_rates(code_plots.by_family(measurement)),
            "quality_time": picture_plots.quality_against_time(measurement),
            "levels": picture_plots.error_against_level(measurement),
        },
        "facts": {
            name: (list(numbers.facts(values)), list(numbers.tables(values)))
            for name, values in (
                ("Source", measurement.source),
                ("Sample", measurement.sample),
                ("Options", measurement.options),
                ("Machine", measurement.machine),
            )
        },
        "codes": code_plots.by_family(measurement),
        "ndropped": 0,
    }


def _chosen(measurement: Measurement) -> list[CodeRow]:
    """Lossy settings whose errors are shown: the recommended, then those on the front."""
    labels = code_plots.recommended_labels(measurement)
    rows = [row for row in measurement.codes if row.max_error > 0]
    first = [row for row in rows if row.setting.label in labels]
    front = [row for row in rows if row.setting.label in measurement.front and row not in first]
    return (first + front or rows)[:_DISTRIBUTIONS_MAX]


def _pictures(
    measurement: Measurement, kept: Mapping[str, bytes], labels: tuple[str, ...]
) -> dict[str, Any]:
    """Pictures that there is room for, and what is said of them."""
    shown = gallery.cards(measurement, kept, labels)
    return {
        "cards": [card for card in shown if any(card.differences)],
        "others": gallery.other_paths(measurement, kept),
        "legend": gallery.legend(),
        "images": {
            key: {
                "uri": gallery.data_uri(png),
                "size": gallery.size_of(png),
                "shares": gallery.shares_text(png) if key.endswith("-difference") else "",
            }
            for key, png in kept.items()
        },
    }


def _page(context: Mapping[str, Any]) -> str:
    jinja2: Any = required("jinja2", "jinja2", "a report", "measure")
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {
        "db": numbers.decibels,
        "digits": numbers.digits,
        "ms": numbers.milliseconds,
        "mega": numbers.per_second,
    }
    script = _part("page.js")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    page = environment.from_string(_part("page.html")).render(
        **context, css=_part("page.css"), script=script, script_digest=digest
    )
    assert isinstance(page, str)
    return page


def _part(name: str) -> str:
    return resources.files("octobrick.measure.report").joinpath(name).read_text("utf-8")
