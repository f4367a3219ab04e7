"""Samples of a volume at any points, straight from its S3Dc code.

Yela, Navazo, Vázquez 2008, sections 4.3 and 5. docs/spec/s3dc.md ("Sampling") has the formulas;
`octobrick.codec.reference_sampling` is the same in plain numpy, to the bit.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from octobrick.codec import _native
from octobrick.codec.arrays import (
    SAMPLE_DTYPES,
    contiguous,
    require_dtype,
    require_extents,
    require_spacing,
)
from octobrick.codec.errors import InvalidInputError, UnsupportedError
from octobrick.codec.s3dc import S3dc
from octobrick.codec.s3dc_faults import require_sound
from octobrick.codec.s3dc_layout import require_code

if TYPE_CHECKING:
    from typing_extensions import Buffer

_MAX_EXTENT = 2**31 - 1
"""What the native code counts voxels of one axis with: int32, of which four fit one register."""

Points = NDArray[np.float32] | NDArray[np.float64]
Samples = NDArray[np.float32]


class S3dcSampler:
    """A volume that stays compressed, and is sampled by decoding the voxels that a point needs.

    A point is (x, y, z) in voxels: voxel i has its centre at i + 0.5, as in a texture. Points
    outside, infinite ones too, are moved to the nearest centre of a voxel; a point with a NaN
    coordinate has the sample NaN. A voxel counts as `S3dc.decode` gives it, whichever block it is
    in; all else is float64, rounded to float32 once.

    Codes of a fixed rate are sampled, and those with a width per block; not those with trained
    scales, nor any made with a prediction.

    The code is checked once, here, and not copied: do not change its bytes while this lives.
    Every method is safe to call from many threads, and lets other Python threads run meanwhile.

    Args:
        codec: the parameters of the code.
        data: what `codec.encode` returned, in any contiguous buffer.
        shape: (z, y, x) of the encoded array.
        dtype: its sample type.

    Raises:
        CorruptBrickError: the bytes are not a code of this shape, type and parameters, or it was
            made with a prediction.
        InvalidInputError: a shape that no array has, an axis of more than 2^31 − 1 voxels, or a
            buffer that is not contiguous.
        UnsupportedError: another sample type, or a codec with trained scales.
    """

    def __init__(self, codec: S3dc, data: Buffer, shape: Iterable[int], dtype: DTypeLike) -> None:
        shape_zyx, sample_dtype = require_extents(shape, "shape"), require_dtype(dtype)
        if codec.scale != "linear":
            raise UnsupportedError(
                f"a sampler reads codes with a linear scale, not {codec}; decode it",
                codec=str(codec),
            )
        view = require_code(codec, data, shape_zyx, sample_dtype)
        if max(shape_zyx) > _MAX_EXTENT:
            raise InvalidInputError(
                f"an axis of {max(shape_zyx)} voxels is too long for a sampler; give at "
                f"most {_MAX_EXTENT}, in several codes",
                shape=[str(n) for n in shape_zyx],
            )
        self._native = _native.S3dcSampler(
            view, shape_zyx, SAMPLE_DTYPES.index(sample_dtype), codec.block, codec.bits
        )
        require_sound(self._native.outcome)

    def nearest(self, points_xyz: Points) -> Samples:
        """The voxel that each point lies in: two fetches, of end points and a word of indices.

        Where a number of bits does not divide 16, an index may lie in two words. With a width per
        block a third fetch tells where the block's indices are.

        Args:
            points_xyz: float32 or float64 (n, 3), in voxels.

        Returns:
            float32 (n,), what `decode` has there, to the bit.

        Raises:
            InvalidInputError: not (n, 3).
            UnsupportedError: neither float32 nor float64.
        """
        return self._sample(_native.Sampling.NEAREST, points_xyz)

    def trilinear(self, points_xyz: Points, *, shared: bool = True) -> Samples:
        """Between the eight voxels around each point, each decoded with its own end points.

        Args:
            points_xyz: float32 or float64 (n, 3), in voxels.
            shared: fetch once what neighbours have in common (the paper's optimised linear
                interpolation): 5 to 16 fetches instead of 16. With a width per block, each block is
                looked up once. The result is the same to the bit.

        Returns:
            float32 (n,); at the centre of a voxel, that voxel.

        Raises:
            InvalidInputError: not (n, 3).
            UnsupportedError: neither float32 nor float64.
        """
        how = _native.Sampling.TRILINEAR_SHARED if shared else _native.Sampling.TRILINEAR
        return self._sample(how, points_xyz)

    def gradient(self, points_xyz: Points, spacing_zyx: Sequence[float] = (1, 1, 1)) -> Samples:
        """The gradient of the trilinear samples, by central differences on the fly.

        Along each axis, the sample one voxel further less the one a voxel back, times
        0.5 / spacing. Near a face points are clamped and the divisor stays, as in a shader: at
        the outermost centres the slope across the face is halved, where
        `octobrick.codec.gradients.central_differences` is one-sided. Elsewhere, at centres of
        voxels, the two are equal. A component beyond the greatest float32 scales the vector as
        it does there.

        Args:
            points_xyz: float32 or float64 (n, 3), in voxels.
            spacing_zyx: the distance of voxels along each axis, within 1e-150 … 1e150.

        Returns:
            float32 (n, 3), components (x, y, z), in sample units per unit of spacing; NaN for a
            point with a NaN coordinate.

        Raises:
            InvalidInputError: not (n, 3), or a spacing out of its range.
            UnsupportedError: neither float32 nor float64.
        """
        points, spacing = _require_points(points_xyz), require_spacing(spacing_zyx)
        vectors = np.empty(points.shape, np.float32)
        self._native.gradient(_native.Sampling.TRILINEAR_SHARED, points, spacing, vectors)
        return vectors

    def _sample(self, how: _native.Sampling, points_xyz: Points) -> Samples:
        points = _require_points(points_xyz)
        samples = np.empty(len(points), np.float32)
        self._native.sample(how, points, samples)
        return samples


def _require_points(points_xyz: NDArray[Any]) -> NDArray[Any]:
    points = np.asarray(points_xyz)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InvalidInputError(
            f"the points have shape {points.shape}; give (n, 3), with coordinates (x, y, z)",
            shape=list(points.shape),
        )
    if points.dtype.newbyteorder("=") not in (np.float32, np.float64):
        raise UnsupportedError(
            f"points of {points.dtype} are not sampled at; convert them to float32 or float64",
            dtype=str(points.dtype),
        )
    return contiguous(points)
