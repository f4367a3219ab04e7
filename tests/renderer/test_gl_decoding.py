"""What the GPU decodes is what the codec decodes, bit for bit."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import moderngl
import numpy as np
import pytest
from numpy.typing import NDArray

from octobrick.codec import S3dc, Zerobit
from octobrick.codec.errors import CorruptBrickError, ResourceError
from octobrick.renderer.code_layout import CodeLayout
from octobrick.renderer.context import GraphicsContext
from octobrick.renderer.gpu_filler import GpuFiller
from octobrick.renderer.slab_buffer import SlabBuffer
from octobrick.renderer.slab_filler import SlabContent
from octobrick.renderer.slab_format import DIRECTIONS, SlabFormat
from octobrick.store.box import Box, Zyx, cell_box, cells_touching

from .array_source import ArraySource

pytestmark = pytest.mark.gl

DTYPES = ["uint8", "int8", "uint16", "int16", "float32"]


@pytest.fixture(scope="module")
def context() -> Iterator[GraphicsContext]:
    context = GraphicsContext()
    yield context
    context.release()


@pytest.fixture
def gl(context: GraphicsContext) -> Iterator[moderngl.Context]:
    with context.current() as gl:
        yield gl


def noise(shape: tuple[int, ...], dtype: str, seed: int = 0) -> NDArray[Any]:
    """Neighbourhoods of every width, so that blocks have every range; full range of the type."""
    rng = np.random.default_rng(seed)
    smooth = np.add.outer(np.add.outer(*(np.linspace(0, 1, n) for n in shape[:2])), np.ones(1))
    unit = smooth / 2 + rng.normal(size=shape) * rng.choice([0, 0.01, 0.3], shape[2])
    unit[0, 0, :2] = -10, 10
    if np.dtype(dtype).kind == "f":
        return (unit * 123.4).astype(dtype)
    info = np.iinfo(dtype)
    return np.clip(info.min + unit * (float(info.max) - info.min), info.min, info.max).astype(dtype)


def decode(
    context: GraphicsContext,
    gl: moderngl.Context,
    source: ArraySource,
    box: Box,
    budget_nbytes: int = 1 << 24,
) -> NDArray[Any]:
    """The box's voxels as the slab texture holds them."""
    filler, slab = GpuFiller(context, gl, budget_nbytes), SlabBuffer(context, gl)
    try:
        slab.require(SlabFormat.of(source.dtype), box.shape_zyx)
        bricks = list(cells_touching(box, source.brick_shape_zyx))
        content = SlabContent(source.revision, 0, 0, 0, box)
        filled = filler.fill(source, slab, content, bricks)
        assert filled.nvoxels == box.nvoxels
        assert filler.allocated_nbytes <= budget_nbytes
        raw = np.frombuffer(
            slab.read(),
            {"f1": "u1", "nu2": "<u2", "f4": "<f4"}[SlabFormat.of(source.dtype).gl_dtype],
        )
    finally:
        filler.forget()
        slab.release_texture()
    return raw.reshape(box.shape_zyx)


def as_stored(voxels: NDArray[Any], value_range: tuple[float, float]) -> NDArray[Any]:
    """The same voxels in the slab's terms: offset-binary, or relative to the range."""
    if voxels.dtype.kind == "f":
        low, high = (np.float64(np.float32(bound)) for bound in value_range)
        return ((voxels.astype(np.float64) - low) / (high - low)).astype(np.float32)
    info = np.iinfo(voxels.dtype)
    return (voxels.astype(np.int32) - info.min).astype(f"u{voxels.dtype.itemsize}")


@pytest.mark.parametrize("bits", range(1, 9))
@pytest.mark.parametrize("dtype", DTYPES)
def test_every_type_and_width_decodes_as_the_codec_does(
    context: GraphicsContext, gl: moderngl.Context, dtype: str, bits: int
) -> None:
    voxels = noise((19, 30, 41), dtype, seed=bits)
    source = ArraySource(voxels, codec=S3dc(bits=bits), brick=16, nlevels=1)
    found = decode(context, gl, source, Box.of_shape(voxels.shape))
    wanted = as_stored(source.decoded(0), source.value_range)
    np.testing.assert_array_equal(found, wanted)


@pytest.mark.parametrize("block", [(4, 4, 4), (1, 1, 1), (3, 5, 7), (16, 2, 6), (40, 40, 40)])
@pytest.mark.parametrize("bits", [3, 4, 7])
def test_every_block_decodes_as_the_codec_does(
    context: GraphicsContext, gl: moderngl.Context, block: tuple[int, int, int], bits: int
) -> None:
    voxels = noise((20, 21, 37), "uint16")
    source = ArraySource(voxels, codec=S3dc(block, bits), brick=(9, 12, 21), nlevels=1)
    found = decode(context, gl, source, Box.of_shape(voxels.shape))
    np.testing.assert_array_equal(found, as_stored(source.decoded(0), source.value_range))


CODECS: dict[str, S3dc | Zerobit] = {
    "no error": S3dc(max_error=0),  # widths of 0 to 14 bits, and raw blocks
    "error 3": S3dc(max_error=3),
    "3 bits a voxel, 4³ blocks": S3dc((4, 4, 4), bits_per_voxel=3),
    "slope, odd blocks": S3dc((8, 4, 3), slope=2.0),
    "trained, 1 bit": S3dc(bits=1, scale="trained"),
    "trained, 3 bits": S3dc((5, 8, 4), bits=3, scale="trained"),
    "trained, 8 bits": S3dc(bits=8, scale="trained"),
    "fitted": S3dc(bits=2, fitted=True),
    "zerobit": Zerobit(0.1),
    "zerobit, all details": Zerobit(1),
    "zerobit, no details": Zerobit(0, background=5),
}


@pytest.mark.parametrize("codec", CODECS.values(), ids=CODECS.keys())
@pytest.mark.parametrize(
    ("dtype", "brick"), [*((dtype, (16, 16, 16)) for dtype in DTYPES), ("int16", (9, 12, 21))]
)
def test_every_form_of_code_decodes_as_the_codec_does(
    context: GraphicsContext,
    gl: moderngl.Context,
    dtype: str,
    codec: S3dc | Zerobit,
    brick: tuple[int, int, int],
) -> None:
    voxels = noise((19, 20, 41), dtype)
    voxels[:, 8:, 20:] = voxels[5, 5, 5]  # constant blocks and null cells
    source = ArraySource(voxels, codec=codec, brick=brick, nlevels=1)
    found = decode(context, gl, source, Box.of_shape(voxels.shape))
    np.testing.assert_array_equal(found, as_stored(source.decoded(0), source.value_range))


def test_zerobit_codes_that_share_a_codebook_decode_as_the_codec_does(
    context: GraphicsContext, gl: moderngl.Context
) -> None:
    for dtype in ("int16", "uint8", "float32"):
        voxels = noise((20, 30, 41), dtype)
        codec = Zerobit(0.2, Zerobit.train([voxels], like=Zerobit(0.2)))
        source = ArraySource(voxels, codec=codec, brick=16, nlevels=1)
        found = decode(context, gl, source, Box.of_shape(voxels.shape))
        np.testing.assert_array_equal(found, as_stored(source.decoded(0), source.value_range))


@pytest.mark.parametrize("codec", [S3dc(), S3dc(bits=3), None, S3dc(max_error=9), Zerobit(0.1)])
@pytest.mark.parametrize("box", [Box((3, 5, 7), (20, 22, 39)), Box((15, 16, 17), (18, 17, 33))])
def test_a_box_within_bricks_decodes_no_voxel_more_or_less(
    context: GraphicsContext, gl: moderngl.Context, box: Box, codec: S3dc | Zerobit | None
) -> None:
    voxels = noise((24, 30, 41), "uint8")
    source = ArraySource(voxels, codec=codec, brick=16, nlevels=1)
    found = decode(context, gl, source, box)
    np.testing.assert_array_equal(found, source.decoded(0)[box.slices])


@pytest.mark.parametrize("dtype", DTYPES)
def test_lossless_bricks_decode_to_the_original(
    context: GraphicsContext, gl: moderngl.Context, dtype: str
) -> None:
    voxels = noise((19, 20, 35), dtype)
    source = ArraySource(voxels, codec=None, brick=16, nlevels=1)
    found = decode(context, gl, source, Box.of_shape(voxels.shape))
    np.testing.assert_array_equal(found, as_stored(voxels, source.value_range))


@pytest.mark.parametrize("dtype", DTYPES)
def test_absent_bricks_decode_to_the_fill_value(
    context: GraphicsContext, gl: moderngl.Context, dtype: str
) -> None:
    voxels = np.zeros((16, 16, 48), dtype)
    voxels[:, :, 40:] = 3
    voxels[0, 0, 47] = 99
    source = ArraySource(voxels, codec=S3dc(bits=8), brick=16, nlevels=1)
    assert source.brick_code(0, (0, 0, 0)) is None
    found = decode(context, gl, source, Box.of_shape(voxels.shape))
    np.testing.assert_array_equal(found, as_stored(source.decoded(0), source.value_range))


def test_float_blocks_whose_range_exceeds_float32_decode_to_finite_voxels(
    context: GraphicsContext, gl: moderngl.Context
) -> None:
    voxels = np.linspace(-3.4e38, 3.4e38, 16**3, dtype=np.float64).astype(np.float32)
    source = ArraySource(voxels.reshape(16, 16, 16), codec=S3dc(), brick=16)
    found = decode(context, gl, source, Box.of_shape((16, 16, 16)))
    np.testing.assert_array_equal(found, as_stored(source.decoded(0), source.value_range))
    assert found.min() == 0
    assert found.max() == 1


def test_a_constant_float_volume_is_stored_as_zeros(
    context: GraphicsContext, gl: moderngl.Context
) -> None:
    source = ArraySource(np.full((9, 9, 9), 7.25, np.float32), codec=S3dc(), brick=16)
    assert not decode(context, gl, source, Box.of_shape((9, 9, 9))).any()


@pytest.mark.parametrize("nbricks", [1, 2, 5])
def test_a_pool_of_few_bricks_decodes_all_in_batches(
    context: GraphicsContext, gl: moderngl.Context, nbricks: int
) -> None:
    voxels = noise((40, 40, 40), "uint8")
    source = ArraySource(voxels, codec=S3dc(), brick=16, nlevels=1)
    budget = nbricks * CodeLayout.of(source, 0).code_nbytes
    found = decode(context, gl, source, Box.of_shape(voxels.shape), budget)
    np.testing.assert_array_equal(found, source.decoded(0))


def test_a_budget_below_one_brick_is_refused_with_both_sizes(
    context: GraphicsContext, gl: moderngl.Context
) -> None:
    source = ArraySource(noise((16, 16, 16), "uint8"), codec=S3dc(), brick=16)
    nbytes = CodeLayout.of(source, 0).code_nbytes
    with pytest.raises(ResourceError, match=f"{nbytes} bytes, more than the {nbytes - 1} bytes"):
        decode(context, gl, source, Box.of_shape((16, 16, 16)), nbytes - 1)


def test_a_brick_of_the_wrong_length_is_refused_by_its_position(
    context: GraphicsContext, gl: moderngl.Context
) -> None:
    source = ArraySource(noise((16, 16, 32), "uint8"), codec=S3dc(), brick=16)
    source.brick_code = lambda *_: b"short"  # type: ignore[assignment]
    with pytest.raises(CorruptBrickError, match=r"brick \(0, 0, 0\) of level 0: 5 bytes"):
        decode(context, gl, source, Box.of_shape((16, 16, 32)))


class DirectionSource:
    """Codes of directions, brick by brick; the last brick along x is absent."""

    brick_shape_zyx = (8, 12, 9)

    def __init__(self, codes: NDArray[np.uint8]) -> None:
        self.codes = codes

    def code(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> bytes | None:
        assert (level, t, c) == (1, 2, 3)
        box = cell_box(zyx, self.brick_shape_zyx)
        return None if zyx[2] == 2 else self.codes[box.slices].tobytes()


@pytest.mark.parametrize("box", [Box((0, 0, 0), (16, 24, 27)), Box((3, 5, 7), (9, 13, 26))])
def test_directions_come_as_they_are_stored_and_absent_ones_as_none(
    context: GraphicsContext, gl: moderngl.Context, box: Box
) -> None:
    source = DirectionSource(np.random.default_rng(0).integers(0, 256, (16, 24, 27, 3), np.uint8))
    wanted = source.codes.copy()
    wanted[:, :, 18:] = 128
    filler, slab = GpuFiller(context, gl, 1 << 20), SlabBuffer(context, gl)
    slab.require(DIRECTIONS, box.shape_zyx)
    content = SlabContent("r", 1, 2, 3, box)
    bricks = list(cells_touching(box, source.brick_shape_zyx))
    filled = filler.fill_directions(source, slab, content, bricks)
    assert filled.nvoxels == box.nvoxels
    assert filled.nabsent == sum(zyx[2] == 2 for zyx in bricks)
    found = np.frombuffer(slab.read(), np.uint8).reshape(*box.shape_zyx, 4)
    np.testing.assert_array_equal(found[..., :3], wanted[box.slices])
    assert filler.fill_directions(source, slab, content, bricks).nvoxels == 0
    filler.forget()
    slab.release_texture()
