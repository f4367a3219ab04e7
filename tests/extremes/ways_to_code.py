"""S3Dc and zerobit there and back, by each implementation, in the values of the samples."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import S3dc, Zerobit, reference, reference_variable
from octobrick.codec import reference_zerobit as zerobit_decoder
from octobrick.codec import reference_zerobit_encoder as zerobit_encoder
from octobrick.renderer import Camera, Renderer, Slice, TransferFunction
from octobrick.renderer.context import GraphicsContext
from octobrick.store.box import Box, Zyx

from ..renderer.array_source import ArraySource
from ..renderer.gpu_slab import fill

Array = NDArray[Any]
BRICK = 16
"""Voxels of a brick along each axis: a multiple of all blocks that the tests use."""

TYPES = ("uint8", "int8", "uint16", "int16", "float32")

SLAB_ROUNDING = 2.0**-22
"""Of the range: what float32 texels relative to the range add to a decoded value."""

PICTURE_ROUNDING = 3e-4
"""Of the range: what a transfer function of 4096 colours adds."""

GREY = TransferFunction(((0.0, (0.0, 0.0, 0.0)), (1.0, (1.0, 1.0, 1.0))), ((0.0, 1.0),))


@dataclass(frozen=True)
class S3dcWay:
    """An implementation of S3Dc.

    Attributes:
        round_trip: decoded values of an array by a codec; float64 where they come from texels.
        rounding: that reading the result adds, of the array's range.
        types: that it is asked for; of pictures, which take long, those that differ most.
    """

    round_trip: Callable[[Array, S3dc], Array]
    rounding: float = 0.0
    types: tuple[str, ...] = TYPES

    def slack(self, array: Array) -> float:
        """The rounding in values."""
        return self.rounding * (float(array.max()) - float(array.min()))


def s3dc_way(name: str, graphics: GraphicsContext | None, renderer: Renderer | None) -> S3dcWay:
    """The implementation of a name."""
    if name == "numpy":
        return S3dcWay(_numpy_s3dc)
    if name == "cpp":
        return S3dcWay(lambda a, codec: codec.decode(codec.encode(a), a.shape, a.dtype))
    if name == "glsl":
        assert graphics is not None
        context = graphics
        return S3dcWay(lambda a, codec: decoded_on_gpu(context, a, codec), SLAB_ROUNDING)
    assert renderer is not None
    drawing = renderer
    return S3dcWay(
        lambda a, codec: sampled_directly(drawing, a, codec),
        PICTURE_ROUNDING,
        ("int8", "float32"),
    )


@dataclass(frozen=True)
class ZerobitWay:
    """An implementation of zerobit for scalars; `code` and `decode` are those of the codec."""

    round_trip: Callable[[Array, Zerobit], Array]
    rounding: float = 0.0

    def slack(self, array: Array) -> float:
        """The rounding of the result in values."""
        return self.rounding * (float(array.max()) - float(array.min()))


def zerobit_way(name: str, graphics: GraphicsContext | None) -> ZerobitWay:
    """The implementation of a name."""
    if name == "numpy":
        return ZerobitWay(_numpy_zerobit)
    if name == "cpp":
        return ZerobitWay(lambda a, codec: codec.decode(codec.encode(a), a.shape, a.dtype))
    assert graphics is not None
    context = graphics
    return ZerobitWay(lambda a, codec: decoded_on_gpu(context, a, codec), SLAB_ROUNDING)


def _numpy_s3dc(array: Array, codec: S3dc) -> Array:
    if codec.bits is not None:
        code = reference.encode(array, codec.block, codec.bits)
        return reference.decode(code, _shape(array), array.dtype, codec.block, codec.bits)
    assert codec.max_error is not None
    code = reference_variable.encode_bound(array, codec.block, codec.max_error)
    return reference_variable.decode(code, _shape(array), array.dtype, codec.block)


def _numpy_zerobit(array: Array, codec: Zerobit) -> Array:
    choices = zerobit_encoder.Settings(
        codec.ratio,
        codec.thresholds == "block",
        codec.ranking == "orthonormal",
        codec.count_averages,
        None if codec.background is None else np.array([codec.background], np.float64),
    )
    return zerobit_decoder.decode(zerobit_encoder.encode(array[..., None], choices))[..., 0]


def source_of(array: Array, codec: S3dc | Zerobit | None) -> ArraySource:
    """A volume of one level whose absent bricks are none: its fill value is not among them."""
    wide = array.astype(np.float64)
    fill_value = 1.0 if wide.min() > 1 or wide.max() < 1 else 0.0
    absent = fill_value if not (wide == fill_value).all() else 2.0
    window = (float(wide.min()), float(wide.max()))
    return ArraySource(array, codec=codec, brick=BRICK, nlevels=1, fill_value=absent, window=window)


def decoded_on_gpu(graphics: GraphicsContext, array: Array, codec: S3dc | Zerobit) -> Array:
    """What compute shaders make of the code, back from texels to values."""
    source = source_of(array, codec)
    return values_of(fill(graphics, source, Box.of_shape(_shape(array)), None), array)


def values_of(texels: Array, array: Array) -> Array:
    """Texels in the values of a volume: offset-binary, or relative to the range."""
    if array.dtype.kind == "f":
        low, high = float(array.min()), float(array.max())
        return low + texels.astype(np.float64) * (high - low)
    return (texels.astype(np.int64) + np.iinfo(array.dtype).min).astype(array.dtype)


def sampled_directly(renderer: Renderer, array: Array, codec: S3dc) -> Array:
    """Each plane across z as a slice that shows the nearest voxels straight from the code."""
    nz, ny, nx = array.shape
    low, high = float(array.min()), float(array.max())
    beside = max(1.0, abs(low) * 2.0**-23)
    window = (low, high) if low < high else (low - beside, low + beside)
    middle = ((nx - 1) / 2, (ny - 1) / 2)
    camera = Camera((*middle, -50.0), (*middle, 0.0), (0.0, -1.0, 0.0), None, float(min(nx, ny)))
    source = source_of(array, codec)
    planes = [
        renderer.render(
            source, camera, GREY, (nx, ny), window=window, direct="nearest", level=0,
            mode=Slice((0.0, 0.0, float(z)), (0.0, 0.0, 1.0)),
        ).premultiplied[..., 0]
        for z in range(nz)
    ]  # fmt: skip
    return window[0] + np.stack(planes).astype(np.float64) * (window[1] - window[0])


def _shape(array: Array) -> Zyx:
    z, y, x = array.shape
    return z, y, x
