"""Table 1 of the S3Dc paper (Yela, Navazo, Vázquez, 2008), as printed."""

from __future__ import annotations

from typing import NamedTuple


class Published(NamedTuple):
    """One row: 512 × 512 × 486 voxels of 16 bits, a picture of 768² pixels, a GeForce 8800 GTX.

    Args:
        bits: of an index.
        edge: of a block, voxels.
        ratio: of compression.
        nearest_fps, linear_fps: frames a second, by how voxels are sampled.
        nearest_psnr_db, linear_psnr_db: of the picture, beside that of the original, linear.
        nearest_ssim, linear_ssim: the same pictures, per cent.
    """

    bits: int
    edge: int
    ratio: float
    nearest_fps: float
    linear_fps: float
    nearest_psnr_db: float
    linear_psnr_db: float
    nearest_ssim: float
    linear_ssim: float


TABLE_1 = (
    Published(2, 2, 2.667, 16.095, 4.57, 38.76, 40.9, 95.75, 97.88),
    Published(2, 4, 6.395, 16.65, 4.57, 34.95, 34.23, 95.44, 96.44),
    Published(2, 8, 7.757, 16.53, 4.85, 31.52, 30.27, 95.42, 95.76),
    Published(2, 16, 7.968, 16.30, 5.05, 29.18, 28.30, 94.86, 95.04),
    Published(2, 32, 7.996, 16.07, 5.01, 28.32, 27.49, 94.77, 94.82),
    Published(2, 64, 7.999, 15.73, 4.66, 28.20, 27.31, 94.79, 94.83),
    Published(2, 128, 8.000, 14.91, 4.12, 28.21, 27.33, 94.72, 94.79),
    Published(4, 2, 2.000, 16.07, 4.41, 39.48, 46.19, 96.13, 99.25),
    Published(4, 4, 3.554, 16.52, 4.38, 39.61, 44.08, 96.34, 99.11),
    Published(4, 8, 3.938, 16.44, 4.72, 39.48, 41.04, 96.36, 98.92),
    Published(4, 16, 3.992, 16.15, 4.87, 38.62, 38.77, 96.33, 98.68),
    Published(4, 32, 3.999, 15.90, 4.77, 37.77, 37.32, 96.30, 98.51),
    Published(4, 64, 4.000, 15.60, 4.49, 37.30, 36.67, 96.21, 98.36),
    Published(4, 128, 4.000, 15.03, 3.95, 36.93, 36.35, 96.10, 98.22),
)
