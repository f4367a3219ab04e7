"""One resolution of a volume: its shape, its place in the world and what was lost."""

from __future__ import annotations

from dataclasses import dataclass

from octobrick.store.attributes import Number
from octobrick.store.box import Zyx

Xyz = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Level:
    """A level of the pyramid; 0 is the original, each next one half as fine per axis.

    Attributes:
        index: which level.
        shape_zyx: voxels.
        grid_zyx: bricks along each axis.
        spacing_xyz: world size of a voxel.
        origin_xyz: world position of the centre of voxel (0, 0, 0).
        nbytes: size of the voxels of all time steps and channels, uncompressed.
        stored_nbytes: their size on disk.
        max_error: the largest difference between a decoded voxel and that level's voxel.
        rmse: the root of the mean squared difference.
        psnr_db: peak is the level's largest minus its smallest voxel; None where nothing is lost.
    """

    index: int
    shape_zyx: Zyx
    grid_zyx: Zyx
    spacing_xyz: Xyz
    origin_xyz: Xyz
    nbytes: int
    stored_nbytes: int
    max_error: Number
    rmse: float
    psnr_db: float | None
