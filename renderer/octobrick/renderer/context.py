"""The OpenGL context: made through EGL without a display, owned by one renderer.

A context is current in one thread at a time. It is let go after every use, so that a renderer may
be called from any thread, one call at a time.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from octobrick.codec.errors import InvalidInputError, ResourceError
from octobrick.renderer.errors import GraphicsContextError, ShaderError
from octobrick.renderer.shader_source import Values, numbered, shader_source

if TYPE_CHECKING:
    import moderngl

GL_VERSION = 450
_HELP = (
    "On Debian or Ubuntu install libegl1, libgl1 and libgl1-mesa-dri for rendering on the CPU, or "
    "the driver of your GPU. Where several drivers are installed, __EGL_VENDOR_LIBRARY_FILENAMES "
    "or GLCONTEXT_DEVICE_INDEX choose one."
)


class GraphicsContext:
    """An OpenGL 4.5 context and the programs compiled in it.

    Raises:
        ResourceError: moderngl is not installed.
        GraphicsContextError: there is no EGL, no driver, or none that offers OpenGL 4.5; the
            message says what to install.
    """

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._programs: dict[tuple[str, frozenset[tuple[str, Any]]], moderngl.ComputeShader] = {}
        self._draw_programs: dict[tuple[str, frozenset[tuple[str, Any]]], moderngl.Program] = {}
        self._gl: moderngl.Context | None = _create()
        with self._gl:  # entered and left: no longer current in this thread
            info = self._gl.info
        self.renderer_name = str(info["GL_RENDERER"])
        self.vendor_name = str(info["GL_VENDOR"])
        self.picture_side_max = int(info["GL_MAX_TEXTURE_SIZE"])
        self.volume_side_max = int(info["GL_MAX_3D_TEXTURE_SIZE"])

    @property
    def software(self) -> bool:
        """True on Mesa's renderers on the CPU."""
        return any(name in self.renderer_name.lower() for name in ("llvmpipe", "softpipe"))

    @contextmanager
    def current(self) -> Iterator[moderngl.Context]:
        """The context, current in this thread until the block ends; other threads wait.

        Raises:
            InvalidInputError: the context was released.
        """
        with self._lock:
            if self._gl is None:
                raise InvalidInputError("this renderer is closed; make a new one")
            with self._gl as gl:
                yield gl

    def program(self, name: str, **values: str | int | bool) -> moderngl.ComputeShader:
        """A compute program, compiled on first use. Call it inside `current`.

        Raises:
            ShaderError: with the compiler's message and the numbered source.
        """
        key = (name, frozenset(values.items()))
        if key not in self._programs:
            self._programs[key] = self._compile(name, values)
        return self._programs[key]

    def draw_program(self, name: str, **fragment_values: str | int | bool) -> moderngl.Program:
        """A program that draws triangles, of NAME.vert.glsl, NAME.geom.glsl and NAME.frag.glsl.

        Compiled on first use. Call it inside `current`.

        Raises:
            ShaderError: as `program` does.
        """
        key = (name, frozenset(fragment_values.items()))
        if key not in self._draw_programs:
            vertex = shader_source(f"{name}.vert.glsl", {})
            geometry = shader_source(f"{name}.geom.glsl", {})
            fragment = shader_source(f"{name}.frag.glsl", fragment_values)
            assert self._gl is not None
            try:
                program = self._gl.program(
                    vertex_shader=vertex, geometry_shader=geometry, fragment_shader=fragment
                )
            except Exception as error:
                raise self._not_compiled(name, vertex + geometry + fragment, error) from error
            self._draw_programs[key] = program
        return self._draw_programs[key]

    def _compile(self, name: str, values: Values) -> moderngl.ComputeShader:
        source = shader_source(name, values)
        assert self._gl is not None
        try:
            return self._gl.compute_shader(source)
        except Exception as error:  # moderngl.Error, which need not be importable here
            raise self._not_compiled(name, source, error) from error

    def _not_compiled(self, name: str, source: str, error: Exception) -> ShaderError:
        return ShaderError(
            f"shader {name} did not compile on {self.renderer_name}: {error}\n{numbered(source)}",
            shader=name,
            gl_renderer=self.renderer_name,
        )

    def release(self) -> None:
        """Free the context and all that lives in it. Idempotent."""
        with self._lock:
            if self._gl is None:
                return
            with self._gl as gl:
                for program in self._programs.values():
                    program.release()
                for drawing in self._draw_programs.values():
                    drawing.release()
            self._programs.clear()
            self._draw_programs.clear()
            gl.release()
            self._gl = None


def _create() -> moderngl.Context:
    try:
        import moderngl
    except ImportError as error:
        raise ResourceError(
            "rendering needs moderngl, which is not installed: pip install 'octobrick[render]'",
            package="moderngl",
        ) from error
    try:
        # By soname where the libraries' names cannot be looked up: a container without ldconfig.
        settings: dict[str, Any] = {
            "backend": "egl",
            "libgl": "libGL.so.1",
            "libegl": "libEGL.so.1",
        }
        return moderngl.create_standalone_context(require=GL_VERSION, **settings)
    except Exception as error:  # glcontext raises bare Exceptions
        raise GraphicsContextError(
            f"no OpenGL {GL_VERSION // 100}.{GL_VERSION // 10 % 10} context through EGL: {error}. "
            f"{_HELP}",
            reason=str(error),
        ) from error
