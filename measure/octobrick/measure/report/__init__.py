"""One self-contained page about a measurement: plots, pictures and tables, without a network."""

from octobrick.measure.report.page import REPORT_NBYTES_MAX, report_html

__all__ = ["REPORT_NBYTES_MAX", "report_html"]
