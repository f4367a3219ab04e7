"""Errors of the renderer: a missing driver, and shaders that do not fit their program."""

from __future__ import annotations

from octobrick.codec.errors import OctobrickError, ResourceError


class GraphicsContextError(ResourceError):
    """No OpenGL 4.5 context could be made: install a driver, or use another machine."""

    kind = "no-graphics"


class PictureTooLargeError(ResourceError):
    """The view does not fit the memory budget or the driver's limits: ask for less."""

    kind = "view-too-large"


class ShaderError(OctobrickError):
    """A shader could not be put together or compiled: a bug of octobrick or of the driver."""

    kind = "shader"
