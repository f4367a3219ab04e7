"""Smoothing across the borders of blocks that were coded independently.

Marton, Iglesias Guitián, Díaz, Gobbetti, "Real-time deblocked GPU rendering of compressed
volumes", 2014, section 4, limited by what the codec can have lost. docs/spec/deblocking.md has the
formulas and what they gain; `octobrick.codec.reference_deblock` is the same in plain numpy.

All functions are pure and thread-safe, let other Python threads run meanwhile, and give the same
on any number of threads.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from octobrick.codec import _native
from octobrick.codec.arrays import (
    Voxels,
    Zyx,
    contiguous,
    not_finite,
    require_extents,
    require_threads,
    require_volume,
    widened,
)
from octobrick.codec.errors import InvalidInputError
from octobrick.codec.s3dc import S3dc
from octobrick.codec.s3dc_bounds import s3dc_bounds
from octobrick.codec.zerobit import Zerobit
from octobrick.codec.zerobit_bounds import CELL, zerobit_bounds

if TYPE_CHECKING:
    from typing_extensions import Buffer

__all__ = ["deblocked", "rational_bezier", "s3dc_bounds", "zerobit_bounds"]

Limit = Literal["auto", "ramp", "clamp"]
Axes = Literal["average", "sequential"]


def rational_bezier(
    volume: Voxels,
    block: Iterable[int],
    strength: float = 4,
    bound: ArrayLike | None = None,
    *,
    limit: Limit = "auto",
    axes: Axes = "average",
    value_range: float | tuple[float, float] | None = None,
    threads: int | None = None,
) -> NDArray[np.float32]:
    """The volume with jumps at block borders smoothed, each voxel moved no further than allowed.

    Along each axis, half of the voxels of two neighbouring blocks move onto the rational Bézier
    curve through all of both; the result is the mean of the three axes. Control points weigh
    exp(−strength·|∇|), so flat regions keep their values. Every result lies within the least and
    the greatest voxel.

    Give a bound wherever the codec knows one: without it the filter gains at 1 and 2 bits, and
    loses many dB where there was little error to begin with. The paper's own filter is
    `bound=None`, with `axes="average"` by its last sentence or `"sequential"` by the one before.

    Args:
        volume: decoded voxels (z, y, x), of uint8, int8, uint16, int16 or float32.
        block: the codec's block (z, y, x), of any size; blocks are cut at the faces. Work per
            voxel grows with it.
        strength: the paper's λ, any finite number; 0 is the plain Bézier curve.
        bound: the greatest error that a voxel can have: one number, an array of one per block
            (nbz, nby, nbx), or one per voxel. 0 keeps a voxel, inf does not limit it.
        limit: how a bound q limits a change c. "clamp" to ±q; "ramp" to c·max(0, 1 − (c/q)²),
            which takes what is beyond the bound for a feature of the data; "auto", the best for
            S3Dc on all data tried, clamps to ±0.4 q where a block's range is at most 10 q (1 and 2
            bits), and elsewhere takes c·max(0, 1 − |c|/q). For zerobit, whose q is twice the
            threshold of a unit block, take "ramp", as `deblocked` does.
        axes: "average", or "sequential": along x, then y, then z, each from the one before.
        value_range: what gradients are measured against; None is the greatest less the least
            voxel. Parts of one volume take the whole's, to be filtered alike: as a pair, its least
            and greatest voxel, they are so to the bit.
        threads: how many may work; None is one, or all processors from 4 MiB on.

    Returns:
        float32 of the same shape, C-contiguous.

    Raises:
        InvalidInputError: a shape, block, bound or parameter that makes no sense.
        NotFiniteError: a float32 voxel is NaN or infinite.
        UnsupportedError: another sample type.
    """
    volume = contiguous(require_volume(widened(volume)).astype(np.float32, copy=False))
    block = require_extents(block, "block")
    _require_choices(limit, axes)
    strength, unit, whole = _require_parameters(strength, value_range)
    bounds = None if bound is None else _require_bounds(bound, volume.shape, block)
    filtered = np.empty_like(volume)
    fault = _native.deblock_into(
        volume,
        filtered,
        block,
        strength,
        unit,
        whole,
        bounds,
        axes == "sequential",
        _native.DeblockLimit[limit.upper()],
        require_threads(threads),
    )
    if fault is not None:
        raise not_finite(volume, fault, "it cannot be filtered")
    return filtered


def deblocked(
    codec: S3dc | Zerobit,
    data: Buffer,
    shape: Iterable[int],
    dtype: DTypeLike,
    *,
    strength: float = 4,
    prediction: Voxels | None = None,
    value_range: float | tuple[float, float] | None = None,
    threads: int | None = None,
) -> NDArray[np.float32]:
    """The voxels of a code with its seams smoothed, by the way that was best for such codes.

    `rational_bezier` with the code's own blocks and bounds: of S3Dc at a fixed rate by
    `limit="auto"`; with a width per block, and of zerobit, whose blocks are its cells, by "ramp",
    as their bounds are scales of the error at best.

    Args:
        codec: what made the code, of a scalar volume.
        data: the code.
        shape: (z, y, x) of the encoded array.
        dtype: its sample type.
        strength, value_range, threads: as in `rational_bezier`.
        prediction: what S3Dc was given.

    Raises:
        CorruptBrickError, InvalidInputError, UnsupportedError: as the codec's `decode`.
    """
    shape = tuple(shape)
    bounds: NDArray[np.float32]
    limit: Limit
    if isinstance(codec, Zerobit):
        if prediction is not None or len(shape) != 3:
            raise InvalidInputError(
                f"zerobit codes have no prediction, and colours {shape} are not filtered; filter "
                "each channel by itself with rational_bezier",
                shape=list(shape),
            )
        voxels = codec.decode(data, shape, dtype, threads=threads)
        block, bounds, limit = (CELL,) * 3, zerobit_bounds(codec, data), "ramp"
    else:
        voxels = codec.decode(data, shape, dtype, prediction=prediction, threads=threads)
        bounds = s3dc_bounds(codec, data, shape, dtype, predicted=prediction is not None)
        block, limit = codec.block, "ramp" if codec.variable else "auto"
    return rational_bezier(
        voxels, block, strength, bounds, limit=limit, value_range=value_range, threads=threads
    )


def _require_choices(limit: str, axes: str) -> None:
    if limit not in ("auto", "ramp", "clamp"):
        raise InvalidInputError(
            f"limit is {limit!r}; give 'auto', 'ramp' or 'clamp'", limit=str(limit)
        )
    if axes not in ("average", "sequential"):
        raise InvalidInputError(f"axes is {axes!r}; give 'average' or 'sequential'", axes=str(axes))


def _require_parameters(
    strength: float, value_range: float | tuple[float, float] | None
) -> tuple[float, float, tuple[float, float]]:
    """All as the native code takes them: 0 is the volume's own range, (0, 0) no other's ends."""
    strength = float(strength)
    if not math.isfinite(strength):
        raise InvalidInputError(
            f"strength is {strength}; give a finite number, such as 4", strength=str(strength)
        )
    whole = (0.0, 0.0)
    unit: float | None
    if isinstance(value_range, tuple):
        low, high = map(float, value_range)
        whole, unit = (low, high), high - low
    else:
        unit = value_range
    if unit is not None and not 0 < unit < math.inf:
        raise InvalidInputError(
            f"value_range is {value_range}; give the data's maximum less its minimum, above 0, or "
            "both as a pair",
            value_range=str(value_range),
        )
    return strength, float(unit or 0), whole


def _require_bounds(bound: ArrayLike, shape: tuple[int, ...], block: Zyx) -> NDArray[np.float32]:
    """The bounds, one per block or per voxel."""
    grid = tuple(-(-n // b) for n, b in zip(shape, block, strict=True))
    bounds = np.asarray(bound, np.float32)
    if bounds.ndim == 0:
        bounds = np.full(grid, bounds)
    if bounds.shape not in (grid, shape):
        raise InvalidInputError(
            f"bound has shape {bounds.shape}; give one number, one per block {grid} or one per "
            f"voxel {shape}",
            shape=list(bounds.shape),
        )
    if not (bounds >= 0).all():
        raise InvalidInputError("a bound is negative or NaN; give the greatest error, at least 0")
    return contiguous(bounds)
