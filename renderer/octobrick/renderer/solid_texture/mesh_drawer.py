"""Draws a mesh: chooses the texture's level, keeps its tiles and the triangles on the GPU."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from octobrick.renderer.canvas import Canvas
from octobrick.renderer.classifier import TABLE_ENTRIES
from octobrick.renderer.context import GraphicsContext
from octobrick.renderer.errors import PictureTooLargeError
from octobrick.renderer.raycaster import light_uniforms
from octobrick.renderer.selection import finest_useful_level
from octobrick.renderer.solid_texture.mesh_request import MeshRequest
from octobrick.renderer.solid_texture.texture_atlas import AtlasLayout, TextureAtlas
from octobrick.renderer.solid_texture.texture_tiles import BORDER, TILE, touched_tiles
from octobrick.renderer.uniforms import set_uniforms
from octobrick.renderer.view import View, make_view
from octobrick.store.surface.selection import DILATION_VOXELS, voxel_places

if TYPE_CHECKING:
    import moderngl

SAMPLES: Final = 4
"""Per pixel, at the edges of triangles; each pixel takes the texture once for each triangle."""
FUNCTION_UNIT: Final = 2
_NEAR_SHARE: Final = 1e-4
"""Of the farthest depth: nearer triangles are cut, or far ones would not be told apart."""
_SLACK: Final = 1e-3
_WITHOUT_TEXTURE: Final = (0.5, 0.5, 0.5)


class MeshDrawer:
    """Draws meshes, and keeps what the last of them needs.

    Args:
        context: where everything lives.
        gl: the same, current in this thread.
        budget_nbytes: of the texture.
        tile: texels along each side of a tile; another only to measure what tiles cost.
    """

    def __init__(
        self, context: GraphicsContext, gl: moderngl.Context, budget_nbytes: int, tile: int = TILE
    ) -> None:
        self._context, self._gl = context, gl
        self._budget_nbytes, self._tile = budget_nbytes, tile
        self._canvas = Canvas(context, gl)
        self._atlas: TextureAtlas | None = None
        self._atlas_key: tuple[Any, ...] = ()
        self._buffers: list[moderngl.Buffer] = []
        self._buffers_key: tuple[Any, ...] = ()
        self._targets: list[Any] = []
        self._targets_size = (0, 0)
        self.uploaded_nbytes = 0

    @property
    def canvas(self) -> Canvas:
        """What the last picture was drawn on."""
        return self._canvas

    def texture(self, request: MeshRequest) -> TextureAtlas:
        """The tiles that a picture needs, loaded if they are not there.

        Raises:
            PictureTooLargeError: they do not fit the budget, even at the coarsest level.
        """
        wanted = request.level
        if wanted is None:
            wanted = finest_useful_level(request.volume, request.camera, request.size)
        key = (
            *(request.volume.revision, request.t, request.channels, request.windows),
            *(request.function is None, request.mesh.digest, request.placement),
            *(wanted, request.level is None),
        )
        if self._atlas is None or key != self._atlas_key:
            self.forget()
            self._atlas = self._load(request, wanted)
            self._atlas_key = key
            self.uploaded_nbytes += self._atlas.nbytes
        self._atlas.sample_by(self._gl, request.sampling)
        return self._atlas

    def draw(self, request: MeshRequest) -> None:
        """Draw on the canvas."""
        atlas = self.texture(request)
        view = make_view(request.camera, request.size, request.volume.levels[0])
        self._canvas.begin(request.size, 0.0, depth=False)
        depths = self._depths(request, view)
        if depths is None:
            return  # all of it lies behind the eye
        self._upload(request)
        program = self._context.draw_program(
            "solid_texture",
            TILE=self._tile,
            BORDER=BORDER,
            LINEAR=request.sampling == "linear",
            FUNCTION=request.function is not None,
            LIT=request.lighting is not None,
            ENTRIES=TABLE_ENTRIES,
        )
        uniforms = atlas.use() | self._uniforms(request, view, depths, 2.0**-atlas.tiles.level)
        function = self._function(request)
        if function is not None:
            function.use(FUNCTION_UNIT)
            uniforms["function"] = FUNCTION_UNIT
        set_uniforms(program, uniforms, some_unused=True)
        values: list[tuple[Any, ...]] = [(self._buffers[0], "3f4 3f4", "place_finest", "normal")]
        if request.lighting is None:  # the compiler leaves normals out
            values = [(self._buffers[0], "3f4 3x4", "place_finest")]
        shape = self._gl.vertex_array(program, values, self._buffers[1])
        try:
            self._rasterise(request, shape)
        finally:
            shape.release()
            if function is not None:
                function.release()

    def forget(self) -> None:
        """Free the texture."""
        if self._atlas is not None:
            self._atlas.release()
            self._atlas = None

    def release(self) -> None:
        """Free everything."""
        self.forget()
        for thing in (*self._buffers, *self._targets):
            thing.release()
        self._buffers, self._targets = [], []
        self._buffers_key, self._targets_size = (), (0, 0)
        self._canvas.release()

    def _load(self, request: MeshRequest, wanted: int) -> TextureAtlas:
        levels = (
            [wanted] if request.level is not None else range(wanted, len(request.volume.levels))
        )
        nbytes = 0
        for level in levels:
            tiles = touched_tiles(
                request.volume, request.mesh, request.placement, level, self._tile
            )
            layout = AtlasLayout.of(tiles, self._context.volume_side_max)
            nbytes = 0 if layout is None else layout.nbytes
            if layout is not None and nbytes <= self._budget_nbytes:
                return TextureAtlas(self._gl, request, tiles, layout)
        raise PictureTooLargeError(
            f"the tiles that the surface touches take {nbytes or 'more than the driver allows'} "
            f"bytes at level {level}, and {self._budget_nbytes} may be used; raise memory_budget "
            "or render a coarser level",
            level=level,
            nbytes=nbytes,
        )

    def _upload(self, request: MeshRequest) -> None:
        """Places in voxels of level 0 (x, y, z) and world normals, and the faces."""
        key = (request.volume.revision, request.mesh.digest, request.placement)
        if key != self._buffers_key:
            for buffer in self._buffers:
                buffer.release()
            mesh, spacing_xyz = request.mesh, request.volume.levels[0].spacing_xyz
            places = voxel_places(mesh, request.placement, spacing_xyz[::-1], 0)[:, ::-1]
            normals = request.placement.normals(mesh.normals_xyz)
            vertices = np.hstack([places, normals]).astype(np.float32)
            self._buffers = [self._gl.buffer(vertices), self._gl.buffer(mesh.faces)]
            self._buffers_key = key

    def _depths(self, request: MeshRequest, view: View) -> tuple[float, float] | None:
        """Nearest and farthest depth in front of the eye; None where nothing is."""
        low, high = request.mesh.bounds_xyz
        corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)])
        places = request.placement.places(low + corners * (high - low))
        depths = view.depth_world(places)
        near, far = float(depths.min()), float(depths.max())
        slack = _SLACK * max(far - near, abs(far))
        far += slack
        if far <= 0:
            return None
        return max(near - slack, _NEAR_SHARE * far if view.eye_world_is_point else 0.0), far

    def _uniforms(
        self, request: MeshRequest, view: View, depths: tuple[float, float], scale: float
    ) -> dict[str, Any]:
        finest = request.volume.levels[0]
        spacing = np.array(finest.spacing_xyz)
        # The place of a fragment from the eye, in world units, from its place in voxels.
        from_eye = np.array(finest.origin_xyz) - spacing / 2 - view.eye_world
        uniforms = {
            "to_clip": _to_clip(view, spacing, from_eye, depths),
            "level_scale": scale,
            "outside_voxels": DILATION_VOXELS,
            "without_texture": _WITHOUT_TEXTURE,
            "voxel_world": spacing,
            "first_from_eye_world": from_eye,
            "forward_world": view.forward_world,
            "is_perspective": view.eye_world_is_point,
        }
        if request.lighting is not None:
            uniforms |= light_uniforms(request.lighting)
        return uniforms

    def _function(self, request: MeshRequest) -> moderngl.Texture | None:
        if request.function is None:
            return None
        (window,) = request.windows
        low, high = request.function.value_domain(window)
        table = request.function.table(TABLE_ENTRIES, opacity=1.0)
        # Its ends in parts of the window: what the texture holds.
        width = window[1] - window[0]
        places = np.linspace(0, 1, TABLE_ENTRIES) * width + window[0]
        at = np.clip((places - low) / max(high - low, 1e-30), 0, 1) * (TABLE_ENTRIES - 1)
        entries = np.stack(
            [np.interp(at, np.arange(TABLE_ENTRIES), table[:, i]) for i in range(4)], axis=1
        ).astype(np.float32)
        # A row for each 1024 entries: no driver needs to take longer ones.
        texture = self._gl.texture((1024, -(-TABLE_ENTRIES // 1024)), 4, entries, dtype="f4")
        texture.filter = (self._gl.NEAREST, self._gl.NEAREST)
        return texture

    def _rasterise(self, request: MeshRequest, shape: moderngl.VertexArray) -> None:
        if self._targets_size != request.size:
            for thing in self._targets:
                thing.release()
            colour = self._gl.renderbuffer(request.size, 4, samples=SAMPLES, dtype="f4")
            depth = self._gl.depth_renderbuffer(request.size, samples=SAMPLES)
            self._targets = [self._gl.framebuffer([colour], depth), colour, depth]
            self._targets_size = request.size
        target = self._targets[0]
        target.use()
        target.clear(0.0, 0.0, 0.0, 0.0, depth=1.0)
        self._gl.enable_only(self._gl.DEPTH_TEST)
        shape.render(self._gl.TRIANGLES)
        self._gl.enable_only(self._gl.NOTHING)
        self._gl.copy_framebuffer(self._canvas.framebuffer, target)


def _to_clip(
    view: View,
    voxel_world: NDArray[np.float64],
    from_eye: NDArray[np.float64],
    depths: tuple[float, float],
) -> list[float]:
    """From voxels of level 0 to clip space, 4×4 by columns as GLSL has them.

    x and y grow to the right and downwards (pictures are read from their first row), both divided
    by the size of a pixel at that depth; z from -1 at the nearest to 1 at the farthest depth.
    """
    (width, height), (base, slope), (near, far) = view.size, view.pixel_size, depths
    sizes = np.array([base + slope * near, base + slope * far])
    z_slope = (sizes[0] + sizes[1]) / (far - near)
    rows = np.zeros((4, 4))
    for row, vector in enumerate(
        (
            2 / width * view.right_world,
            -2 / height * view.up_world,
            z_slope * view.forward_world,
            slope * view.forward_world,
        )
    ):
        rows[row, :3] = vector * voxel_world
        rows[row, 3] = vector @ from_eye
    rows[2, 3] += -sizes[0] - z_slope * near
    rows[3, 3] += base
    return [float(number) for number in rows.T.ravel()]
