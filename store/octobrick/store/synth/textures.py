"""Solid textures: marble and wood, as values or as colours."""

from __future__ import annotations

import numpy as np

from octobrick.store.box import Zyx
from octobrick.store.synth.field import Field, Plane, wave
from octobrick.store.synth.noise import FractalNoise

_VEINS = 3.0  # along the longest side
_VEIN_WARP = 0.9  # periods that the noise moves a vein by
_RINGS = 12.0
_RING_WARP = 0.6
_TILT = (0.15, 0.08)  # of the trunk, along y and x per length of z


class Marble(Field):
    """Veins: a wave along x and y, warped by fractal noise."""

    palette = np.array([(0.13, 0.15, 0.20), (0.62, 0.62, 0.66), (0.96, 0.95, 0.93)], np.float32)

    def __init__(self, shape_zyx: Zyx, seed: int) -> None:
        super().__init__(shape_zyx, seed)
        self._noise = FractalNoise(shape_zyx, seed)
        _, y, x = _places(shape_zyx)
        self._phase = (_VEINS * (x[np.newaxis, :] + 0.5 * y[:, np.newaxis])).astype(np.float32)

    def plane(self, z: int) -> Plane:
        """One plane of the veins."""
        phase = self._noise.signed(z)
        phase *= np.float32(_VEIN_WARP)
        phase += self._phase
        return wave(phase)


class Wood(Field):
    """Rings around a tilted trunk, warped by fractal noise."""

    palette = np.array([(0.80, 0.60, 0.36), (0.62, 0.40, 0.20), (0.33, 0.18, 0.08)], np.float32)

    def __init__(self, shape_zyx: Zyx, seed: int) -> None:
        super().__init__(shape_zyx, seed)
        self._noise = FractalNoise(shape_zyx, seed)
        self._places = _places(shape_zyx)

    def plane(self, z: int) -> Plane:
        """One plane of the rings."""
        along, y, x = self._places
        dy = (y - _TILT[0] * along[z]).astype(np.float32)
        dx = (x - _TILT[1] * along[z]).astype(np.float32)
        radius = (dy * dy)[:, np.newaxis] + (dx * dx)[np.newaxis, :]
        np.sqrt(radius, out=radius)
        radius *= np.float32(_RINGS)
        warp = self._noise.signed(z)
        warp *= np.float32(_RING_WARP)
        radius += warp
        return wave(radius)


def _places(shape_zyx: Zyx) -> list[np.ndarray[tuple[int], np.dtype[np.float64]]]:
    """Voxel centres along z, y and x, 0 in the middle and 1 long along the longest side."""
    return [(np.arange(n) + 0.5 - n / 2) / max(shape_zyx) for n in shape_zyx]
