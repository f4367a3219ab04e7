"""Bytes to voxels and back, and how much is lost on the way: the public door of the codec.

Everything here is a pure function or an immutable value, safe to use from many threads.
"""

from __future__ import annotations

from octobrick.codec import deblock, errors, gradients, metrics, reduce
from octobrick.codec.metrics import ErrorStats
from octobrick.codec.s3dc import S3dc
from octobrick.codec.s3dc_sampler import S3dcSampler
from octobrick.codec.zerobit import Codebook, Zerobit, ZerobitStats

__all__ = [
    "Codebook",
    "ErrorStats",
    "S3dc",
    "S3dcSampler",
    "Zerobit",
    "ZerobitStats",
    "deblock",
    "errors",
    "gradients",
    "metrics",
    "reduce",
]
