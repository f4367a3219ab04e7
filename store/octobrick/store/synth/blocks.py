"""Blocks of constant value, one in four of them empty: what sparse and labelled data look like."""

from __future__ import annotations

import numpy as np

from octobrick.store.box import Zyx
from octobrick.store.synth.chance import at_lattice
from octobrick.store.synth.field import Field, Plane

_STREAM = 300
_BLOCKS_ALONG = 16  # on the longest side
_LEAST_EDGE = 8  # voxels
_EMPTY = 0.25


class Blocks(Field):
    """Cubes of one value each; their edges are sharp and fall between voxels."""

    def __init__(self, shape_zyx: Zyx, seed: int) -> None:
        super().__init__(shape_zyx, seed)
        self.edge = max(_LEAST_EDGE, max(shape_zyx) // _BLOCKS_ALONG)
        _, ny, nx = shape_zyx
        self._rows, self._columns = np.arange(ny) // self.edge, np.arange(nx) // self.edge
        self._layer = -1
        self._values: Plane = np.empty((0, 0), np.float32)

    def plane(self, z: int) -> Plane:
        """One plane through the blocks."""
        if self._layer != z // self.edge:
            self._layer = z // self.edge
            rows, columns = (np.arange(int(i[-1]) + 1) for i in (self._rows, self._columns))
            chance = at_lattice(self.seed, _STREAM, self._layer, rows, columns)
            chance[chance < _EMPTY] = 0
            self._values = chance.take(self._columns, axis=1)
        return self._values.take(self._rows, axis=0)
