"""What Zerobit guarantees of any data, and what its settings change."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import FrozenInstanceError
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from octobrick.codec import Codebook, Zerobit

from .zerobit_volumes import KINDS, scene

each_kind = pytest.mark.parametrize(("dtype", "channels"), KINDS)
FLOAT_MAX = np.finfo(np.float32).max
FLOAT_TINY = np.finfo(np.float32).smallest_subnormal

any_float = st.floats(allow_nan=False, allow_infinity=False, width=32)
any_array = st.sampled_from([name for name, channels in KINDS if channels == 1]).flatmap(
    lambda dtype: hnp.arrays(
        dtype,
        hnp.array_shapes(min_dims=3, max_dims=3, max_side=9),
        elements=any_float if dtype == "float32" else hnp.from_dtype(np.dtype(dtype)),
    )
)


def round_trip(codec: Zerobit, array: NDArray[Any], **options: Any) -> NDArray[Any]:
    return codec.decode(codec.encode(array, **options), array.shape, array.dtype)


def mean_square(a: NDArray[Any], b: NDArray[Any]) -> float:
    return float(((a.astype(np.float64) - b.astype(np.float64)) ** 2).mean())


# ---- Any data --------------------------------------------------------------------------------


@given(any_array, st.floats(0, 1), st.sampled_from(["global", "block"]))
@settings(max_examples=150, deadline=None)
def test_no_voxel_leaves_the_range_of_the_original(
    array: NDArray[Any], ratio: float, thresholds: Any
) -> None:
    decoded = round_trip(Zerobit(ratio, thresholds=thresholds, background=array.flat[0]), array)
    assert decoded.dtype == array.dtype
    assert decoded.shape == array.shape
    assert array.min() <= decoded.min()
    assert decoded.max() <= array.max()


@each_kind
@pytest.mark.parametrize("shape", [(1, 1, 1), (3, 5, 2), (16, 16, 16), (17, 4, 33)])
def test_constant_volumes_are_exact_and_cost_a_byte_per_unit_block(
    dtype: str, channels: int, shape: tuple[int, ...]
) -> None:
    """They are all background."""
    full = (*shape, 3) if channels == 3 else shape
    array = np.full(full, 77, dtype)
    code = Zerobit(0.02).encode(array)
    assert (Zerobit().decode(code, full, dtype) == 77).all()
    blocks = int(np.prod([-(-n // 16) for n in shape]))
    assert len(code) == 64 + 6 * blocks + 8


@each_kind
@pytest.mark.parametrize("ratio", [0.0, 1e-9, 0.01, 1.0])
def test_up_to_256_colours_in_constant_cells_are_exact(
    dtype: str, channels: int, ratio: float
) -> None:
    rng = np.random.default_rng(5)
    colours = rng.permutation(256)[:, None] * np.ones(channels, int)
    if channels == 3:
        colours[:, 1] = rng.integers(0, 256, 256)
    palette = (colours - 128 if dtype in ("int8", "int16") else colours).astype(dtype)
    array = palette[rng.integers(0, 256, (6, 8, 10))].repeat(4, 0).repeat(4, 1).repeat(4, 2)
    array = array if channels == 3 else array[..., 0]
    np.testing.assert_array_equal(round_trip(Zerobit(ratio), array), array)


def test_ratio_1_keeps_every_detail_and_ratio_0_none() -> None:
    array = np.random.default_rng(2).integers(0, 65536, (16, 32, 16), np.uint16)
    everything, nothing = Zerobit(1).stats(Zerobit(1).encode(array)), Zerobit(0)
    assert everything.details > 0.999 * 63 * 128
    code = nothing.encode(array)
    assert nothing.stats(code).details == 0
    means = array.reshape(4, 4, 8, 4, 4, 4).mean((1, 3, 5))
    decoded = nothing.decode(code, array.shape, array.dtype)[::4, ::4, ::4]
    # 128 different means have as many codewords.
    np.testing.assert_allclose(decoded, means, atol=0.5)


def test_few_values_with_all_details_are_off_by_rounding_alone() -> None:
    """Fourteen details and an average, each rounded to a whole number."""
    array = np.random.default_rng(4).integers(0, 2, (4, 4, 4), np.uint8) * 255
    decoded = round_trip(Zerobit(1), array)
    assert np.abs(decoded.astype(int) - array).max() <= 7


def test_floats_with_all_details_are_as_exact_as_their_codewords() -> None:
    """One cell has 63 details: none of them is quantised."""
    array = np.random.default_rng(4).normal(size=(4, 4, 4)).astype(np.float32)
    decoded = round_trip(Zerobit(1), array)
    np.testing.assert_allclose(decoded, array, atol=2e-6)


@pytest.mark.parametrize("dtype", ["uint8", "int8", "uint16", "int16"])
def test_full_range_does_not_wrap(dtype: str) -> None:
    info = np.iinfo(dtype)
    array = np.where(np.indices((8, 8, 8)).sum(0) % 2 == 0, info.min, info.max).astype(dtype)
    decoded = round_trip(Zerobit(1), array)
    assert np.abs(decoded.astype(int) - array).max() <= 14


@pytest.mark.parametrize("scale", [FLOAT_MAX, FLOAT_TINY * 7, 1e-30])
def test_floats_at_the_edges_stay_finite(scale: np.float32) -> None:
    rng = np.random.default_rng(6)
    array = (rng.choice([-1.0, 0.0, 1.0], (9, 9, 9)) * np.float64(scale)).astype(np.float32)
    for ratio in (0.05, 1.0):
        decoded = round_trip(Zerobit(ratio), array)
        assert np.isfinite(decoded).all()
        assert np.abs(decoded).max() <= np.float32(scale)


def test_levels_are_means_of_the_original() -> None:
    array = scene((16, 20, 24), "float32")
    code = Zerobit(1).encode(array)
    for level in (1, 2):
        side = 2**level
        means = array.reshape(16 // side, side, 20 // side, side, 24 // side, side).mean((1, 3, 5))
        decoded = Zerobit().decode_level(code, level)
        assert decoded.shape == means.shape
        # Of a range of 100; the codewords are not exact.
        assert mean_square(decoded, means) < 0.5**2


def test_edges_are_continued_so_that_a_cut_cell_keeps_its_values() -> None:
    array = np.zeros((5, 5, 5), np.uint8)
    array[4] = 200
    decoded = round_trip(Zerobit(0), array)
    assert (decoded[4] == 200).all()


# ---- Settings --------------------------------------------------------------------------------


@pytest.mark.parametrize("thresholds", ["global", "block"])
@pytest.mark.parametrize("ratio", [0.01, 0.05, 0.2])
def test_the_ratio_is_that_of_the_details_kept(thresholds: Any, ratio: float) -> None:
    array = scene((32, 32, 48), "float32")
    codec = Zerobit(ratio, thresholds=thresholds)
    wanted = array.size * ratio
    assert wanted * 0.99 <= codec.stats(codec.encode(array)).details <= wanted * 1.01 + 1


@pytest.mark.parametrize("ratio", [0.01, 0.03, 0.1])
def test_orthonormal_ranking_and_one_threshold_have_the_least_error(ratio: float) -> None:
    """Claims Z5 and Z8; float32 of few codewords would hide it, so colours are used."""
    array = scene((32, 32, 32), "uint8", 3)
    error = {
        (ranking, thresholds): mean_square(
            array, round_trip(Zerobit(ratio, ranking=ranking, thresholds=thresholds), array)
        )
        for ranking in ("orthonormal", "literal")
        for thresholds in ("global", "block")
    }
    assert error["orthonormal", "global"] == min(error.values())
    assert error["orthonormal", "block"] < error["literal", "block"]


def test_averages_are_kept_however_low_the_ratio_unless_they_are_counted() -> None:
    """Claim Z7: counted, they would turn cells black."""
    array = scene((32, 32, 32), "uint8") // 4 + 50
    assert round_trip(Zerobit(0.005, background=0), array).min() >= 40
    counted = round_trip(Zerobit(0.005, background=0, count_averages=True), array)
    assert (counted == 0).mean() > 0.1


def test_the_background_is_the_commonest_value_of_constant_cells_unless_given() -> None:
    array = np.full((16, 16, 16), -1000, np.int16)
    array[4:9, 4:9, 4:9] = 40
    codec = Zerobit()
    assert codec.stats(codec.encode(array)).background == (-1000,)
    assert codec.stats(codec.encode(array)).cells == 8
    given_zero = Zerobit(background=0)
    assert given_zero.stats(given_zero.encode(array)).cells == 64
    np.testing.assert_array_equal(round_trip(Zerobit(1), array)[:4], array[:4])


def test_selected_cells_cost_what_they_would_alone_and_all_others_nothing() -> None:
    """Claim Z32: the ratio is relative to what is selected, or it would keep next to everything."""
    array = scene((32, 32, 64), "uint8", 3, seed=2)
    wanted = np.zeros((8, 8, 16), bool)
    wanted[2:4, 3:6, 1:9] = True
    codec = Zerobit(0.05, background=0)
    code = codec.encode(array, wanted=wanted)
    stats = codec.stats(code)
    assert stats.cells <= 48
    assert stats.details == pytest.approx(0.05 * 64 * 48, rel=0.02)
    decoded = codec.decode(code, array.shape, array.dtype)
    voxels = wanted.repeat(4, 0).repeat(4, 1).repeat(4, 2)
    assert (decoded[~voxels] == 0).all()
    alone = np.ascontiguousarray(array[8:16, 12:24, 4:36])
    np.testing.assert_array_equal(decoded[8:16, 12:24, 4:36], round_trip(codec, alone))


def test_unwanted_voxels_may_be_anything() -> None:
    array = np.full((8, 4, 4), np.nan, np.float32)
    array[:4] = np.arange(64, dtype=np.float32).reshape(4, 4, 4)
    wanted = np.array([[[True]], [[False]]])
    decoded = round_trip(Zerobit(1, background=-5), array, wanted=wanted)
    assert (decoded[4:] == -5).all()
    np.testing.assert_allclose(decoded[:4], array[:4], atol=1e-4)
    assert (round_trip(Zerobit(), array, wanted=~wanted & False) == 0).all()


def test_a_threshold_is_the_scale_of_what_was_dropped() -> None:
    array = np.zeros((16, 16, 32), np.float32)
    array[:, :, 16:] = np.random.default_rng(8).normal(size=(16, 16, 16)) * 10
    codec = Zerobit(0.1)
    found = codec.block_thresholds(codec.encode(array))
    assert found.shape == (1, 1, 2)
    assert found[0, 0, 0] == 0
    # Details of level 1 are means of 8 noises of 10: about 3.5, of which the tail is kept.
    assert 2 < found[0, 0, 1] < 10
    assert (codec.block_thresholds(Zerobit(1).encode(array)) == 0).all()
    assert (codec.block_thresholds(Zerobit(0).encode(array)) >= found).all()


# ---- Codebooks -------------------------------------------------------------------------------


@each_kind
def test_a_shared_codebook_serves_many_codes_and_lies_in_none(dtype: str, channels: int) -> None:
    steps = [scene((16, 16, 20), dtype, channels, seed) for seed in range(3)]
    codebook = Zerobit.train(steps, like=Zerobit(0.05))
    codec = Zerobit(0.05, codebook=Codebook(bytes(codebook.data)))
    for array in steps:
        code = codec.encode(array)
        assert codec.stats(code).codebook_nbytes == 0
        assert len(code) < len(Zerobit(0.05).encode(array))
        shared = mean_square(array, codec.decode(code, array.shape, dtype))
        assert shared <= 2 * mean_square(array, round_trip(Zerobit(0.05), array))


def test_a_codebook_trained_on_one_array_makes_the_code_that_it_makes_alone() -> None:
    array = scene((16, 17, 20), "uint8", 3)
    shared = Zerobit(codebook=Zerobit.train([array]))
    np.testing.assert_array_equal(round_trip(shared, array), round_trip(Zerobit(), array))
    assert (
        shared.stats(shared.encode(array)).details
        == Zerobit().stats(Zerobit().encode(array)).details
    )


# ---- How it runs -----------------------------------------------------------------------------


@each_kind
def test_threads_and_strides_change_nothing(dtype: str, channels: int) -> None:
    array = scene((20, 34, 50), dtype, channels)
    code = Zerobit().encode(array, threads=1)
    assert Zerobit().encode(array, threads=7) == code
    assert Zerobit().encode(array[::-1, :, ::-1][::-1, :, ::-1]) == code
    assert Zerobit().encode(np.asfortranarray(array)) == code
    assert Zerobit().encode(array.astype(array.dtype.newbyteorder(">"))) == code
    one, many = (Zerobit().decode(code, array.shape, dtype, threads=n) for n in (1, 7))
    assert one.tobytes() == many.tobytes()


def test_many_python_threads_may_use_one_codec() -> None:
    arrays = [scene((16, 20, 24), "uint16", seed=seed) for seed in range(8)]
    codec = Zerobit(0.1)
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda a: round_trip(codec, a), arrays))
    for array, decoded in zip(arrays, found, strict=True):
        np.testing.assert_array_equal(decoded, round_trip(codec, array))


def test_a_codec_is_an_immutable_value() -> None:
    assert Zerobit(ratio=0.05) == Zerobit()
    assert len({Zerobit(), Zerobit(0.05), Zerobit(0.06)}) == 2
    with pytest.raises(FrozenInstanceError):
        Zerobit().ratio = 0.5  # type: ignore[misc]


def test_a_voxel_is_a_scalar_and_a_coloured_one_an_array() -> None:
    grey, colour = scene((4, 4, 8), "uint16"), scene((4, 4, 8), "uint8", 3)
    voxel = Zerobit().decode_voxel(Zerobit().encode(grey), (1, 2, 3))
    assert isinstance(voxel, np.uint16)
    assert Zerobit().decode_voxel(Zerobit().encode(colour), (1, 2, 3)).shape == (3,)
