"""Fractal noise: octaves of smooth noise, each half as wide as the one before and weaker."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from octobrick.store.box import Zyx
from octobrick.store.synth.chance import at_lattice
from octobrick.store.synth.field import Field, Plane

GAIN = 0.6  # of an octave, against the one that is twice as wide
_CONTRAST = 0.55  # about three standard deviations of the sum on either side of one half
_PLANES_KEPT = 4  # a plane is made of two of the next coarser octave, which three share
_STREAM = 100
_NEAR, _FAR = np.float32(0.75), np.float32(0.25)

_Span = tuple[int, int]


class FractalNoise(Field):
    """Value noise whose lattices are refined by subdivision, so that octaves cost almost nothing.

    Octave k has a random value in every cell of 2ᵏ voxels per side; octaves from a quarter of the
    longest side down to 2 voxels are added. A lattice is refined by the weights 3/4 and 1/4 (those
    of the quadratic B-spline, whose limit is smooth), and the next octave's values are added to
    it there, so all octaves together cost 1 + 1/4 + 1/16 + … planes instead of one plane each.
    """

    def __init__(self, shape_zyx: Zyx, seed: int) -> None:
        super().__init__(shape_zyx, seed)
        noctaves = max(1, (max(shape_zyx) - 1).bit_length() - 2)
        _, ny, nx = shape_zyx
        self._octaves = [_Octave(0, (0, ny), (0, nx), seed, 0.0)]
        for k in range(1, noctaves + 1):
            finer = self._octaves[-1]
            weight = GAIN ** (noctaves - k)
            self._octaves.append(_Octave(k, _parent(finer.y), _parent(finer.x), seed, weight))
        self._coarser = [
            lru_cache(_PLANES_KEPT)(lambda z, k=k: self._make(k, z))
            for k in range(len(self._octaves))
        ]

    def signed(self, z: int) -> Plane:
        """One plane of noise around 0, mostly between -1 and 1; a new array."""
        return self._make(0, z)

    def plane(self, z: int) -> Plane:
        """One plane, mapped to 0 to 1 and cut there."""
        values = self._make(0, z)
        values *= _CONTRAST
        values += 0.5
        return np.clip(values, 0, 1, out=values)

    def _make(self, k: int, z: int) -> Plane:
        octave = self._octaves[k]
        if k + 1 == len(self._octaves):
            return octave.values(z)
        parent = z >> 1
        neighbour = parent + 1 if z & 1 else parent - 1
        planes = self._coarser[k + 1]
        between = planes(parent) * _NEAR
        between += planes(neighbour) * _FAR
        coarser = self._octaves[k + 1]
        refined = _refined_x(_refined_y(between, coarser.y, octave.y), coarser.x, octave.x)
        if k:
            refined += octave.values(z)
        return refined


class _Octave:
    """A lattice of random values, of the cells that the octaves below it look at."""

    def __init__(self, k: int, y: _Span, x: _Span, seed: int, weight: float) -> None:
        self.y = y
        self.x = x
        self._k = k
        self._seed = seed
        self._weight = np.float32(weight)

    def values(self, z: int) -> Plane:
        rows, columns = np.arange(*self.y), np.arange(*self.x)
        values = at_lattice(self._seed, _STREAM + self._k, z, rows, columns)
        values *= 2 * self._weight
        values -= self._weight
        return values


def _parent(span: _Span) -> _Span:
    """The cells of the next octave that a span of cells is refined from."""
    return (span[0] >> 1) - 1, (span[1] - 1 >> 1) + 2


def _refined_y(coarse: Plane, have: _Span, want: _Span) -> Plane:
    start, stop = want
    inner = coarse[1:-1] * _NEAR
    quarter = coarse * _FAR
    out = np.empty((2 * len(inner), coarse.shape[1]), np.float32)
    np.add(inner, quarter[:-2], out=out[0::2])
    np.add(inner, quarter[2:], out=out[1::2])
    first = 2 * (have[0] + 1)
    return out[start - first : stop - first]


def _refined_x(coarse: Plane, have: _Span, want: _Span) -> Plane:
    start, stop = want
    inner = coarse[:, 1:-1] * _NEAR
    quarter = coarse * _FAR
    out: NDArray[np.float32] = np.empty((len(coarse), 2 * inner.shape[1]), np.float32)
    np.add(inner, quarter[:, :-2], out=out[:, 0::2])
    np.add(inner, quarter[:, 2:], out=out[:, 1::2])
    first = 2 * (have[0] + 1)
    return out[:, start - first : stop - first]
