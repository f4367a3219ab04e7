"""Which surface an ingest keeps the cells of, and what goes together with that."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from octobrick.codec import Zerobit
from octobrick.codec.errors import InvalidInputError
from octobrick.store.box import Zyx
from octobrick.store.brick_codec import BrickCodec, codec_text
from octobrick.store.surface.mesh import Mesh
from octobrick.store.surface.mesh_file import read_mesh
from octobrick.store.surface.placement import Placement, UpAxis
from octobrick.store.surface.selection import SurfaceSelection


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceOption:
    """A surface, and where it is to lie.

    Args:
        mesh: the surface.
        placement: where it lies; None fits it into the volume.
        up: which of its axes then becomes the world's z.
    """

    mesh: Mesh
    placement: Placement | None = None
    up: UpAxis = "z"

    def selection(
        self, shapes_zyx: Sequence[Zyx], spacing_zyx: Sequence[float], brick: int
    ) -> SurfaceSelection:
        """The cells that it touches.

        Raises:
            InvalidInputError: none, or its placement makes no sense.
        """
        placement = self.placement
        if placement is None:
            low, high = volume_bounds(shapes_zyx[0], spacing_zyx)
            placement = Placement.fitted(self.mesh, low, high, self.up)
        return SurfaceSelection.of(self.mesh, placement, shapes_zyx, spacing_zyx, brick)

    def codec_of(self, codec: BrickCodec) -> BrickCodec:
        """The codec, which makes null cells 0.

        Raises:
            InvalidInputError: it knows no cells, or has another background.
        """
        if codec is None:
            return None
        if not isinstance(codec, Zerobit):
            raise InvalidInputError(
                f"surface: {codec_text(codec)} keeps all of a brick; choose zerobit, or lossless"
            )
        if codec.background not in (None, 0):
            raise InvalidInputError(
                f"surface: background {codec.background}: what is not kept is 0; leave it out"
            )
        return replace(codec, background=0.0)

    def to_json(self) -> dict[str, Any]:
        """All that the bytes of a volume depend on."""
        placement = self.placement and self.placement.to_json()
        return {"digest": self.mesh.digest, "placement": placement, "up": self.up}


def surface_option(
    surface: Mesh | str | os.PathLike[str] | None, placement: Placement | None, up: UpAxis
) -> SurfaceOption | None:
    """The option, of a mesh or of the file of one; None without.

    Raises:
        OctobrickError: as `read_mesh`.
    """
    if surface is None:
        if placement is not None:
            raise InvalidInputError("surface_placement: is that of a surface; give one")
        return None
    mesh = surface if isinstance(surface, Mesh) else read_mesh(surface)
    return SurfaceOption(mesh, placement, up)


def volume_bounds(
    shape_zyx: Zyx, spacing_zyx: Sequence[float]
) -> tuple[np.ndarray[Any, np.dtype[np.float64]], np.ndarray[Any, np.dtype[np.float64]]]:
    """Lowest and highest corner (x, y, z) of a volume in the world, out to the faces of voxels."""
    spacing_xyz, shape_xyz = np.array(spacing_zyx[::-1], np.float64), np.array(shape_zyx[::-1])
    return -spacing_xyz / 2, spacing_xyz * (shape_xyz - 0.5)
