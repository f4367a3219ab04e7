"""Deblocking and gradients by each implementation, in the values of the samples."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import S3dc, gradients, reference_deblock, reference_gradients
from octobrick.codec.deblock import rational_bezier
from octobrick.renderer.context import GraphicsContext
from octobrick.renderer.shader_source import VERSION_LINE
from octobrick.store.box import Box

from ..renderer.array_source import ArraySource
from ..renderer.gpu_slab import fill, level_bounds
from .ways_to_code import source_of

Array = NDArray[Any]
GPU_ROUNDING = {"u": 0.53 / 65535, "i": 0.53 / 65535, "f": 1e-5}
"""Of the range of the type, or of a float volume: texels of 16 bits, and float32 arithmetic."""


@dataclass(frozen=True)
class Filtered:
    """What a filter made of a code.

    Attributes:
        decoded: voxels before, float64.
        voxels: after, float64.
        bounds: that they were given, per voxel.
        rounding: of the result, in values.
    """

    decoded: Array
    voxels: Array
    bounds: Array
    rounding: float

    def require_promises(self) -> None:
        """Finite, between the least and the greatest voxel, moved by no more than the bound."""
        assert np.isfinite(self.voxels).all()
        assert self.voxels.min() >= self.decoded.min() - self.rounding
        assert self.voxels.max() <= self.decoded.max() + self.rounding
        moved = np.abs(self.voxels - self.decoded)
        rounded = self.rounding + 2.0**-23 * np.abs(self.decoded) + 2.0**-149
        assert (moved <= self.bounds.astype(np.float64) + rounded).all()


@dataclass(frozen=True)
class DeblockingWay:
    """An implementation of the filter, of S3Dc codes with their own bounds."""

    run: Callable[[ArraySource, S3dc, float], Array]
    on_gpu: bool = False

    def filtered(self, array: Array, codec: S3dc, strength: float = 4) -> Filtered:
        """A volume coded, decoded and filtered."""
        source = source_of(array, codec)
        block, per_block, _ = level_bounds(source, codec)
        bounds = per_block
        for axis, size in enumerate(block):
            bounds = np.repeat(bounds, size, axis)
        bounds = bounds[tuple(slice(n) for n in array.shape)]
        rounding = 0.0
        if self.on_gpu:
            ends = np.iinfo(array.dtype) if array.dtype.kind != "f" else None
            low, high = source.value_range if ends is None else (ends.min, ends.max)
            rounding = GPU_ROUNDING[array.dtype.kind] * (float(high) - float(low))
        decoded = source.decoded(0).astype(np.float64)
        return Filtered(decoded, self.run(source, codec, strength), bounds, rounding)


def deblocking_way(name: str, graphics: GraphicsContext | None) -> DeblockingWay:
    """The implementation of a name."""
    if name == "numpy":
        return DeblockingWay(_numpy_filter)
    if name == "cpp":
        return DeblockingWay(_cpp_filter)
    assert graphics is not None
    context = graphics
    return DeblockingWay(lambda s, codec, strength: _gpu_filter(context, s, strength), on_gpu=True)


def _cpp_filter(source: ArraySource, codec: S3dc, strength: float) -> Array:
    block, bounds, limit = level_bounds(source, codec)
    low, high = source.value_range
    return rational_bezier(
        source.decoded(0),
        block,
        strength,
        bounds,
        limit=limit,  # type: ignore[arg-type]
        value_range=(high - low) or None,
    ).astype(np.float64)


def _numpy_filter(source: ArraySource, codec: S3dc, strength: float) -> Array:
    block, bounds, limit = level_bounds(source, codec)
    for axis, size in enumerate(block):
        bounds = np.repeat(bounds, size, axis)
    decoded = source.decoded(0)
    bounds = bounds[tuple(slice(n) for n in decoded.shape)]
    low, high = source.value_range
    return reference_deblock.rational_bezier(
        decoded, block, strength, bounds, limit=limit, value_range=(high - low) or None
    ).astype(np.float64)


def _gpu_filter(graphics: GraphicsContext, source: ArraySource, strength: float) -> Array:
    nz, ny, nx = source.levels[0].shape_zyx
    texels = fill(graphics, source, Box.of_shape((nz, ny, nx)), strength).astype(np.float64)
    if source.dtype.kind == "f":
        low, high = source.value_range
        return low + texels * (high - low)
    info = np.iinfo(source.dtype)
    return info.min + texels / 65535 * (float(info.max) - info.min)


@dataclass(frozen=True)
class GradientWay:
    """An implementation of gradients: those of shaders decode what C++ found and encoded."""

    differences: Callable[..., Array]
    reduce: Callable[[Array], Array]
    coded: Callable[[Array], Array]


def gradient_way(name: str, graphics: GraphicsContext | None) -> GradientWay:
    """The implementation of a name."""
    if name == "numpy":
        there_and_back = reference_gradients.decode_directions
        return GradientWay(
            reference_gradients.central_differences,
            reference_gradients.reduce,
            lambda v: there_and_back(reference_gradients.encode_directions(v)),
        )
    coded: Callable[[Array], Array]
    if name == "cpp":
        coded = lambda v: gradients.decode_directions(gradients.encode_directions(v))  # noqa: E731
    else:
        assert graphics is not None
        context = graphics
        coded = lambda v: gpu_directions(context, gradients.encode_directions(v))  # noqa: E731
    return GradientWay(gradients.central_differences, gradients.reduce, coded)


_PROBE = """
layout(local_size_x = 64) in;
const int CHANNELS = 1;
const vec3 content_low_voxel = vec3(0), content_high_voxel = vec3(1);
layout(std430, binding = 0) readonly buffer Codes { uint codes[]; };
layout(std430, binding = 1) writeonly buffer Vectors { float vectors[]; };
"""
_MAIN = """
void main() {
    uint at = gl_GlobalInvocationID.x;
    if (at >= codes.length()) return;
    vec3 found = decode_direction(2.0 * unpackUnorm4x8(codes[at]).xyz - 1.0);
    float size = length(found);
    if (size > 0.0) found /= size;
    for (int k = 0; k < 3; ++k) vectors[3u * at + uint(k)] = found[k];
}
"""


def gpu_directions(graphics: GraphicsContext, codes: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Unit vectors of codes (…, 3) as `directions.glsl` decodes them, 0 for the code of zero."""
    flat = codes.reshape(-1, 3)
    folder = resources.files("octobrick.renderer") / "shaders"
    text = (folder / "directions.glsl").read_text("utf-8").replace("${CHANNELS}", "1")
    words = np.zeros((len(flat), 4), np.uint8)
    words[:, :3] = flat
    with graphics.current() as gl:
        program = gl.compute_shader(VERSION_LINE + _PROBE + text + _MAIN)
        given, made = gl.buffer(words.tobytes()), gl.buffer(reserve=12 * len(flat))
        try:
            given.bind_to_storage_buffer(0)
            made.bind_to_storage_buffer(1)
            program.run(group_x=-(-len(flat) // 64))
            found = np.frombuffer(made.read(), np.float32)
        finally:
            for thing in (program, given, made):
                thing.release()
    return found.reshape(codes.shape)
