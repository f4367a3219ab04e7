"""The exchange rate of accuracy, size and speed, measured on a user's own data.

The names listed in ``__all__`` are the component's promise; everything else may change.
"""

from octobrick.measure.measurement import (
    CodeRow,
    LevelRow,
    Measurement,
    PictureRow,
    Recommendation,
    Setting,
)
from octobrick.measure.progress import MeasureProgress
from octobrick.measure.run import measure

__all__ = [
    "CodeRow",
    "LevelRow",
    "MeasureProgress",
    "Measurement",
    "PictureRow",
    "Recommendation",
    "Setting",
    "measure",
]
