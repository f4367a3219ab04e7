"""The cells of all levels of a volume that a surface touches: what selective coding keeps.

Bajaj, Ihm, Park 2001, section 4.3: texture cells that no polygon meets become null cells.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import InvalidInputError
from octobrick.store.box import Zyx, grid_of
from octobrick.store.surface.attributes import SurfaceAttributes
from octobrick.store.surface.mesh import Mesh
from octobrick.store.surface.placement import Placement
from octobrick.store.surface.touched_cells import touched_cells

CellMask = NDArray[np.bool_]
"""Of a brick: (brick / 4)³, True where a cell is kept."""

CELL: Final = 4
"""Voxels along each side of a cell, as zerobit has them."""
DILATION_VOXELS: Final = 0.5 + 1 / 64
"""How far around the surface cells are kept: linear interpolation reads half a voxel further than
the cell of its point; the rest is for graphics cards, which place a fragment to 1/100 voxel."""

_NEIGHBOURS: Final = [(z, y, x) for z in (-1, 0, 1) for y in (-1, 0, 1) for x in (-1, 0, 1)]


@dataclass(frozen=True, slots=True, eq=False)
class LevelSelection:
    """The cells of one level that are kept.

    Attributes:
        brick: voxels per brick and axis.
        masks: by brick, of those that keep a cell.
        ncells: how many are kept.
    """

    brick: int
    masks: dict[Zyx, CellMask]
    ncells: int

    def of_brick(self, brick_zyx: Zyx) -> CellMask:
        """Which cells of a brick are kept."""
        mask = self.masks.get(brick_zyx)
        return np.zeros((self.brick // CELL,) * 3, np.bool_) if mask is None else mask

    def is_near(self, brick_zyx: Zyx) -> bool:
        """Whether the brick, or one beside it, keeps a cell."""
        z, y, x = brick_zyx
        return any((z + i, y + j, x + k) in self.masks for i, j, k in _NEIGHBOURS)


def level_selection(
    mesh: Mesh,
    placement: Placement,
    shape_zyx: Zyx,
    spacing_zyx: Sequence[float],
    brick: int,
    level: int,
) -> LevelSelection:
    """The cells of a level that come within `DILATION_VOXELS` of a placed mesh.

    Args:
        mesh: the surface.
        placement: where it lies.
        shape_zyx: of the level.
        spacing_zyx: world size of a voxel of level 0.
        brick: voxels per brick and axis, a multiple of 4.
        level: which of the pyramid.

    Raises:
        InvalidInputError: bricks that cut cells; or the mesh lies too far away.
    """
    if brick % CELL:
        raise InvalidInputError(
            f"brick {brick}: cells of a surface are {CELL}³ voxels, so it must be a multiple of "
            f"{CELL}",
            brick=brick,
        )
    triangles = voxel_places(mesh, placement, spacing_zyx, level)[mesh.faces] / CELL
    cells = touched_cells(triangles, grid_of(shape_zyx, (CELL,) * 3), DILATION_VOXELS / CELL)
    side = brick // CELL
    masks: dict[Zyx, CellMask] = {}
    bricks, owner = np.unique(cells // side, axis=0, return_inverse=True)
    order = np.argsort(owner.ravel(), kind="stable")
    ends = np.cumsum(np.bincount(owner.ravel(), minlength=len(bricks)))
    for index, at in enumerate(bricks.tolist()):
        own = cells[order[ends[index - 1] if index else 0 : ends[index]]] % side
        mask = np.zeros((side,) * 3, np.bool_)
        mask[tuple(own.T)] = True
        masks[(at[0], at[1], at[2])] = mask
    return LevelSelection(brick, masks, len(cells))


def voxel_places(
    mesh: Mesh, placement: Placement, spacing_zyx: Sequence[float], level: int
) -> NDArray[np.float64]:
    """Where the vertices lie in a level's voxels (n, 3) (z, y, x): voxel i spans [i, i + 1]."""
    world_zyx = placement.places(mesh.vertices_xyz)[:, ::-1]
    # The corner of the first voxel is the same at all levels: half a voxel of level 0 before 0.
    return np.asarray((world_zyx / np.array(spacing_zyx) + 0.5) / 2**level)


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceSelection:
    """The cells of all levels that are kept, and for which surface.

    Attributes:
        mesh: the surface.
        placement: where it lies.
        levels: finest first.
        outside_share: of the vertices, those outside of the volume, around which nothing is kept.
    """

    mesh: Mesh
    placement: Placement
    levels: tuple[LevelSelection, ...]
    outside_share: float

    @classmethod
    def of(
        cls,
        mesh: Mesh,
        placement: Placement,
        shapes_zyx: Sequence[Zyx],
        spacing_zyx: Sequence[float],
        brick: int,
    ) -> SurfaceSelection:
        """What a placed mesh touches at all levels.

        Raises:
            InvalidInputError: it touches nothing; or as `level_selection`.
        """
        levels = tuple(
            level_selection(mesh, placement, shape, spacing_zyx, brick, i)
            for i, shape in enumerate(shapes_zyx)
        )
        if not levels[0].ncells:
            raise InvalidInputError(
                f"{mesh.name}: as it is placed, the surface does not touch the volume; leave its "
                "placement out to fit it in, or change it"
            )
        places = voxel_places(mesh, placement, spacing_zyx, 0)
        slack = DILATION_VOXELS
        inside = ((places >= -slack) & (places <= np.array(shapes_zyx[0]) + slack)).all(axis=1)
        return cls(mesh, placement, levels, float(1 - inside.mean()))

    def attributes(self) -> SurfaceAttributes:
        """What a volume says of its surface."""
        return SurfaceAttributes(
            name=self.mesh.name,
            digest=self.mesh.digest,
            nvertices=len(self.mesh.vertices_xyz),
            nfaces=len(self.mesh.faces),
            placement=self.placement,
            ncells=tuple(level.ncells for level in self.levels),
        )
