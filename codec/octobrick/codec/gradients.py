"""Gradients of volumes, their reduction to coarser levels, and directions in three bytes.

After Díaz-García, Brunet, Navazo, Vázquez, "Downsampling and Storage of Pre-Computed Gradients for
Volume Rendering", 2017. The code is specified in docs/spec/gradient-code.md;
`octobrick.codec.reference_gradients` is the same in plain numpy.

All functions are pure and thread-safe, let other Python threads run meanwhile, and give the same
on any number of threads. Vectors are (…, 3) with components (x, y, z). Arrays may have any strides
and byte order; those that are not contiguous and native are copied first.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import _native
from octobrick.codec.arrays import (
    Voxels,
    contiguous,
    not_finite,
    require_extents,
    require_spacing,
    require_threads,
    require_volume,
)
from octobrick.codec.errors import InvalidInputError, NotFiniteError, UnsupportedError

Vectors = NDArray[np.float32]
DirectionCodes = NDArray[np.uint8]


def central_differences(
    volume: Voxels, spacing_zyx: Sequence[float] = (1, 1, 1), *, threads: int | None = None
) -> Vectors:
    """The gradient of every voxel, by central differences in world units.

    One-sided at the faces, 0 along an axis of length 1. Differences are taken in float64, so
    integers do not wrap and ±3.4e38 does not overflow; a gradient with a component beyond the
    greatest float32 is scaled as a whole, which keeps its direction. Below 1e-45 it becomes 0.

    Args:
        volume: (z, y, x), of uint8, int8, uint16, int16 or float32.
        spacing_zyx: the distance of voxels along each axis, within 1e-150 … 1e150.
        threads: how many may work; None is one, or all processors from 4 MiB on.

    Returns:
        float32 (z, y, x, 3), components (x, y, z), in sample units per unit of spacing.

    Raises:
        InvalidInputError: not three axes, an empty one, or a spacing out of its range.
        NotFiniteError: a float32 voxel is NaN or infinite.
        UnsupportedError: another sample type.
    """
    volume = contiguous(require_volume(volume))
    spacing = require_spacing(spacing_zyx)
    gradient = np.empty((*volume.shape, 3), np.float32)
    fault = _native.central_differences_into(volume, spacing, gradient, require_threads(threads))
    if fault is not None:
        raise not_finite(volume, fault, "it has no gradient")
    return gradient


def reduce(
    gradient: Vectors, radius: int = 1, sigma: float = 0.75, *, threads: int | None = None
) -> Vectors:
    """The gradient at half resolution, weighted by magnitude (the paper's equation 1).

    Every coarse vector is the mean of the fine ones around it, weighted by their magnitude and a
    Gaussian, so that a border between materials outweighs the flat voxels beside it. The kernel
    is even, centred on the coarse voxel as `octobrick.codec.reduce.mean2` has it. Vectors beyond
    the faces do not count; where all are zero, so is the mean. NaN and ±Inf spread.

    Args:
        gradient: float32 (z, y, x, 3).
        radius: of the kernel in fine voxels, 1 to 16; it holds (2·radius)³ of them.
        sigma: of the Gaussian in fine voxels, above 0. With radius 1 all weigh the same.
        threads: how many may work; None is one, or all processors from 4 MiB on.

    Returns:
        float32, each axis halved and rounded up, with magnitudes: reduce them again for the next
        level, and encode directions last.

    Raises:
        InvalidInputError: not (z, y, x, 3), an empty axis, or a parameter out of its range.
        UnsupportedError: not float32.
    """
    gradient = np.asarray(gradient)
    if gradient.ndim != 4 or gradient.shape[-1] != 3 or gradient.size == 0:
        raise InvalidInputError(
            f"the gradient has shape {gradient.shape}; give (z, y, x, 3), each axis of at least 1",
            shape=list(gradient.shape),
        )
    if gradient.dtype.newbyteorder("=") != np.float32:
        raise UnsupportedError(
            f"a gradient of {gradient.dtype} is not reduced; convert it to float32",
            dtype=str(gradient.dtype),
        )
    radius, sigma = operator.index(radius), float(sigma)
    if not 1 <= radius <= _native.MAX_REDUCE_RADIUS or not 0 < sigma < math.inf:
        raise InvalidInputError(
            f"radius is {radius} and sigma {sigma}; give a radius of 1 to "
            f"{_native.MAX_REDUCE_RADIUS} and a sigma above 0",
            radius=str(radius),
            sigma=str(sigma),
        )
    fine = contiguous(gradient)
    coarse = np.empty((*(-(-n // 2) for n in fine.shape[:3]), 3), np.float32)
    _native.reduce_gradient_into(fine, coarse, radius, sigma, require_threads(threads))
    return coarse


def reduced_differences(
    volume: Voxels,
    spacing_zyx: Sequence[float] = (1, 1, 1),
    *,
    start_zyx: Sequence[int] = (0, 0, 0),
    shape_zyx: Sequence[int] | None = None,
    threads: int | None = None,
) -> Vectors:
    """The gradient of a part of a volume at half resolution, without the fine one in memory.

    The same, bit for bit, as that part of ``reduce(central_differences(volume, spacing_zyx))``, if
    it starts at even positions and ends at even positions or with the volume. The voxels around
    it serve as neighbours, so a volume may be cut into parts that overlap by one voxel.

    Args:
        volume: (z, y, x), of uint8, int8, uint16, int16 or float32, with any strides.
        spacing_zyx: as for `central_differences`.
        start_zyx: the part's first voxel.
        shape_zyx: the part's voxels; by default all from its start on.
        threads: how many may work; None is one, or all processors from 4 MiB on.

    Returns:
        float32 (z, y, x, 3) with the axes of the part halved and rounded up.

    Raises:
        InvalidInputError: no such part, or what `central_differences` refuses.
        NotFiniteError, UnsupportedError: as `central_differences`.
    """
    volume = require_volume(volume)
    spacing = require_spacing(spacing_zyx)
    z, y, x = (operator.index(i) for i in start_zyx)
    start = (z, y, x)
    if shape_zyx is None:
        shape_zyx = [n - i for n, i in zip(volume.shape, start, strict=True)]
    shape = require_extents(shape_zyx, "shape_zyx")
    ends = [i + n for i, n in zip(start, shape, strict=True)]
    if min(start) < 0 or any(end > n for end, n in zip(ends, volume.shape, strict=True)):
        raise InvalidInputError(
            f"there is no part from {start} to {tuple(ends)} (z, y, x) in a volume of "
            f"{volume.shape}",
            start_zyx=list(start),
            stop_zyx=ends,
        )
    coarse = np.empty((*(-(-n // 2) for n in shape), 3), np.float32)
    fault = _native.reduced_differences_into(
        volume, start, shape, spacing, coarse, require_threads(threads)
    )
    if fault is not None:
        at = np.argwhere(~np.isfinite(volume))[0]
        index = int(np.ravel_multi_index(tuple(at), volume.shape))
        raise not_finite(volume, index, "it has no gradient")
    return coarse


def encode_directions(gradient: NDArray[Any], *, threads: int | None = None) -> DirectionCodes:
    """The directions of vectors as three bytes each; magnitudes are not kept.

    No direction is off by more than 0.1731° after decoding, the mean is below 0.029°. Vectors of
    any length from 5e-324 to 1e308 are coded alike; a zero vector has a code of its own.

    Args:
        gradient: float32 or float64 (…, 3).
        threads: how many may work; None is one, or all processors from 4 MiB on.

    Returns:
        uint8 of the same shape.

    Raises:
        InvalidInputError: the last axis is not 3 long.
        NotFiniteError: a component is NaN or infinite.
        UnsupportedError: neither float32 nor float64.
    """
    vectors = _require_triples(gradient, "the gradient")
    if vectors.dtype.newbyteorder("=") not in (np.float32, np.float64):
        raise UnsupportedError(
            f"directions of {vectors.dtype} are not encoded; convert them to float32 or float64",
            dtype=str(vectors.dtype),
        )
    vectors = contiguous(vectors)
    codes = np.empty(vectors.shape, np.uint8)
    fault = _native.encode_directions_into(vectors, codes, require_threads(threads))
    if fault is not None:
        at = tuple(int(i) for i in np.unravel_index(fault, vectors.shape[:-1]))
        raise NotFiniteError(
            f"the vector at {at} is {tuple(vectors[at].tolist())}: only finite vectors have a "
            "direction; replace it first, for instance with zeros",
            vector_index=list(at),
            value=str(tuple(vectors[at].tolist())),
        )
    return codes


def decode_directions(code: DirectionCodes, *, threads: int | None = None) -> Vectors:
    """The unit vectors of codes; (0, 0, 0) for the code of the zero vector.

    Any bytes decode: damage gives a wrong direction, never NaN.

    Args:
        code: uint8 (…, 3), what `encode_directions` returned.
        threads: how many may work; None is one, or all processors from 4 MiB on.

    Returns:
        float32 of the same shape.

    Raises:
        InvalidInputError: the last axis is not 3 long.
        UnsupportedError: not uint8.
    """
    code = _require_triples(code, "the code")
    if code.dtype != np.uint8:
        raise UnsupportedError(
            f"a code of directions is uint8, not {code.dtype}; pass what encode_directions made",
            dtype=str(code.dtype),
        )
    code = contiguous(code)
    vectors = np.empty(code.shape, np.float32)
    _native.decode_directions_into(code, vectors, require_threads(threads))
    return vectors


def _require_triples(array: NDArray[Any], what: str) -> NDArray[Any]:
    array = np.asarray(array)
    if array.ndim == 0 or array.shape[-1] != 3:
        raise InvalidInputError(
            f"{what} has shape {array.shape}; its last axis must hold the components (x, y, z)",
            shape=list(array.shape),
        )
    return array
