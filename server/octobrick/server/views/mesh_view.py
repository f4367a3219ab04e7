"""A picture of a mesh in its solid texture, in the words of a :class:`View`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from octobrick.codec.errors import InvalidInputError
from octobrick.server.views.view import View

if TYPE_CHECKING:
    from octobrick.renderer import Camera, RenderedImage, Renderer, TransferFunction
    from octobrick.store import Mesh, Placement, Volume

# Fields of a view that say how rays go through a volume, which a surface has no use for.
_OF_RAYS = (
    *("mode", "iso", "iso_opacity", "slice_normal", "slice_point", "gradients", "edges"),
    *("deblocking", "clip_box", "clip_planes", "step_voxels", "depth", "legend"),
)


@dataclass(frozen=True, slots=True)
class MeshView:
    """A view of a mesh instead of the volume that is its texture.

    Args:
        view: camera, size, light and colours.
        mesh: what is drawn.
        placement: where it lies; None for what the volume says, or fits.
        up: which of its axes is then the world's z.
        sampling: of the texture, "linear" or "nearest".

    Raises:
        InvalidInputError: the view asks for something that only rays through a volume have.
    """

    view: View
    mesh: Mesh
    placement: Placement | None = None
    up: Any = "z"
    sampling: str = "linear"

    def __post_init__(self) -> None:
        usual = View()
        for name in _OF_RAYS:
            if getattr(self.view, name) != getattr(usual, name):
                raise InvalidInputError(
                    f"{name}: is that of rays through a volume, not of a surface; leave it out",
                    field=name,
                )

    def render(self, renderer: Renderer, volume: Volume) -> RenderedImage:
        """The picture. Only for the thread that made the renderer.

        Raises:
            InvalidInputError: what makes no sense for this volume.
            OctobrickError: of the store or the renderer.
        """
        from octobrick.renderer import Lighting, with_scale_bar

        view, function = self.view, self._function(volume)
        placement = self._placement(volume)
        camera = self._camera(volume, placement)
        image = renderer.render_mesh(
            volume,
            self.mesh,
            camera,
            view.size,
            placement=placement,
            sampling=self.sampling,
            transfer_function=function,
            window=view.window,
            shading=Lighting(lights=view.lights) if view.lights else view.shading,
            background=view.background,
            level=view.level,
            t=view.t,
            c=view.channels if function is not None or view.channels != 0 else None,
        )
        return with_scale_bar(image, camera, volume.unit) if view.scale_bar else image

    def warning(self, volume: Volume) -> str | None:
        """What is not as it should be about this mesh in this volume; None if nothing."""
        surface = volume.surface
        if surface is None or surface.digest == self.mesh.digest:
            return None
        return (
            f"{volume.name} holds what {surface.name} touches, which is another surface than "
            f"{self.mesh.name}; where they differ, the texture may be black"
        )

    def _function(self, volume: Volume) -> TransferFunction | None:
        """Of a texture that is a single channel of values."""
        function = self.view.transfer_function
        if function is None and volume.nc < 3:
            function = self.view.functions(volume)
        return function[0] if isinstance(function, tuple) else function

    def _placement(self, volume: Volume) -> Placement:
        from octobrick.renderer.solid_texture.mesh_request import placement_in

        return placement_in(volume, self.mesh, self.placement, self.up)

    def _camera(self, volume: Volume, placement: Placement) -> Camera:
        from octobrick.renderer import Camera

        view = self.view
        if view.own_camera is not None:
            return view.turned(view.own_camera, volume)
        bounds = None
        if view.fit == "visible":
            places = placement.places(self.mesh.vertices_xyz)
            bounds = (places.min(axis=0), places.max(axis=0))
        camera = Camera.orbit(
            volume, view.azimuth, view.elevation, view.distance, view.fov, bounds=bounds
        )
        if view.projection == "orthographic":
            camera = camera.orthographic()
        return view.turned(camera, volume)
