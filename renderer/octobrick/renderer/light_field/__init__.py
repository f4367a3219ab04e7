"""Pictures of light fields: what an eye sees between the cameras that took the views."""

from octobrick.renderer.light_field.eye import INTERPOLATIONS, Eye, Interpolation, eye_path
from octobrick.renderer.light_field.light_field import LightField
from octobrick.renderer.light_field.view_cache import ViewSource

__all__ = ["INTERPOLATIONS", "Eye", "Interpolation", "LightField", "ViewSource", "eye_path"]
