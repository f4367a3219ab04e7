"""Pictures of one part of a volume, stored and drawn in every way, beside the truest of them."""

from octobrick.measure.pictures.difference_picture import difference_picture
from octobrick.measure.pictures.sweep import PictureOptions, PictureResult, sweep_pictures
from octobrick.measure.pictures.views import DEFAULT_VIEWS, ViewChoice

__all__ = [
    "DEFAULT_VIEWS",
    "PictureOptions",
    "PictureResult",
    "ViewChoice",
    "difference_picture",
    "sweep_pictures",
]
