"""The textures that a picture is gathered in: premultiplied colour and depth, in float32."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from octobrick.renderer.context import GraphicsContext
from octobrick.renderer.image import Background
from octobrick.renderer.uniforms import run_over, set_uniforms

if TYPE_CHECKING:
    import moderngl

PICTURE_IMAGE: Final = 0
DEPTH_IMAGE: Final = 1


class Canvas:
    """A picture in the making, kept between frames of one size.

    Args:
        context: where the textures live.
        gl: the same, current in this thread.
    """

    def __init__(self, context: GraphicsContext, gl: moderngl.Context) -> None:
        self._context = context
        self._gl = gl
        self._size = (0, 0)
        self._picture: moderngl.Texture | None = None
        self._finished: moderngl.Texture | None = None
        self._depth: moderngl.Texture | None = None
        self._clearers: list[moderngl.Framebuffer] = []

    def begin(self, size: tuple[int, int], before: float, *, depth: bool) -> None:
        """An empty picture: `before` in all four components, and no depth."""
        if size != self._size:
            self.release()
            self._size = size
            self._picture = self._gl.texture(size, 4, dtype="f4")
            self._finished = self._gl.texture(size, 4, dtype="f1")
            self._clearers.append(self._gl.framebuffer(color_attachments=[self._picture]))
        if depth and self._depth is None:
            self._depth = self._gl.texture(size, 1, dtype="f4")
            self._clearers.append(self._gl.framebuffer(color_attachments=[self._depth]))
        self._clearers[0].clear(before, before, before, before)
        if depth:
            self._clearers[1].clear(float("inf"))

    @property
    def framebuffer(self) -> moderngl.Framebuffer:
        """The picture as a target to draw on; its rows are in the order of the picture's."""
        return self._clearers[0]

    def bind(self, *, depth: bool) -> None:
        """Let shaders read and write the picture, and write the depth."""
        assert self._picture is not None
        self._picture.bind_to_image(PICTURE_IMAGE, read=True, write=True)
        if depth:
            assert self._depth is not None
            self._depth.bind_to_image(DEPTH_IMAGE, read=False, write=True)

    def finished(self, background: Background) -> NDArray[np.uint8]:
        """(height, width, 4) with straight alpha, top row first, over a background if any."""
        assert self._picture is not None
        assert self._finished is not None
        program = self._context.program("finish.comp.glsl")
        self._picture.bind_to_image(0, read=True, write=False)
        self._finished.bind_to_image(1, read=False, write=True)
        set_uniforms(
            program,
            {
                "picture_size": self._size,
                "background": background or (0.0, 0.0, 0.0),
                "over_background": background is not None,
            },
        )
        run_over(program, (*self._size, 1))
        self._gl.memory_barrier()
        return self._read(self._finished, 4, np.dtype(np.uint8))

    def picture(self) -> NDArray[np.float32]:
        """What was gathered: (height, width, 4), top row first, premultiplied."""
        assert self._picture is not None
        return self._read(self._picture, 4, np.dtype(np.float32))

    def depth(self) -> NDArray[np.float32]:
        """World distance from the eye's plane to what is seen: (height, width); inf for nothing."""
        assert self._depth is not None
        return self._read(self._depth, 1, np.dtype(np.float32))[..., 0]

    def release(self) -> None:
        """Free all textures."""
        for thing in (*self._clearers, self._picture, self._finished, self._depth):
            if thing is not None:
                thing.release()
        self._clearers.clear()
        self._picture = self._finished = self._depth = None
        self._size = (0, 0)

    def _read(
        self, texture: moderngl.Texture, components: int, dtype: np.dtype[Any]
    ) -> NDArray[Any]:
        width, height = self._size
        out = np.empty((height, width, components), dtype)
        texture.read_into(out, alignment=1)
        return out
