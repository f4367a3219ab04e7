"""The contract of every kind: a field of values from 0 to 1, made plane by plane."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from octobrick.store.box import Zyx

Plane = NDArray[np.float32]


class Field(ABC):
    """A procedural volume; `plane` depends on nothing but the arguments of the constructor and z.

    It may keep what neighbouring planes share, so one field serves one thread.

    Args:
        shape_zyx: voxels along each axis.
        seed: chooses among the volumes of a kind; kinds without chance leave it alone.
    """

    # Colours at equal distances from value 0 to 1, for the kinds that are solid textures.
    palette: NDArray[np.float32] | None = None

    def __init__(self, shape_zyx: Zyx, seed: int) -> None:
        self.shape_zyx = shape_zyx
        self.seed = seed

    @abstractmethod
    def plane(self, z: int) -> Plane:
        """The values of plane z, (y, x), from 0 to 1; a new array."""


def axis(n: int) -> NDArray[np.float64]:
    """The positions of n samples from -1 to 1, both included; 0 for a single one."""
    return np.linspace(-1.0, 1.0, n) if n > 1 else np.zeros(1)


def wave(phase: Plane) -> Plane:
    """A smooth wave of period 1 from 0 (at whole numbers) to 1 and back, in place.

    Not a sine: products and sums of floats are the same on every machine, sines are not.
    """
    phase -= np.floor(phase)
    phase *= 2
    phase -= 1
    np.abs(phase, out=phase)
    np.subtract(1, phase, out=phase)
    slope = 3 - 2 * phase
    phase *= phase
    phase *= slope
    return phase
