"""How far each promise of octobrick holds, found by searching on this machine.

The names listed in ``__all__`` are the package's promise; everything else may change.
"""

from octobrick.measure.extremes.report import COLUMNS, stress, table_rows, to_dict
from octobrick.measure.extremes.stress_row import StressRow

__all__ = ["COLUMNS", "StressRow", "stress", "table_rows", "to_dict"]
