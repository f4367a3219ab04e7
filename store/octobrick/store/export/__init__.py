"""A region of a volume at one level, as a file that other programs open.

Heavy packages are imported by the writers that need them, when they run.
"""

from octobrick.store.export.formats import EXPORT_SUFFIXES
from octobrick.store.export.result import ExportResult
from octobrick.store.export.run import export

__all__ = ["EXPORT_SUFFIXES", "ExportResult", "export"]
