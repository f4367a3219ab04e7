"""Spheres of many sizes and values, none touching another, whose volume is known."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from octobrick.store.box import Zyx, ceil_div
from octobrick.store.synth.chance import at_lattice
from octobrick.store.synth.field import Field, Plane

_STREAM = 200
_SPHERES_ALONG = 8  # on the longest side
_LEAST_CELL = 8  # voxels, so that the smallest sphere still has an inside


class Sphere(NamedTuple):
    """One sphere; in voxels, where voxel i reaches from i to i + 1."""

    center_zyx: tuple[float, float, float]
    radius: float
    value: float


class Spheres(Field):
    """One sphere in every cell of a grid, its edge spread over one voxel; 0 between them."""

    def __init__(self, shape_zyx: Zyx, seed: int) -> None:
        super().__init__(shape_zyx, seed)
        self._cell = max(_LEAST_CELL, ceil_div(max(shape_zyx), _SPHERES_ALONG))
        self._layer: tuple[int, list[Sphere]] = (-1, [])

    def spheres(self) -> Iterator[Sphere]:
        """All spheres; those of the last cells can reach beyond the volume."""
        for layer in range(ceil_div(self.shape_zyx[0], self._cell)):
            yield from self._spheres_of(layer)

    def plane(self, z: int) -> Plane:
        """One plane through the spheres."""
        _, ny, nx = self.shape_zyx
        values = np.zeros((ny, nx), np.float32)
        layer = z // self._cell
        if self._layer[0] != layer:
            self._layer = (layer, list(self._spheres_of(layer)))
        for sphere in self._layer[1]:
            _draw(sphere, z, values)
        return values

    def _spheres_of(self, layer: int) -> Iterator[Sphere]:
        """The spheres of one layer of cells, each inside its cell."""
        rows, columns = (np.arange(ceil_div(n, self._cell)) for n in self.shape_zyx[1:])
        chances = [
            at_lattice(self.seed, _STREAM + i, layer, rows, columns).astype(float) for i in range(5)
        ]
        for iy in rows.tolist():
            for ix in columns.tolist():
                size, brightness, *places = (float(chance[iy, ix]) for chance in chances)
                radius = self._cell * (0.2 + 0.2 * size)
                # Half a voxel more than the radius from the walls: where the edge fades out.
                play = self._cell - 2 * radius - 1
                z, y, x = (
                    cell * self._cell + radius + 0.5 + play * place
                    for cell, place in zip((layer, iy, ix), places, strict=True)
                )
                yield Sphere((z, y, x), radius, 0.25 + 0.75 * brightness)


def _draw(sphere: Sphere, z: int, into: Plane) -> None:
    """Add the cut of a sphere; a voxel's value falls over one voxel across the surface."""
    center_z, center_y, center_x = sphere.center_zyx
    dz = z + 0.5 - center_z
    reach = (sphere.radius + 0.5) ** 2 - dz * dz
    if reach <= 0:
        return
    half = math.sqrt(reach)
    ny, nx = into.shape
    y0, y1 = max(0, math.floor(center_y - half)), min(ny, math.ceil(center_y + half))
    x0, x1 = max(0, math.floor(center_x - half)), min(nx, math.ceil(center_x + half))
    dy = (np.arange(y0, y1) + 0.5 - center_y).astype(np.float32)[:, np.newaxis]
    dx = (np.arange(x0, x1) + 0.5 - center_x).astype(np.float32)[np.newaxis, :]
    distance = dy * dy + (dx * dx + np.float32(dz * dz))
    np.sqrt(distance, out=distance)
    np.subtract(np.float32(sphere.radius + 0.5), distance, out=distance)
    np.clip(distance, 0, 1, out=distance)
    distance *= np.float32(sphere.value)
    into[y0:y1, x0:x1] += distance
