"""Pictures of volumes larger than memory, without a screen.

The names listed in ``__all__`` are the component's promise; everything else may change.
"""

from octobrick.renderer.annotations import with_legend, with_scale_bar
from octobrick.renderer.brick_source import BlockCode, BrickSource, SourceLevel
from octobrick.renderer.camera import Camera
from octobrick.renderer.camera_path import camera_path
from octobrick.renderer.clip import Clip
from octobrick.renderer.errors import GraphicsContextError, PictureTooLargeError, ShaderError
from octobrick.renderer.framing import visible_bounds
from octobrick.renderer.image import Fidelity, RenderedImage, RenderStats
from octobrick.renderer.lighting import Light, Lighting
from octobrick.renderer.modes import Compositing, Isosurface, Projection, Slice
from octobrick.renderer.movie import Shot, render_frames, through_time, turntable
from octobrick.renderer.movie_files import movie_file, save_movie
from octobrick.renderer.renderer import Renderer
from octobrick.renderer.streaming import frames, play
from octobrick.renderer.transfer_function import TransferFunction
from octobrick.renderer.working_set import WorkingSet, select

__all__ = [
    "BlockCode",
    "BrickSource",
    "Camera",
    "Clip",
    "Compositing",
    "Fidelity",
    "GraphicsContextError",
    "Isosurface",
    "Light",
    "Lighting",
    "PictureTooLargeError",
    "Projection",
    "RenderStats",
    "RenderedImage",
    "Renderer",
    "ShaderError",
    "Shot",
    "Slice",
    "SourceLevel",
    "TransferFunction",
    "WorkingSet",
    "camera_path",
    "frames",
    "movie_file",
    "play",
    "render_frames",
    "save_movie",
    "select",
    "through_time",
    "turntable",
    "visible_bounds",
    "with_legend",
    "with_scale_bar",
]
