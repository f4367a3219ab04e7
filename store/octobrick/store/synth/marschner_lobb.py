"""The test signal of Marschner and Lobb: rings of a frequency that reconstruction tends to lose.

Source: "An evaluation of reconstruction filters for volume rendering", Visualization 1994.
"""

from __future__ import annotations

import numpy as np

from octobrick.store.box import Zyx
from octobrick.store.synth.field import Field, Plane, axis

FREQUENCY = 6.0
ALPHA = 0.25


class MarschnerLobb(Field):
    """The signal over [-1, 1]³, sampled at both ends; the same for every seed.

    It is a sum of a part of z and a part of x and y, so a plane costs one addition a voxel.
    """

    def __init__(self, shape_zyx: Zyx, seed: int) -> None:
        super().__init__(shape_zyx, seed)
        nz, ny, nx = shape_zyx
        radius = np.hypot(axis(ny)[:, np.newaxis], axis(nx)[np.newaxis, :])
        rings = np.cos(2 * np.pi * FREQUENCY * np.cos(np.pi * radius / 2))
        self._rings = (ALPHA * (1 + rings) / (2 * (1 + ALPHA))).astype(np.float32)
        self._ramp = ((1 - np.sin(np.pi * axis(nz) / 2)) / (2 * (1 + ALPHA))).astype(np.float32)

    def plane(self, z: int) -> Plane:
        """One plane of the signal."""
        values: Plane = self._rings + self._ramp[z]
        return values
