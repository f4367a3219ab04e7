"""Random numbers by place: the same at a lattice point whoever asks, in whatever order."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_MIX = (np.uint32(0x7FEB352D), np.uint32(0x846CA68B))  # Wellons' lowbias32
_AXES = (0x9E3779B1, 0x85EBCA77, 0xC2B2AE3D)
_MASK = 0xFFFFFFFF


def at_lattice(
    seed: int, stream: int, z: int, y: NDArray[np.int64], x: NDArray[np.int64]
) -> NDArray[np.float32]:
    """Uniform numbers from 0 to 1 (excluded) of one plane of a lattice.

    Args:
        seed: of the volume.
        stream: tells apart numbers that one volume needs at the same point.
        z: the plane; may be negative, like y and x.
        y: lattice rows.
        x: lattice columns.

    Returns:
        (len(y), len(x)), multiples of 2⁻²⁴.
    """
    key = _scramble(_scramble(seed & _MASK) ^ (seed >> 32 & _MASK) ^ (stream * _AXES[0] & _MASK))
    plane = _scramble(key ^ (z * _AXES[0] & _MASK))
    rows = mixed(((y * _AXES[1]) & _MASK).astype(np.uint32) ^ np.uint32(plane))
    columns = ((x * _AXES[2]) & _MASK).astype(np.uint32)
    bits = mixed(rows[:, np.newaxis] ^ columns[np.newaxis, :])
    bits >>= np.uint32(8)
    values = bits.astype(np.float32)
    values *= np.float32(2.0**-24)
    return values


def mixed(bits: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Every bit of each number depends on all its bits; in place."""
    bits ^= bits >> np.uint32(16)
    bits *= _MIX[0]
    bits ^= bits >> np.uint32(15)
    bits *= _MIX[1]
    bits ^= bits >> np.uint32(16)
    return bits


def _scramble(number: int) -> int:
    return int(mixed(np.array([number], np.uint32))[0])
