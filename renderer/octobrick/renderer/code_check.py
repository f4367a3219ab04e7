"""Bytes of bricks are checked before a shader reads them, which then trusts every offset in them.

Where the length says all, as for raw voxels, nothing else can lead a shader astray: any other bytes
are voxels, though perhaps none that anybody stored.
"""

from __future__ import annotations

import struct
from typing import Any

import numpy as np

from octobrick.codec import S3dc, S3dcSampler, Zerobit
from octobrick.codec.deblock import s3dc_bounds
from octobrick.codec.errors import CorruptBrickError
from octobrick.renderer.code_layout import CodeLayout
from octobrick.store.box import Zyx

_ZEROBIT_TYPES = ("uint8", "int8", "uint16", "int16", "float32")
_ZEROBIT_HEADER = struct.Struct("<4sBBBB3I")


def checked_code(layout: CodeLayout, code: bytes, what: str, level: int, zyx: Zyx) -> bytes:
    """The bytes as decoders take them: those given, and what decoders need behind them.

    Args:
        layout: what they should be.
        code: the bytes.
        what: names the brick in errors.
        level: of the brick.
        zyx: its position.

    Raises:
        CorruptBrickError: they are no such code.
    """
    where: dict[str, Any] = {"level": level, "brick_zyx": list(zyx)}
    if layout.has_one_size and len(code) != layout.code_nbytes:
        raise CorruptBrickError(
            f"{what}: {len(code)} bytes of code, expected {layout.code_nbytes} for "
            f"{layout.dtype} bricks of {layout.brick_zyx}; fetch it again or re-ingest the volume",
            nbytes=len(code),
            expected_nbytes=layout.code_nbytes,
            **where,
        )
    try:
        if layout.form == "zerobit":
            _require_zerobit(layout, code)
        elif layout.form == "s3dc_variable":
            assert isinstance(layout.codec, S3dc)
            S3dcSampler(layout.codec, code, layout.brick_zyx, layout.sample)
            return code + _flat_bound(layout, code)
    except CorruptBrickError as error:
        raise CorruptBrickError(f"{what}: {error}", **{**error.facts, **where}) from error
    return code


def _flat_bound(layout: CodeLayout, code: bytes) -> bytes:
    """The error that blocks of a single value may have: all others tell their own."""
    codec = layout.codec
    assert isinstance(codec, S3dc)
    bound = codec.max_error
    if bound is None:
        widths = codec.block_widths(code, layout.brick_zyx, layout.sample)
        if (widths == 0).any():
            bounds = s3dc_bounds(codec, code, layout.brick_zyx, layout.sample)
            bound = float(bounds[widths == 0][0])
    # A bound may be beyond float32, which no voxel can be off by.
    return np.float32(min(bound or 0, float(np.finfo(np.float32).max))).tobytes()


def _require_zerobit(layout: CodeLayout, code: bytes) -> None:
    """Refuse what is no zerobit code of a brick of scalars, or has another codebook."""
    assert isinstance(layout.codec, Zerobit)
    layout.codec.stats(code)  # walks over all unit blocks
    _, _, kind, channels, _, *shape = _ZEROBIT_HEADER.unpack_from(code)
    found = (tuple(shape), _ZEROBIT_TYPES[kind], channels)
    if found != (layout.brick_zyx, layout.dtype, 1):
        raise CorruptBrickError(
            f"the code is of {found[0]} {found[1]} voxels with {found[2]} channels, expected "
            f"{layout.brick_zyx} {layout.dtype} with 1; fetch it again or re-ingest the volume",
            found=str(found),
        )
