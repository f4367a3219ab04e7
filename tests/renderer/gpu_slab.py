"""What the GPU puts into a slab of a volume in memory, and what the codec says should be there."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import S3dc, Zerobit
from octobrick.codec.deblock import rational_bezier, s3dc_bounds, zerobit_bounds
from octobrick.renderer.context import GraphicsContext
from octobrick.renderer.filter_margin import filter_block, filtered_box, scratch_nbytes
from octobrick.renderer.gpu_filler import GpuFiller
from octobrick.renderer.slab_buffer import SlabBuffer
from octobrick.renderer.slab_filler import SlabContent
from octobrick.renderer.slab_format import SlabFormat
from octobrick.store.box import Box, Zyx, cell_box, cells_touching

from .array_source import ArraySource

Codec = S3dc | Zerobit


def level_bounds(source: ArraySource, codec: Codec) -> tuple[Zyx, NDArray[np.float32], str]:
    """Blocks, bounds and limit of level 0, put together from those of its bricks."""
    block = filter_block(codec)
    assert block is not None
    brick = source.brick_shape_zyx
    block = tuple(min(b, n) for b, n in zip(block, brick, strict=True))  # type: ignore[assignment]
    nblocks = [n // b for n, b in zip(brick, block, strict=True)]
    level = source.levels[0]
    bounds = np.zeros([g * n for g, n in zip(level.grid_zyx, nblocks, strict=True)], np.float32)
    limit = "auto" if isinstance(codec, S3dc) and not codec.variable else "ramp"
    for zyx in np.ndindex(*level.grid_zyx):
        z, y, x = zyx
        code = source.brick_code(0, (z, y, x))
        if code is None:
            continue
        part = (
            zerobit_bounds(codec, code)
            if isinstance(codec, Zerobit)
            else s3dc_bounds(codec, code, brick, source.dtype)
        )
        bounds[cell_box((z, y, x), part.shape).slices] = part  # type: ignore[arg-type]
    grid = [-(-n // b) for n, b in zip(level.shape_zyx, block, strict=True)]
    return block, bounds[tuple(slice(n) for n in grid)], limit


def filtered(
    source: ArraySource, codec: Codec, strength: float, *, bound_scale: float = 1
) -> NDArray[np.float64]:
    """The level as C++ filters it, in the slab's terms: 0 to 65535 or 0 to 1."""
    block, bounds, limit = level_bounds(source, codec)
    bounds = bounds * np.float32(bound_scale)
    low, high = source.value_range
    decoded = source.decoded(0)
    wanted = rational_bezier(
        decoded,
        block,
        strength,
        bounds,
        limit=limit,
        value_range=(high - low) or None,  # type: ignore[arg-type]
    ).astype(np.float64)
    if decoded.dtype.kind == "f":
        return (wanted - low) / (high - low)
    info = np.iinfo(decoded.dtype)
    return (wanted - info.min) / (float(info.max) - info.min) * 65535


def fill(
    context: GraphicsContext,
    source: ArraySource,
    box: Box,
    strength: float | None = 4,
    budget_nbytes: int = 1 << 24,
) -> NDArray[Any]:
    """The box as the slab holds it."""
    with context.current() as gl:
        filler, slab = GpuFiller(context, gl, budget_nbytes), SlabBuffer(context, gl)
        texel = SlabFormat.of(source.dtype, deblocked=strength is not None)
        level = source.levels[0].shape_zyx
        codec = source.level_codec(0)
        read = filtered_box(box, level, codec) if strength is not None else box
        try:
            slab.require(texel, box.shape_zyx)
            bricks = list(cells_touching(read, source.brick_shape_zyx))
            filler.fill(source, slab, SlabContent(source.revision, 0, 0, 0, box, strength), bricks)
            assert filler.allocated_nbytes <= budget_nbytes
            assert filler.scratch_nbytes <= scratch_nbytes(box, level, source.dtype, codec)
            dtype = {"f1": "u1", "nu2": "<u2", "f4": "<f4"}[texel.gl_dtype]
            return np.frombuffer(slab.read(), dtype).reshape(box.shape_zyx)
        finally:
            filler.forget()
            slab.release_texture()
