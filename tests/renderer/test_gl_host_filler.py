"""What the CPU puts into slabs is what the codec decodes, what shaders put there, and filters."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import moderngl
import numpy as np
import pytest
from numpy.typing import NDArray

from octobrick.codec import S3dc, Zerobit, deblock
from octobrick.codec.errors import CorruptBrickError, ResourceError, UnsupportedError
from octobrick.renderer.brick_loader import BrickLoader
from octobrick.renderer.context import GraphicsContext
from octobrick.renderer.filter_margin import filter_block, filter_margin
from octobrick.renderer.gpu_filler import GpuFiller
from octobrick.renderer.host_filler import HostFiller
from octobrick.renderer.slab_buffer import SlabBuffer
from octobrick.renderer.slab_filler import Filled, SlabContent
from octobrick.renderer.slab_format import DIRECTIONS, SlabFormat
from octobrick.renderer.slabs import power_of_two
from octobrick.store.box import Box, Zyx, cells_touching, grid_of

from .array_source import ArraySource, SlowFirstLevel

pytestmark = pytest.mark.gl

DTYPES = ["uint8", "int8", "uint16", "int16", "float32"]
BOXES = [
    Box((0, 0, 0), (24, 30, 41)),
    Box((3, 5, 7), (20, 22, 39)),
    Box((14, 15, 17), (18, 17, 33)),
]
Texels = NDArray[Any]


@pytest.fixture(scope="module")
def context() -> Iterator[GraphicsContext]:
    context = GraphicsContext()
    yield context
    context.release()


@pytest.fixture
def gl(context: GraphicsContext) -> Iterator[moderngl.Context]:
    with context.current() as gl:
        yield gl


def blobs(shape: Zyx, dtype: str, seed: int = 0) -> NDArray[Any]:
    """Smooth matter with noise over the whole range of the type, in empty space."""
    rng = np.random.default_rng(seed)
    z, y, x = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape), indexing="ij")
    unit = np.clip(1 - (z + 0.3) ** 2 - y**2 - 2 * x**2 + rng.normal(size=shape) / 20, 0, 1)
    unit[-8:] = 0
    unit[0, 0, :2] = 0, 1
    if np.dtype(dtype).kind == "f":
        return (unit * 123.4 - 20).astype(dtype)
    info = np.iinfo(dtype)
    return (info.min + unit * (float(info.max) - info.min)).astype(dtype)


class AnySource(ArraySource):
    """An `ArraySource` of any codec, S3Dc at a variable rate and zerobit included."""

    def level_codec(self, level: int) -> Any:
        return self.codec


def fill(
    filler: Any, context: GraphicsContext, gl: moderngl.Context, source: Any, content: SlabContent
) -> tuple[Texels, Filled]:
    """The texels of the content's box, from a texture of larger sides; with the filter's bricks."""
    texel = SlabFormat.of(source.dtype, deblocked=content.deblocking is not None)
    slab = SlabBuffer(context, gl)
    sides = tuple(2 * power_of_two(n) for n in content.box.shape_zyx)
    slab.require(texel, (sides[0], sides[1], sides[2]))
    margin = max(filter_margin(source.level_codec(0))) if content.deblocking is not None else 0
    level = Box.of_shape(source.levels[content.level].shape_zyx)
    around = content.box.grow(margin).intersect(level)
    try:
        bricks = list(cells_touching(around, source.brick_shape_zyx))
        filled = filler.fill(source, slab, content, bricks)
        assert slab.holds(content, bricks) == (filled.nsubstituted == 0)
        raw = np.frombuffer(slab.read(), {"f1": "u1", "nu2": "<u2", "f4": "<f4"}[texel.gl_dtype])
    finally:
        slab.release_texture()
    texels = raw.reshape(sides)
    assert np.isfinite(texels).all()
    return texels[Box.of_shape(content.box.shape_zyx).slices], filled


def content_of(source: ArraySource, box: Box, deblocking: float | None = None) -> SlabContent:
    return SlabContent(source.revision, 0, 0, 0, box, deblocking)


def as_stored(voxels: NDArray[Any], value_range: tuple[float, float]) -> Texels:
    if voxels.dtype.kind == "f":
        low, high = (np.float64(np.float32(bound)) for bound in value_range)
        return ((voxels.astype(np.float64) - low) / (high - low)).astype(np.float32)
    return (voxels.astype(np.int32) - np.iinfo(voxels.dtype).min).astype(f"u{voxels.itemsize}")


@pytest.mark.parametrize("box", BOXES)
@pytest.mark.parametrize("codec", [S3dc(), S3dc((4, 4, 4), 3), None], ids=str)
@pytest.mark.parametrize("dtype", DTYPES)
def test_cpu_and_gpu_give_the_same_texels(
    context: GraphicsContext, gl: moderngl.Context, dtype: str, codec: S3dc | None, box: Box
) -> None:
    source = ArraySource(blobs((24, 30, 41), dtype), codec=codec, brick=16, nlevels=1)
    content = content_of(source, box)
    gpu = GpuFiller(context, gl, 1 << 24)
    host = HostFiller(context, gl, 1 << 24)
    found, filled = fill(host, context, gl, source, content)
    wanted, _ = fill(gpu, context, gl, source, content)
    gpu.forget()
    np.testing.assert_array_equal(found, wanted)
    np.testing.assert_array_equal(
        found, as_stored(source.decoded(0)[box.slices], source.value_range)
    )
    assert filled.nvoxels == box.nvoxels


@pytest.mark.parametrize("box", BOXES)
@pytest.mark.parametrize(
    "codec", [S3dc((4, 4, 4), max_error=2), S3dc(bits=4, scale="trained"), Zerobit(0.1)], ids=str
)
def test_codes_that_shaders_do_not_know_are_decoded(
    context: GraphicsContext, gl: moderngl.Context, codec: Any, box: Box
) -> None:
    source = AnySource(blobs((24, 30, 41), "int16"), codec=codec, brick=16, nlevels=1)
    host = HostFiller(context, gl, 1 << 24)
    found, _ = fill(host, context, gl, source, content_of(source, box))
    np.testing.assert_array_equal(found, as_stored(source.decoded(0)[box.slices], (0, 1)))


def test_a_volume_with_a_codec_of_its_own_decodes_itself(
    context: GraphicsContext, gl: moderngl.Context
) -> None:
    source: Any = ArraySource(blobs((24, 30, 41), "uint8"), brick=16, nlevels=1)
    whole = source.brick
    source.level_codec = lambda _: "morse"
    host = HostFiller(context, gl, 1 << 24)
    source.brick = lambda level, zyx, t, c: whole(level, zyx)
    found, _ = fill(host, context, gl, source, content_of(source, BOXES[1]))
    np.testing.assert_array_equal(found, source.arrays[0][BOXES[1].slices])


# Deblocking


def filtered_level(source: Any, strength: float) -> NDArray[np.float32]:
    """All of level 0 filtered at once, with the bounds of its bricks."""
    level, codec = source.levels[0], source.codec
    block = filter_block(codec)
    assert block is not None
    per_brick = grid_of(source.brick_shape_zyx, block)
    bounds = np.zeros([a * b for a, b in zip(level.grid_zyx, per_brick, strict=True)], np.float32)
    for zyx in np.ndindex(*level.grid_zyx):
        code = source.brick_code(0, zyx)
        if code is None:
            continue
        place = tuple(slice(i * n, i * n + n) for i, n in zip(zyx, per_brick, strict=True))
        if isinstance(codec, Zerobit):
            bounds[place] = deblock.zerobit_bounds(codec, code)
        else:
            shape, dtype = source.brick_shape_zyx, source.dtype
            bounds[place] = deblock.s3dc_bounds(codec, code, shape, dtype)
    bounds = bounds[Box.of_shape(grid_of(level.shape_zyx, block)).slices]
    limit: Any = "auto" if isinstance(codec, S3dc) and not codec.variable else "ramp"
    voxels, ends = source.decoded(0), source.value_range
    return deblock.rational_bezier(voxels, block, strength, bounds, limit=limit, value_range=ends)


@pytest.mark.parametrize("dtype", ["uint8", "int16", "float32"])
@pytest.mark.parametrize(
    "codec", [S3dc((4, 4, 4), 2), S3dc((4, 4, 4), max_error=9), Zerobit(0.05)], ids=str
)
def test_slabs_are_filtered_as_the_whole_level_wherever_they_are_cut(
    context: GraphicsContext, gl: moderngl.Context, codec: Any, dtype: str
) -> None:
    source = AnySource(blobs((40, 45, 51), dtype), codec=codec, brick=16, nlevels=1)
    whole = filtered_level(source, 4)
    assert (whole != source.decoded(0)).any()
    wanted = as_stored(whole, source.value_range)
    if dtype != "float32":
        info = np.iinfo(dtype)
        wanted = (whole.astype(np.float64) - info.min) * 65535 / (float(info.max) - info.min)
    host = HostFiller(context, gl, 1 << 24)
    found, _ = fill(host, context, gl, source, content_of(source, Box.of_shape(whole.shape), 4))
    difference = np.abs(found - wanted)
    assert difference.max() <= (0 if dtype == "float32" else 0.51)
    for box in [Box((9, 0, 3), (15, 45, 40)), Box((17, 16, 7), (19, 33, 8))]:
        part, _ = fill(host, context, gl, source, content_of(source, box, 4))
        np.testing.assert_array_equal(part, found[box.slices])


def test_what_has_no_blocks_is_not_filtered_but_has_the_format(
    context: GraphicsContext, gl: moderngl.Context
) -> None:
    source = ArraySource(blobs((24, 30, 41), "uint8"), brick=16, nlevels=1)
    host = HostFiller(context, gl, 1 << 24)
    found, _ = fill(host, context, gl, source, content_of(source, BOXES[1], 4))
    np.testing.assert_array_equal(found, source.arrays[0][BOXES[1].slices].astype(int) * 257)


def test_blocks_that_do_not_divide_bricks_are_not_filtered_but_refused(
    context: GraphicsContext, gl: moderngl.Context
) -> None:
    source = ArraySource(blobs((24, 30, 41), "uint8"), codec=S3dc((5, 4, 4)), brick=16, nlevels=1)
    host = HostFiller(context, gl, 1 << 24)
    with pytest.raises(UnsupportedError, match=r"blocks of \(5, 4, 4\)"):
        fill(host, context, gl, source, content_of(source, BOXES[0], 4))


@pytest.mark.parametrize(("block", "margin"), [(8, 12), (4, 6), (5, 7), (1, 1)])
def test_the_margin_is_a_block_and_a_half(block: int, margin: int) -> None:
    assert filter_margin(S3dc((block,) * 3, 4)) == (margin,) * 3
    assert filter_margin(Zerobit()) == (6, 6, 6)
    assert filter_margin(None) == (0, 0, 0)


# Memory


def test_bricks_are_read_once_and_never_take_more_than_the_budget(
    context: GraphicsContext, gl: moderngl.Context
) -> None:
    source = ArraySource(blobs((40, 40, 40), "uint8"), codec=S3dc(), brick=16, nlevels=1)
    contents = [content_of(source, Box((0, 0, 0), (40, 40, n))) for n in (40, 39)]
    code_nbytes = S3dc().encoded_nbytes((16, 16, 16), "uint8")
    for budget, again in ((1 << 24, 0), (5 * code_nbytes, 1), (code_nbytes, 1)):
        host = HostFiller(context, gl, budget)
        fill(host, context, gl, source, contents[0])
        assert host.resident_nbytes <= host.allocated_nbytes <= budget
        before = source.reads
        found, _ = fill(host, context, gl, source, contents[1])
        np.testing.assert_array_equal(found, source.decoded(0)[contents[1].box.slices])
        assert (source.reads > before) == bool(again)
        assert host.allocated_nbytes <= budget
        host.forget()
        assert host.resident_nbytes == 0


def test_a_budget_below_one_brick_is_refused_with_both_sizes(
    context: GraphicsContext, gl: moderngl.Context
) -> None:
    source = ArraySource(blobs((16, 16, 16), "uint8"), codec=S3dc(), brick=16)
    nbytes = S3dc().encoded_nbytes((16, 16, 16), "uint8")
    host = HostFiller(context, gl, nbytes - 1)
    with pytest.raises(ResourceError, match=f"{nbytes} bytes, more than the {nbytes - 1} bytes"):
        fill(host, context, gl, source, content_of(source, Box.of_shape((16, 16, 16))))


def test_a_slab_that_holds_the_content_is_left_alone(
    context: GraphicsContext, gl: moderngl.Context
) -> None:
    source = ArraySource(blobs((16, 16, 16), "uint8"), codec=S3dc(), brick=16)
    host, slab = HostFiller(context, gl, 1 << 20), SlabBuffer(context, gl)
    slab.require(SlabFormat.of(source.dtype), (16, 16, 16))
    content = content_of(source, Box.of_shape((16, 16, 16)))
    assert host.fill(source, slab, content, [(0, 0, 0)]).nbricks == 1
    assert host.fill(source, slab, content, [(0, 0, 0)]) == Filled()
    slab.release_texture()


@pytest.mark.parametrize(
    ("dtype", "codec", "code"),
    [
        ("uint8", S3dc(), b"short"),
        ("uint8", S3dc((4, 4, 4), max_error=2), b"\xff" * 3000),
        ("uint8", Zerobit(), b"\xff" * 3000),
        ("uint8", None, b"short"),
        ("float32", None, np.full(16**3, np.nan, "<f4").tobytes()),
        ("float32", S3dc(), np.full(3000, np.inf, "<f4").tobytes()),
    ],
)
@pytest.mark.parametrize("deblocking", [None, 4.0])
def test_hostile_codes_name_the_brick(
    context: GraphicsContext,
    gl: moderngl.Context,
    dtype: str,
    codec: Any,
    code: bytes,
    deblocking: float | None,
) -> None:
    source: Any = AnySource(blobs((16, 16, 48), dtype), codec=codec, brick=16)
    sound = source.brick_code
    source.brick_code = lambda level, zyx, t, c: (
        code if zyx == (0, 0, 1) else sound(level, zyx, t, c)
    )
    host = HostFiller(context, gl, 1 << 24)
    content = content_of(source, Box((0, 0, 2), (16, 16, 46)), deblocking)
    with pytest.raises(CorruptBrickError, match=r"brick \(0, 0, 1\) of level 0"):
        fill(host, context, gl, source, content)


# Loading


class Gradients:
    """Random directions of level 0, but for one brick."""

    levels = (0,)
    brick_shape_zyx = (16, 16, 16)

    def __init__(self) -> None:
        self.codes = np.random.default_rng(1).integers(0, 256, (32, 16, 16, 3)).astype(np.uint8)

    def code(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> bytes | None:
        assert (level, t, c) == (0, 0, 0)
        return self.codes[:16].tobytes() if zyx == (0, 0, 0) else None


def test_directions_are_the_stored_bytes_and_128_where_there_are_none(
    context: GraphicsContext, gl: moderngl.Context
) -> None:
    host, slab, gradients = HostFiller(context, gl, 1 << 20), SlabBuffer(context, gl), Gradients()
    slab.require(DIRECTIONS, (32, 16, 16))
    content = SlabContent("g", 0, 0, 0, Box((2, 0, 3), (30, 16, 16)))
    filled = host.fill_directions(gradients, slab, content, [(0, 0, 0), (1, 0, 0)])
    texels = np.frombuffer(slab.read(), np.uint8).reshape(32, 16, 16, 4)[:28, :, :13, :3]
    slab.release_texture()
    assert filled == Filled(28 * 16 * 13, 2, 1)
    np.testing.assert_array_equal(texels[:14], gradients.codes[2:16, :, 3:])
    assert (texels[14:] == 128).all()


def test_a_loader_reads_what_is_missing_and_the_texels_are_the_same(
    context: GraphicsContext, gl: moderngl.Context
) -> None:
    source = ArraySource(blobs((40, 40, 40), "uint8"), codec=S3dc(), brick=16, nlevels=1)
    with BrickLoader(threads=2) as loader:
        host = HostFiller(context, gl, 1 << 24, loader)
        found, _ = fill(host, context, gl, source, content_of(source, Box.of_shape((40, 40, 40))))
        assert loader.stats.read_nbytes == host.uploaded_nbytes
    np.testing.assert_array_equal(found, source.decoded(0))


def test_without_waiting_bricks_are_shown_by_the_finest_coarser_level_until_they_are_there(
    context: GraphicsContext, gl: moderngl.Context
) -> None:
    source = SlowFirstLevel(blobs((32, 32, 32), "uint8"), codec=S3dc(), brick=16)
    box = Box((3, 2, 1), (32, 31, 30))
    with BrickLoader(threads=1) as loader:
        host = HostFiller(context, gl, 1 << 24, loader)
        host.waits = False
        found, filled = fill(host, context, gl, source, content_of(source, box))
        coarse = source.decoded(1).repeat(2, 0).repeat(2, 1).repeat(2, 2)
        np.testing.assert_array_equal(found, coarse[box.slices])
        assert filled.nsubstituted == 8
        assert filled.nbricks == 0
        source.release.set()
        host.waits = True
        found, filled = fill(host, context, gl, source, content_of(source, box))
        np.testing.assert_array_equal(found, source.decoded(0)[box.slices])
        assert filled.nsubstituted == 0


def test_the_coarsest_level_is_never_pushed_out(
    context: GraphicsContext, gl: moderngl.Context
) -> None:
    source = SlowFirstLevel(blobs((32, 32, 32), "uint8"), codec=S3dc(), brick=16)
    source.release.set()
    code_nbytes = S3dc().encoded_nbytes((16, 16, 16), "uint8")
    with BrickLoader(threads=1) as loader:
        host = HostFiller(context, gl, 4 * code_nbytes, loader)
        host.waits = False
        content = content_of(source, Box.of_shape((32, 32, 32)))
        fill(host, context, gl, source, content)
        host.waits = True
        fill(host, context, gl, source, content)  # eight bricks, of which three fit
        assert host.allocated_nbytes <= 4 * code_nbytes
        assert source.ncoarse_reads == 1
        host.waits = False
        fill(host, context, gl, source, content)
        assert source.ncoarse_reads == 1
