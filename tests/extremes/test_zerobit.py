"""Zerobit at the extremes: what has a promise without a bound, in numpy, C++ and shaders."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from octobrick.codec import Zerobit, deblock
from octobrick.codec import reference_zerobit as reference
from octobrick.codec.errors import InvalidInputError, NotFiniteError, UnsupportedError

from .table import holds
from .ways_to_code import ZerobitWay

INTEGERS = ("uint8", "int8", "uint16", "int16")
FLOAT_MAX = np.finfo(np.float32).max
TINY = np.finfo(np.float32).smallest_subnormal
ROUNDED = 7.5
"""Fourteen details and an average make a voxel, each rounded by half at most."""


def off(way: ZerobitWay, array: NDArray[Any], codec: Zerobit) -> float:
    """The largest error, after the result was found to lie within the range of the array."""
    decoded = way.round_trip(array, codec).astype(np.float64)
    wide, slack = array.astype(np.float64), way.slack(array)
    assert decoded.shape == array.shape
    assert np.isfinite(decoded).all()
    assert decoded.min() >= wide.min() - slack
    assert decoded.max() <= wide.max() + slack
    return float(np.abs(decoded - wide).max()) - slack


@holds("zerobit", "empty-input", "cpp")
def test_no_voxels_are_refused(implementation: str) -> None:
    for shape in ((0, 4, 4), (4, 4, 0), (0, 4, 4, 3)):
        with pytest.raises(InvalidInputError):
            Zerobit().encode(np.empty(shape, np.uint8))
    with pytest.raises(InvalidInputError, match="no arrays"):
        Zerobit.train([])


@holds("zerobit", "one-voxel", "numpy", "cpp", "glsl")
def test_volumes_thinner_than_a_cell_are_kept(zerobit: ZerobitWay, noise: Any) -> None:
    """So few cells have a codeword for each of their details: rounding is all that is lost."""
    for shape, dtype in (((1, 1, 1), "uint8"), ((1, 1, 9), "int16"), ((1, 5, 8), "float32")):
        array = noise(shape, dtype)
        codec = Zerobit(1, background=float(array.flat[0]) if array.size == 1 else 0.0)
        assert off(zerobit, array, codec) <= (1e-3 if dtype == "float32" else ROUNDED)


@holds("zerobit", "uneven", "numpy", "cpp", "glsl")
def test_cells_that_are_cut_keep_their_values(zerobit: ZerobitWay) -> None:
    """They are continued by their last voxels, so that a constant cell stays one."""
    for shape in ((17, 13, 11), (5, 38, 3)):
        coarse = np.random.default_rng(3).integers(1, 250, tuple(-(-n // 4) for n in shape))
        array = coarse.astype(np.uint8).repeat(4, 0).repeat(4, 1).repeat(4, 2)
        array = array[tuple(slice(n) for n in shape)]
        assert off(zerobit, array, Zerobit(0)) <= 0


@pytest.mark.parametrize("ratio", [0.0, 1.0])
@holds("zerobit", "constant", "numpy", "cpp", "glsl")
def test_one_value_is_exact_at_any_ratio(zerobit: ZerobitWay, ratio: float) -> None:
    for dtype, value in (("uint8", 255), ("int16", -32768), ("float32", 3.4e38), ("float32", 0.1)):
        assert off(zerobit, np.full((6, 5, 9), value, dtype), Zerobit(ratio)) <= 0


@pytest.mark.parametrize("dtype", INTEGERS)
@holds("zerobit", "full-range", "numpy", "cpp", "glsl")
def test_the_whole_range_of_a_type_does_not_wrap(zerobit: ZerobitWay, dtype: str) -> None:
    info = np.iinfo(dtype)
    array = np.where(np.indices((8, 8, 8)).sum(0) % 2 == 0, info.min, info.max).astype(dtype)
    # The detail is half the range, one more than its codeword can be; and they are rounded.
    assert off(zerobit, array, Zerobit(1)) <= 2 * ROUNDED


@pytest.mark.parametrize("dtype", ["uint32", "int64", "float64"])
@holds("zerobit", "wide-integers", "cpp")
def test_wider_types_are_refused_by_name(implementation: str, dtype: str) -> None:
    with pytest.raises(UnsupportedError, match=dtype):
        Zerobit().encode(np.ones((8, 8, 8), dtype))


@holds("zerobit", "greatest-floats", "numpy", "cpp", "glsl")
def test_the_greatest_floats_stay_finite(zerobit: ZerobitWay) -> None:
    array = (np.random.default_rng(2).uniform(-1, 1, (6, 8, 9)) * FLOAT_MAX).astype(np.float32)
    array[0, 0, 0], array[0, 0, 1] = -FLOAT_MAX, FLOAT_MAX
    for ratio in (0.0, 0.05, 1.0):
        off(zerobit, array, Zerobit(ratio))
    # One cell has no more details than codewords: each is kept but for its rounding.
    assert off(zerobit, array[:4, :4, :4].copy(), Zerobit(1)) <= float(FLOAT_MAX) * 1e-5


@holds("zerobit", "greatest-floats", "cpp")
def test_thresholds_beyond_float32_do_not_limit_a_filter_that_stays_finite(
    implementation: str,
) -> None:
    array = (np.random.default_rng(2).uniform(-1, 1, (6, 8, 9)) * FLOAT_MAX).astype(np.float32)
    code = Zerobit(0).encode(array)
    assert np.isinf(deblock.zerobit_bounds(Zerobit(0), code)).all()
    filtered = deblock.deblocked(Zerobit(0), code, array.shape, array.dtype)
    assert np.isfinite(filtered).all()


@holds("zerobit", "denormals", "numpy", "cpp", "glsl")
def test_denormals_keep_the_means_of_their_cells(zerobit: ZerobitWay) -> None:
    steps = np.random.default_rng(3).integers(0, 90, (2, 2, 2))
    array = (steps * np.float64(TINY)).astype(np.float32).repeat(4, 0).repeat(4, 1).repeat(4, 2)
    assert off(zerobit, array, Zerobit(0)) <= float(TINY) / 2


@holds("zerobit", "signed-zero", "numpy", "cpp", "glsl")
def test_minus_zero_is_zero(zerobit: ZerobitWay) -> None:
    array = np.where(np.indices((8, 8, 8)).sum(axis=0) % 2, np.float32(-0.0), np.float32(0.0))
    for ratio in (0.0, 1.0):
        np.testing.assert_array_equal(zerobit.round_trip(array, Zerobit(ratio)), 0)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@holds("zerobit", "not-finite", "cpp")
def test_what_is_not_finite_is_refused_by_its_place(implementation: str, bad: float) -> None:
    array = np.zeros((8, 8, 8), np.float32)
    array[2, 5, 7] = bad
    with pytest.raises(NotFiniteError) as caught:
        Zerobit().encode(array)
    assert "(2, 5, 7)" in caught.value.message
    with pytest.raises(InvalidInputError):
        Zerobit(float("nan"))


@holds("zerobit", "ratio-ends", "numpy", "cpp", "glsl")
def test_no_details_are_means_and_all_details_are_all_but_rounding(
    zerobit: ZerobitWay, noise: Any
) -> None:
    array = noise((8, 8, 8), "uint16")
    means = array.reshape(2, 4, 2, 4, 2, 4).mean((1, 3, 5)).repeat(4, 0).repeat(4, 1).repeat(4, 2)
    decoded = zerobit.round_trip(array, Zerobit(0, background=0)).astype(np.float64)
    assert np.abs(decoded - means).max() <= 0.5
    assert off(zerobit, array[:4, :4, :4].copy(), Zerobit(1, background=0)) <= ROUNDED
    for ratio in (-1e-9, 1.001):
        with pytest.raises(InvalidInputError, match="0 to 1"):
            Zerobit(ratio)


@holds("zerobit", "void-and-noise", "numpy", "cpp", "glsl")
def test_nothing_and_noise_have_their_sizes(zerobit: ZerobitWay, noise: Any) -> None:
    """The sizes are of the one format; each implementation decodes what has them."""
    void = np.zeros((16, 16, 48), np.uint8)
    assert off(zerobit, void, Zerobit(1)) <= 0
    code = reference.parse(Zerobit(1).encode(void))
    assert [len(block) for block in code.blocks] == [1, 1, 1]
    array = noise((16, 16, 16), "int16")
    off(zerobit, array[:4, :8, :8].copy(), Zerobit(1))
    block = reference.parse(Zerobit(1).encode(array)).blocks[0]
    assert len(block) - 1 - 8 - 5 * 64 == 640 + 4032


@holds("zerobit", "colours", "numpy", "cpp", "glsl")
def test_few_values_are_exact_and_more_than_256_are_near_a_codeword(zerobit: ZerobitWay) -> None:
    rng = np.random.default_rng(1)

    def cells(count: int, step: int) -> NDArray[np.uint16]:
        values = rng.permutation(count).astype(np.uint16) * np.uint16(step)
        side = count // 64
        return values.reshape(8, 8, side).repeat(4, 0).repeat(4, 1).repeat(4, 2)

    assert off(zerobit, cells(64, 1000), Zerobit(0.05)) <= 0
    # Boxes of four: at most two steps from their mean.
    assert off(zerobit, cells(320, 200), Zerobit(0.05)) <= 2 * 200


@holds("zerobit", "colours", "numpy", "cpp")
def test_colours_are_exact_where_there_are_as_many_codewords(implementation: str) -> None:
    from octobrick.codec import reference_zerobit_encoder as encoder

    rng = np.random.default_rng(2)
    palette = rng.integers(0, 256, (256, 3), np.uint8)
    array = palette[rng.permutation(256).reshape(4, 8, 8)].repeat(4, 0).repeat(4, 1).repeat(4, 2)
    if implementation == "numpy":
        decoded = reference.decode(encoder.encode(array, encoder.Settings(0.02)))
    else:
        decoded = Zerobit(0.02).decode(Zerobit(0.02).encode(array), array.shape, array.dtype)
    np.testing.assert_array_equal(decoded, array)


@holds("zerobit", "low-averages", "numpy", "cpp", "glsl")
def test_faint_cells_beside_strong_ones_do_not_turn_to_background(zerobit: ZerobitWay) -> None:
    array = np.full((8, 8, 16), 3, np.uint8)  # faint
    array[..., 8:] = np.where(np.indices((8, 8, 8)).sum(0) % 2, 250, 2)  # strong details
    codec = Zerobit(0.01, background=0)
    decoded = zerobit.round_trip(array, codec)
    np.testing.assert_array_equal(decoded[..., :8], 3)
    counted = zerobit.round_trip(array, Zerobit(0.01, background=0, count_averages=True))
    assert (counted[..., :8] == 0).all()  # the paper's reading, on purpose


@holds("zerobit", "ratio-ends", "cpp")
@pytest.mark.parametrize("ratio", [0.0, 1e-300, 0.5, 1.0])
def test_voxels_planes_and_cells_are_the_same_at_any_ratio(
    implementation: str, noise: Any, ratio: float
) -> None:
    array = noise((5, 6, 9), "int16")
    codec = Zerobit(ratio)
    code = codec.encode(array)
    whole = codec.decode(code, array.shape, array.dtype)
    for z, y, x in ((0, 0, 0), (4, 5, 8), (3, 2, 7)):
        cell, at = (z // 4, y // 4, x // 4), (z % 4, y % 4, x % 4)
        assert codec.decode_voxel(code, (z, y, x)) == whole[z, y, x]
        assert codec.decode_cell(code, cell)[at] == whole[z, y, x]
        assert codec.decode_plane(code, cell, 0, at[0])[at[1], at[2]] == whole[z, y, x]


@pytest.mark.parametrize("dtype", ["uint8", "float32"])
@holds("zerobit", "threads-and-instructions", "cpp")
def test_threads_change_no_bit(implementation: str, noise: Any, dtype: str) -> None:
    """Instructions have no switch here; the golden vectors of tests/codec/test_cpp_door.py run
    by each set of them."""
    array = noise((20, 33, 35), dtype)
    codec = Zerobit(0.1)
    code = codec.encode(array, threads=1)
    voxels = codec.decode(code, array.shape, dtype, threads=1)
    for threads in (2, 3, 7):
        assert codec.encode(array, threads=threads) == code
        found = codec.decode(code, array.shape, dtype, threads=threads)
        assert found.tobytes() == voxels.tobytes()
